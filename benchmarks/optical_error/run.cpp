// Error of J_obs by rays: the default setting against an independent pattern that is traced on to 0.5 %, on the same
// equilibria. One line per reference design and silicone: J, the rays' part of its printed error, J of the finer light,
// what J is off by, core-seconds of light.
//   lumo_optical_error [--first N] [--designs N] [--material DS|Sol] [--loads N,N,...] [--threads N]
//       [--tolerance T --rounds N]
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/pipeline/evaluate.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

using namespace lumo;

namespace {

using Light = Tracer<BeerLambert, ExitPower, Embree>;
using Simulation = Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<MixedCholesky>>;

/// Presses each scenario once and remembers its states, so that both settings light the same equilibria.
struct RememberedPresses {
  struct Memory {
    std::mutex access;
    std::map<std::tuple<double, double, double>, std::vector<MechanicalState>> states;  ///< by diameter, angle, place
  };
  Simulation simulation;
  std::shared_ptr<Memory> memory = std::make_shared<Memory>();

  struct Pad {
    decltype(std::declval<Simulation>().prepare(std::declval<Body>(), std::declval<TetMesh>())) pad;
    std::shared_ptr<Memory> memory;

    const TetMesh& mesh() const { return pad.mesh(); }
    std::vector<MechanicalState> press(const Scenario<Sphere>& s) const {
      const auto key = std::tuple(s.indenter.diameter_m, s.angle_rad, s.y_m);
      {
        const std::lock_guard lock(memory->access);
        if (const auto known = memory->states.find(key); known != memory->states.end()) return known->second;
      }
      std::vector<MechanicalState> states = pad.press(s);
      const std::lock_guard lock(memory->access);
      return memory->states[key] = std::move(states);
    }
  };
  Pad prepare(const Body& body, const TetMesh& mesh) const { return {simulation.prepare(body, mesh), memory}; }
};

}  // namespace

int main(int argc, char** argv) {
  std::size_t count = plain_references().size(), first = 0;
  std::string only;
  Ensemble ensemble = flat_ensemble();
  int threads = 2;
  RayRefinement rays;  // the setting that is tried
  for (int i = 1; i + 1 < argc; i += 2) {
    if (!std::strcmp(argv[i], "--first")) first = std::size_t(std::atoi(argv[i + 1]));
    if (!std::strcmp(argv[i], "--designs")) count = std::size_t(std::atoi(argv[i + 1]));
    if (!std::strcmp(argv[i], "--material")) only = argv[i + 1];
    if (!std::strcmp(argv[i], "--threads")) threads = std::atoi(argv[i + 1]);
    if (!std::strcmp(argv[i], "--tolerance")) rays.tolerance = std::atof(argv[i + 1]);
    if (!std::strcmp(argv[i], "--rounds")) rays.rounds = std::atoi(argv[i + 1]);
    if (!std::strcmp(argv[i], "--loads")) {
      ensemble.loads_N.clear();
      for (const char* p = argv[i + 1]; *p;) {
        char* end = nullptr;
        ensemble.loads_N.push_back(std::strtod(p, &end));
        if (end == p) return std::fprintf(stderr, "lumo_optical_error: '%s' is no list of loads\n", argv[i + 1]), 2;
        p = *end == ',' ? end + 1 : end;
      }
    }
  }
  const TetgenMesher mesher;  // before threads start
  std::printf(
      "design           card  J_obs      2 s.e.   J_fine     its 2 s.e.  off by   core-s  core-s of J_fine  least "
      "pair\n");
  for (std::size_t k = first; k < std::min(first + count, plain_references().size()); ++k)
    for (const char* card : {"DS", "Sol"}) {
      if (!only.empty() && only != card) continue;
      const FingerDesign d = plain_references()[k];
      const Silicone silicone = lumo::silicone(card);
      const RememberedPresses presses{{NeoHookean{silicone.mu_Pa, silicone.lambda_Pa}}};
      Pipeline<TetgenMesher, RememberedPresses, Light> pipeline{mesher, presses, Light{}};
      pipeline.optical_error.area = 0.0;  // the same mesh for both
      pipeline.rays = rays;
      const Evaluation once = evaluate({d, silicone}, ensemble, pipeline, TbbExecutor{threads});
      Light::Config other;
      other.seed = 1;
      pipeline.tracer = Light(other);
      pipeline.rays = {.tolerance = 0.005, .rounds = 16};
      const Evaluation fine = evaluate({d, silicone}, ensemble, pipeline, TbbExecutor{threads});
      if (!once.J_obs || !fine.J_obs) {
        std::printf("%4.1f %4.1f %4.1f no score\n", d.h_fp, d.h_ep, d.w_s);
        continue;
      }
      const ObservedState &a = once.observed[once.worst_observation->first],
                          &b = once.observed[once.worst_observation->second];
      std::printf(
          "%g,%g,%g,%g,%g  %-4s  %.3e  %5.2f %%  %.3e  %5.2f %%  %+6.2f %%  %5.0f  %5.0f  d %g mm, %g N, y %g and %g "
          "mm\n",
          d.h_fp, d.h_ep, d.w_s, d.h_s, d.w_v, card, once.J_obs->value, 100.0 * once.J_obs->error / once.J_obs->value,
          fine.J_obs->value, 100.0 * fine.J_obs->error / fine.J_obs->value,
          100.0 * (once.J_obs->value / fine.J_obs->value - 1.0), once.observations.seconds.optics,
          fine.observations.seconds.optics, 1e3 * a.diameter_m, a.load_N, 1e3 * a.y_m, 1e3 * b.y_m);
      std::fflush(stdout);
    }
  return 0;
}
