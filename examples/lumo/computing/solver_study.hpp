#pragma once

#include "configuration/configuration.hpp"
#include "console/output.hpp"
#include "console/progress.hpp"
#include "report/report.hpp"

#include <string>
#include <vector>

namespace lumo::program {

/// One load by one solver, beside the state's record.
struct SolverState {
  double met_force_N = undefined;  ///< when the advance stopped, before the hold; of a solver that goes in time
  /// Against the equilibrium on the same mesh under the force that was reached; undefined on the mesh of another order.
  double equilibrium_depth_mm = undefined;
  double distance_over_height =
      undefined;  ///< root mean square over nodes of the difference of displacements, per pad height
  double distance_relative = undefined;  ///< norm of that difference per norm of the equilibrium's displacements
};

/// One way of computing the press.
struct SolverRow {
  std::string name;
  Mechanics mechanics;
  std::size_t nodes = 0, elements = 0;
  ScenarioRecord scenario = {};
  std::vector<SolverState> states = {};  ///< one for each of the scenario's
  double seconds = undefined;            ///< of the press by the clock, without the mesh
};

struct SolverStudy {
  double pad_height_mm = undefined;
  std::vector<SolverRow> rows;
};

/// `lumo study solver`: one press of one finger by vertex block descent with 10 and with 100 sweeps, and in equilibrium
/// on the same linear and on the default quadratic mesh. Throws MeshError; a solve that ends badly is a status in its
/// row.
SolverStudy make_solver_study(const Configuration& request, int threads, Progress& progress);

std::string present(const Configuration& request, bool as_json, const SolverStudy& study, Output& files);
/// The same as one page that opens from disk.
std::string solver_page(const Configuration& request, const SolverStudy& study);

}  // namespace lumo::program
