#include "catch.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/materials/stable_neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/mechanics/solvers/vertex_block_descent.hpp"
#include "lumo/support/cholmod.hpp"
#include "mechanics/bodies.hpp"

#include <chrono>
#include <thread>
#include <vector>

using namespace lumo;

namespace {

const Scenario<Sphere> two_loads{Sphere{10e-3}, 20 * pi / 180, 0.0, {0.5, 1.0}};

auto small_block(int order) {
  return test::symmetric_block(Vec3d(6e-3, 6e-3, 4e-3), test::even(3), test::even(3), test::even(2), order);
}

}  // namespace

TEST_CASE("whoever watches a press sees each load once, after its factorisations, and changes no bit") {
  const auto [body, mesh] = small_block(2);
  Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<Cholmod>> sim;
  const std::vector<MechanicalState> alone = sim.press(body, mesh, two_loads);
  std::vector<PressReport> seen, ended;
  sim.solver.config.watch = [&](const PressReport& r) { (r.ended ? ended : seen).push_back(r); };
  const std::vector<MechanicalState> watched = sim.press(body, mesh, two_loads);
  REQUIRE(watched.size() == 2);
  REQUIRE(ended.size() == 2);
  int factorisations = 0;
  for (std::size_t k = 0; k < 2; ++k) {
    CHECK(watched[k].displacement == alone[k].displacement);
    CHECK(ended[k].ended == Status::converged);
    CHECK(ended[k].wanted_N == Approx(two_loads.loads_N[k]));
    CHECK(ended[k].load_N == Approx(two_loads.loads_N[k]));
    CHECK(ended[k].depth_m == watched[k].depth_m);
    CHECK(ended[k].iterations == watched[k].iterations);
    CHECK(ended[k].residual.value() <= sim.solver.config.residual_tolerance);
    factorisations += watched[k].iterations;
  }
  CHECK(int(seen.size()) == factorisations);  // none was refused
  CHECK(seen.front().load_N == 0.0);
  CHECK(seen.back().load_N >= 0.5 * (1 - 1e-12));
}

TEST_CASE("a press ends before the factorisation that comes after its time limit") {
  const auto [body, mesh] = small_block(2);
  Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<Cholmod>> sim;
  Scenario<Sphere> once = two_loads;
  once.loads_N = {0.5};
  const int all = sim.press(body, mesh, once).front().iterations;
  REQUIRE(all > 2);
  // Also after the last one, when only the certificate of stability is left to be factored.
  for (const int late : {1, all}) {
    CAPTURE(late);
    int count = 0;
    sim.solver.config.time_limit_s = 1.0;
    sim.solver.config.watch = [&](const PressReport& r) {
      if (!r.ended && ++count == late) std::this_thread::sleep_for(std::chrono::milliseconds(1100));
    };
    CHECK(sim.press(body, mesh, once).front().status == Status::time_limit);
    CHECK(count <= late);  // fewer where others had the processor
  }
}

TEST_CASE("descent is watched, too, step by step") {
  const auto [body, mesh] = small_block(1);
  Simulator<StableNeoHookean, SDFContact, LinearTet, VertexBlockDescent> sim;
  sim.solver.config.hold_s = 0.05;
  std::vector<PressReport> seen, ended;
  sim.solver.config.watch = [&](const PressReport& r) { (r.ended ? ended : seen).push_back(r); };
  const std::vector<MechanicalState> states = sim.press(body, mesh, two_loads);
  REQUIRE(ended.size() == 2);
  int sweeps = 0;
  for (std::size_t k = 0; k < 2; ++k) {
    CHECK(ended[k].ended == Status::held);
    CHECK(ended[k].load_N == two_loads.loads_N[k]);
    CHECK(ended[k].depth_m == states[k].depth_m);
    CHECK(ended[k].iterations == states[k].iterations);
    sweeps += states[k].iterations;
  }
  CHECK(sim.solver.config.sweeps * int(seen.size()) == sweeps);
  CHECK(seen.front().load_N == 0.0);
  CHECK(seen.back().load_N == 0.5);
}
