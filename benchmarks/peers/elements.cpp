// lumo's half of scikit_fem.py: the finger in quadratic tetrahedra in a bent state, its forces and its tangent, and one
// linear step with it. Files hold raw little-endian numbers: *.f64 and *.i32. Seconds are of the processor, of one
// thread.
//   lumo_peer_elements DIR EDGE_MM
//       writes nodes.f64, tets.i32 (10 nodes each), displacement.f64, forces.f64, equations.i32 (per component, −1:
//       held), and the lower triangle of the tangent of the free components by columns (starts.i32, rows.i32,
//       values.f64); then answers lines with lines:
//   assemble plain|cured N     seconds of the forces and of the tangent, each the mean of N
//   solve eigen|cholmod        seconds of analysis, factor and solution; writes step.f64

#include "half.hpp"
#include "lumo/mechanics/elements/equations.hpp"
#include "lumo/mechanics/elements/solid.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mesh/body_mesh.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/support/cholmod.hpp"
#include "lumo/support/tetgen.hpp"

#include <exception>
#include <filesystem>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

namespace {

using namespace lumo;
namespace fs = std::filesystem;

// Sheared along x and y without change of volume, and a little compressed: every term of the law counts, and the
// tangent stays positive definite.
Vec3d bent(const Vec3d& X) { return Vec3d(6.0, 3.0, -0.1) * (X.z() * X.z()); }

struct State {
  Body body;
  TetMesh mesh;
  Equations equations;
  Positions x;
  NeoHookean material{dragon_skin().mu_Pa, dragon_skin().lambda_Pa};
  Solid<NeoHookean, QuadraticTet> plain, cured;

  explicit State(double edge_m)
      : body(finger(plain_baseline(), dragon_skin(), options(edge_m))),
        mesh(mesh_body(body, TetgenMesher{})),
        equations(sector_of(mesh, {}), body, {}),
        x(positions_of(mesh)),
        plain(mesh, material, {.mean_dilatation = false}),
        cured(mesh, material, {.mean_dilatation = true}) {
    for (std::size_t k = 0; k < mesh.nodes.size(); ++k) x.col(Eigen::Index(k)) += bent(mesh.nodes[k]);
  }
  State(const State&) = delete;  // the solids point into the mesh
  State& operator=(const State&) = delete;

  static FingerOptions options(double edge_m) {
    FingerOptions o = plain_finger();
    o.mesh = {edge_m, edge_m, 0.0, 1.0, 1.6, edge_m};
    return o;
  }
  Positions forces(const Solid<NeoHookean, QuadraticTet>& solid) const {
    Positions f = Positions::Zero(3, x.cols());
    solid.add_forces(x, f);
    return f;
  }
  SparseLower tangent(const Solid<NeoHookean, QuadraticTet>& solid) const {
    SparseLower k = equations.pattern;
    std::fill_n(k.valuePtr(), k.nonZeros(), 0.0);
    solid.add_tangent(x, {&equations}, {k.valuePtr()});
    return k;
  }
};

void write_all(const fs::path& dir, const State& s, const Positions& f, const SparseLower& k) {
  std::vector<int> tets;
  for (const auto& t : s.mesh.tets) tets.insert(tets.end(), t.begin(), t.end());
  const Positions X = positions_of(s.mesh), u = s.x - X;
  write(dir / "nodes.f64", X.data(), std::size_t(X.size()));
  write(dir / "tets.i32", tets.data(), tets.size());
  write(dir / "displacement.f64", u.data(), std::size_t(u.size()));
  write(dir / "forces.f64", f.data(), std::size_t(f.size()));
  write(dir / "equations.i32", s.equations.of.data(), s.equations.of.size());
  write(dir / "starts.i32", k.outerIndexPtr(), std::size_t(k.cols()) + 1);
  write(dir / "rows.i32", k.innerIndexPtr(), std::size_t(k.nonZeros()));
  write(dir / "values.f64", k.valuePtr(), std::size_t(k.nonZeros()));
}

template <LinearSolver Solver>
void solve(const fs::path& dir, const State& s, const Positions& f, const SparseLower& k) {
  Eigen::VectorXd right(s.equations.count);
  for (std::size_t i = 0; i < s.equations.of.size(); ++i)
    if (s.equations.of[i] >= 0) right[s.equations.of[i]] = -f.data()[i];
  Solver solver;
  const double begun = processor_seconds();
  solver.analyze(k);
  const double analysed = processor_seconds();
  const FactorStatus status = solver.factorize(k);
  const double factored = processor_seconds();
  if (status != FactorStatus::positive_definite) throw InputError("the tangent is not positive definite");
  const Eigen::VectorXd step = solver.solve(right);
  const double solved = processor_seconds();
  write(dir / "step.f64", step.data(), std::size_t(step.size()));
  std::cout << analysed - begun << ' ' << factored - analysed << ' ' << solved - factored << std::endl;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc != 3) {
      std::cerr << "usage: lumo_peer_elements DIR EDGE_MM\n";
      return 2;
    }
    const fs::path dir = argv[1];
    const State s(1e-3 * std::stod(argv[2]));
    const Positions f = s.forces(s.plain);
    const SparseLower k = s.tangent(s.plain);
    write_all(dir, s, f, k);
    std::cout << "ready" << std::endl;
    for (std::string line; std::getline(std::cin, line);) {
      std::istringstream words(line);
      std::string what, which;
      words >> what >> which;
      if (what == "assemble") {
        int repeat = 1;
        words >> repeat;
        const auto& solid = which == "cured" ? s.cured : s.plain;
        const double begun = processor_seconds();
        for (int i = 0; i < repeat; ++i) s.forces(solid);
        const double summed = processor_seconds();
        for (int i = 0; i < repeat; ++i) s.tangent(solid);
        std::cout << (summed - begun) / repeat << ' ' << (processor_seconds() - summed) / repeat << std::endl;
      } else if (what == "solve" && which == "eigen") {
        solve<EigenCholesky>(dir, s, f, k);
      } else if (what == "solve" && which == "cholmod") {
        solve<Cholmod>(dir, s, f, k);
      } else {
        throw InputError("unknown: " + line);
      }
    }
  } catch (const std::exception& e) {
    std::cerr << "lumo_peer_elements: " << e.what() << '\n';
    return 1;
  }
}
