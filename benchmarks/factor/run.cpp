// Cholesky factors in single and in double precision on tangents of the plain finger whose contact is closed: CPU
// seconds of a factor, of its certificate and of a solution, and residuals over right-hand sides. Prints a page.
//   lumo_factor > benchmarks/factor/results.md
#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/solvers/press_system.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/support/cholmod.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "lumo/support/tetgen.hpp"

#include <cstdio>
#include <ctime>

using namespace lumo;

namespace {

template <class Work> double cpu_seconds(int times, Work&& work) {
  const std::clock_t start = std::clock();
  for (int k = 0; k < times; ++k) work();
  return double(std::clock() - start) / CLOCKS_PER_SEC / times;
}

struct Case {
  double contact_edge_mm, finest_mm, growth, y_mm;
};

void measure(const Case& c, const TetgenMesher& mesher) {
  using Model = SectorModel<NeoHookean, SDFContact, QuadraticTet, Cholmod>;
  const Silicone silicone = dragon_skin();
  FingerOptions options = plain_finger();
  options.mesh.contact_edge = 1e-3 * c.contact_edge_mm;
  const Body body = finger(plain_baseline(), silicone, options);
  const std::vector<Scenario<Sphere>> scenarios{{Sphere{10.0_mm}, 0.0, 1e-3 * c.y_mm, {1.0}}};
  const TetMesh mesh = mesh_for_contact(
      body, mesh_body(body, mesher), scenarios, mesher, Focus{.finest = 1e-3 * c.finest_mm, .growth = c.growth});
  const Model model(body, mesh, {true, c.y_mm == 0.0},
      PressPhysics{NeoHookean{silicone.mu_Pa, silicone.lambda_Pa}, SDFContact{}, QuadraticTet{}});
  const Touch touch = first_touch(body, mesh, scenarios[0]);
  const PressSystem<Model, Sphere> system{model, scenarios[0].indenter, touch.origin, scenarios[0].direction()};
  PressSystem<Model, Sphere>::Tangent tangent;
  system.tangent(positions_of(model.sector.mesh), 20e-6, 0, 1, tangent);
  const SparseLower& K = tangent.matrix.front();
  const Eigen::VectorXd rhs = tangent.coupling;

  Cholmod exact = model.blocks.front().analysed;
  MixedCholesky mixed;
  mixed.analyze(K);
  exact.factorize(K);
  mixed.factorize(K);
  constexpr int times = 15;
  double in_double = 0.0, in_single = 0.0;
  for (int k = 0; k < times; ++k) {  // in turns: the machine is not this program's own
    in_double += cpu_seconds(1, [&] { exact.factorize(K); });
    in_single += cpu_seconds(1, [&] { mixed.factorize(K); });
  }
  const double certificate = cpu_seconds(times, [&] { mixed.certify(); }),
               solve = cpu_seconds(times, [&] { exact.solve(rhs); }),
               rough = cpu_seconds(times, [&] { mixed.precondition(rhs); }),
               refined = cpu_seconds(times, [&] { mixed.solve(rhs); });
  const auto residual = [&](const Eigen::VectorXd& x) {
    return (K.selfadjointView<Eigen::Lower>() * x - rhs).norm() / rhs.norm();
  };
  std::printf("| %ld | %ld | %.1f | %.1f | **%.2f** | %.1f | %.1f | %.1f | %.1f | %.0e | %.0e |\n", long(K.cols()),
      long(K.nonZeros()), 1e3 * in_double / times, 1e3 * in_single / times, in_single / in_double, 1e3 * certificate,
      1e3 * solve, 1e3 * rough, 1e3 * refined, residual(mixed.precondition(rhs)), residual(mixed.solve(rhs)));
  std::fflush(stdout);
  if (!mixed.is_single()) std::fprintf(stderr, "lumo_factor: a factor broke down in single precision\n");
}

}  // namespace

int main() {
  const TetgenMesher mesher;
  std::printf(
      "# A factor in single precision beside CHOLMOD's\n\n```\nlumo_factor > benchmarks/factor/results.md\n```\n\n"
      "lumo::MixedCholesky beside lumo::Cholmod on tangents of the plain baseline under a 10 mm sphere, 20 µm into "
      "it;\nCPU milliseconds of one thread, factors taken in turns. Residuals are over the right-hand side: after one\n"
      "application of the factor, and refined.\n\n"
      "| equations | non-zeros | CHOLMOD's factor | in single | ratio | certificate | solution, CHOLMOD | rough | "
      "refined | residual, rough | refined |\n|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|\n");
  for (const Case& c : {Case{2.0, 0.2, 0.1, 0.0}, Case{2.5, 0.4, 0.12, 11.0}, Case{2.0, 0.2, 0.1, 11.0}})
    measure(c, mesher);
}
