#include "catch.hpp"
#include "lumo/mechanics/contact/contact_handler.hpp"
#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/indenters/box.hpp"
#include "lumo/mechanics/indenters/cylinder.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/mesh/body_mesh.hpp"
#include "lumo/support/cholmod.hpp"
#include "lumo/support/tetgen.hpp"
#include "mechanics/bodies.hpp"

#include <cmath>
#include <vector>

using namespace lumo;

namespace {

using FastSimulator = Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<Cholmod>>;

/// Sum of friction on the body.
Vec3d friction_of(const MechanicalState& s) {
  Vec3d sum = Vec3d::Zero();
  for (const Vec3d& f : s.friction_N) sum += f;
  return sum;
}

}  // namespace

TEST_CASE(
    "friction's answer follows Coulomb: a spring up to the limit, the limit beyond, along the way, and its stiffness "
    "is its slope") {
  const Vec3d size(2e-3, 2e-3, 1e-3);
  const Body body = test::block_body(size);
  const TetMesh mesh = test::block_mesh(size, test::even(1), test::even(1), test::even(1), 1, false);
  const SDFContact law{1e10, 0.4};
  const ContactSurface surface(mesh, body, [](const Patch& p) { return p.contactable; });
  const Box plate{{40e-3, 40e-3, 10e-3}, 1e-3};
  const Moving<Box> touching{&plate, Vec3d(1e-3, 1e-3, 1e-3), -Vec3d::UnitZ()};
  const FrictionHistory history(surface, law, law.friction, positions_of(mesh), touching);
  REQUIRE(history.points[0][0].gap <= 0.0);
  const Vec3d origin = touching.origin, at = history.points[0][0].place, n = Vec3d(0.1, -0.2, 1.0).normalized(),
              u = n.unitOrthogonal(), v = n.cross(u);
  const double pressure = 2e5, most = 0.4 * pressure;
  for (double slip : {3e-8, 1e-5, 3e-4}) {
    const Vec3d step = slip * (0.6 * u + 0.8 * v) + 1.5e-5 * n;  // along the normal nothing
    const auto answer = history.answer(0, 0, at + step, origin, n, pressure);
    CHECK(answer.traction.norm() == Approx(std::min(most, 3e9 * slip)));
    CHECK(answer.traction.normalized().dot(0.6 * u + 0.8 * v) == Approx(-1.0));
    CHECK(answer.stretch.norm() == Approx(std::min(most / 3e9, slip)));
    const auto with_tool = history.answer(0, 0, at + step, origin + step, n, pressure);
    CHECK(with_tool.traction.norm() < 1e-6);  // the tool went along
    for (int c = 0; c < 3; ++c) {
      const double h = 1e-4 * slip;
      const Vec3d slope = (history.answer(0, 0, at + step + h * Vec3d::Unit(c), origin, n, pressure).traction -
                              history.answer(0, 0, at + step - h * Vec3d::Unit(c), origin, n, pressure).traction) /
                          (2 * h);
      CHECK((slope + answer.stiffness.col(c)).norm() < 1e-5 * 3e9);
    }
  }
  CHECK(history.answer(0, 0, at + 1e-3 * u, origin, n, -1.0).traction.norm() == 0.0);
}

TEST_CASE("a plate pressed askew on a thin layer sticks with the layer's shear or slides with Coulomb's share") {
  // Without lateral contraction (lambda = 0) a thin bonded layer has the stiffness 2 mu / h along z and mu / h along x:
  // while it sticks, a plate that comes at the angle a has the friction ½ tan a per normal force; when that is more
  // than the coefficient, it slides with the coefficient.
  const Vec3d half(8e-3, 8e-3, 0.5e-3);
  const auto [body, mesh] = test::symmetric_block(half, test::even(8), test::even(8), test::even(1));
  const double angle = 30.0 * pi / 180, stuck = 0.5 * std::tan(angle);
  for (double mu : {0.0, 0.1, 0.2, 1.0}) {
    FastSimulator sim{NeoHookean{1e5, 0.0}, SDFContact{1e11, mu}};
    Scenario<Box> s{Box{{40e-3, 40e-3, 10e-3}, 1e-3}, angle, 0.0, {0.2, 0.5}};
    const auto states = sim.press(body, mesh, s);
    REQUIRE(states.size() == 2);
    for (const MechanicalState& state : states) {
      INFO("mu " << mu << " load " << state.load_N << " status " << to_string(state.status) << " iterations "
                 << state.iterations << " residual " << state.residual_N);
      REQUIRE(state.status == Status::converged);
      CHECK(state.certified);
      if (mu == 0.0) {
        CHECK(state.friction_N.empty());
        continue;
      }
      const Vec3d f = friction_of(state);
      // F = N cos a + T sin a on the indenter's line.
      const double T = std::abs(f.x()), N = (state.force_N - T * std::sin(angle)) / std::cos(angle);
      CHECK(f.x() < 0.0);  // along with the tool, which goes to −x
      CHECK(std::abs(f.y()) < 1e-6);
      // Towards its free ends, about as long as it is thick, the layer bears less shear: one in sixteen at most.
      // Sliding knows no such ends.
      CHECK(T / N == Approx(std::min(mu, stuck)).epsilon(mu < stuck ? 0.005 : 0.04));
      CHECK(state.friction_push_N == Approx(f.dot(s.direction())));
    }
  }
}

TEST_CASE("a flat punch that sticks is stiffer than a smooth one by Mossakovskii's factor") {
  // F_stick / F_smooth = (1 − nu) ln(3 − 4 nu) / (1 − 2 nu): ln 3 at nu = 0 (Mossakovskii 1963; Johnson 1985, §3.7).
  const double a = 1e-3;
  Body body = test::block_to_mesh(Vec3d::Constant(20e-3), 0.1e-3, 0.12, 8e-3);
  body.sizing.edge = [=](const Vec3d& p) {
    const double rim = std::hypot(std::hypot(p.x(), p.y()) - a, p.z() - 20e-3);
    return std::min(8e-3, 0.08e-3 + 0.35 * rim);
  };
  const TetMesh mesh = mesh_body(body, TetgenMesher{});
  const auto stiffness = [&](double mu) {
    const FastSimulator sim{NeoHookean{1e5, 0.0}, SDFContact{3e12, mu}};
    const auto states = sim.press(body, mesh, Scenario<Cylinder>{Cylinder{2 * a, 4e-3, 0.05 * a}, 0.0, 0.0, {0.002}});
    REQUIRE(states.front().status == Status::converged);
    return states.front().force_N / states.front().depth_m;
  };
  const double ratio = stiffness(8.0) / stiffness(0.0);
  INFO(ratio);
  CHECK(ratio == Approx(std::log(3.0)).epsilon(0.025));
}

TEST_CASE("half and quarter models carry the whole body's friction") {
  const auto [body, whole] =
      test::symmetric_block(Vec3d(6e-3, 6e-3, 4e-3), test::even(4), test::even(4), test::even(3));
  const FastSimulator sim{NeoHookean{1e5, 2e6}, SDFContact{1e10, 0.5}};
  const Scenario<Sphere> s{Sphere{10e-3}, 0.0, 0.0, {0.5, 1.0}};
  TetMesh plain = whole;
  plain.symmetry = {};
  const auto folded = sim.press(body, whole, s), full = sim.press(body, plain, s);
  const auto smooth = FastSimulator{NeoHookean{1e5, 2e6}, SDFContact{1e10}}.press(body, whole, s);
  for (std::size_t k = 0; k < 2; ++k) {
    REQUIRE(folded[k].status == Status::converged);
    REQUIRE(full[k].status == Status::converged);
    CHECK(folded[k].depth_m == Approx(full[k].depth_m).epsilon(1e-4));
    CHECK(folded[k].friction_push_N == Approx(full[k].friction_push_N).epsilon(1e-2).margin(1e-5));
    CHECK(friction_of(folded[k]).head<2>().norm() < 1e-6);
    CHECK(folded[k].depth_m < smooth[k].depth_m);
  }
}

TEST_CASE("contact at vertices has the friction too, and the law's bounds") {
  const auto [body, mesh] =
      test::symmetric_block(Vec3d(6e-3, 6e-3, 4e-3), test::even(6), test::even(6), test::even(4), 1);
  const Simulator<NeoHookean, VertexContact, LinearTet, QuasiStatic<Cholmod>> sim{
      NeoHookean{1e5, 2e6}, VertexContact{1e10, 0.5}};
  const auto states = sim.press(body, mesh, Scenario<Sphere>{Sphere{10e-3}, 20 * pi / 180, 0.0, {0.5, 1.0}});
  for (const MechanicalState& s : states) {
    REQUIRE(s.status == Status::converged);
    REQUIRE_FALSE(s.friction_N.empty());
    double most = 0.0, total = 0.0;
    for (std::size_t n = 0; n < s.friction_N.size(); ++n) {
      total += s.friction_N[n].norm();
      most = std::max(most, s.friction_N[n].norm());
    }
    CHECK(most > 0.0);
    CHECK(total <= 0.5 * s.force_N / std::cos(20 * pi / 180) * 1.1);
  }
}

TEST_CASE("a point slips from where it comes into contact, not from the last equilibrium") {
  const Vec3d size(2e-3, 2e-3, 1e-3);
  const Body body = test::block_body(size);
  const TetMesh mesh = test::block_mesh(size, test::even(1), test::even(1), test::even(1), 1, false);
  const SDFContact law{1e10, 0.4};
  const ContactSurface surface(mesh, body, [](const Patch& p) { return p.contactable; });
  const Box plate{{40e-3, 40e-3, 10e-3}, 1e-3};
  const Vec3d askew = Vec3d(-1.0, 0.0, -2.0).normalized(), up = Vec3d::UnitZ();
  const double open = 5e-5, pressure = 1e9, stiff = 3e9;
  Moving<Box> tool{&plate, Vec3d(1e-3, 1e-3, 1e-3 + open + 5e-3), askew};
  const FrictionHistory history(surface, law, law.friction, positions_of(mesh), tool);
  const Vec3d at = history.points[0][0].place;
  REQUIRE(history.points[0][0].gap == Approx(open));
  const double way = open / -askew.z(), advance = 3.0 * way;
  REQUIRE(history.points[0][0].ahead == Approx(way).margin(2e-9));
  // Carried along since they met, the point has not slipped; held in place, by what the tool went since, to the side.
  const auto carried = history.answer(0, 0, at + (advance - way) * askew, tool.origin + advance * askew, up, pressure);
  CHECK(carried.traction.norm() < 2e-9 * stiff);
  const auto held = history.answer(0, 0, at, tool.origin + advance * askew, up, pressure);
  CHECK(held.traction.x() == Approx(stiff * (advance - way) * askew.x()).epsilon(1e-4));
  CHECK(std::abs(held.traction.y()) < 1e-12 * stiff);

  // On what does not move, the way beyond the surface counts: a fifth of one that closes 4/5 of its normal part.
  tool.direction = Vec3d::Zero();
  const FrictionHistory on_carrier(surface, law, law.friction, positions_of(mesh), tool);
  const Vec3d motion(2e-5, 0.0, 1.25 * open);
  const auto rested = on_carrier.answer(0, 0, at + motion, tool.origin, -up, pressure);
  CHECK(rested.traction.x() == Approx(-stiff * 0.2 * motion.x()));
  CHECK(on_carrier.answer(0, 0, at + Vec3d(2e-5, 0.0, 0.5 * open), tool.origin, -up, pressure).traction.norm() == 0.0);
}

TEST_CASE("a ball pressed obliquely sticks as Mindlin has it, however many loads are asked on the way") {
  // Sticking all over, T/N = 2 (1 - nu) / (2 - nu) tan a, and N grows as the depth to 3/2 (Mindlin, Deresiewicz 1953).
  const double angle = 30.0 * pi / 180, load = 0.1, nu = 0.495, mu = 106e3;
  const Body body = test::block_to_mesh(Vec3d::Constant(60e-3), 20e-3, 0.2, 20e-3);
  const Scenario<Sphere> last{Sphere{20e-3}, angle, 0.0, {load}};
  const TetgenMesher mesher;
  const TetMesh mesh =
      mesh_for_contact(body, mesh_body(body, mesher), std::vector{last}, mesher, Focus{0.2e-3, 0.25, 0.7});
  const auto pressed = [&](double friction, const std::vector<double>& loads) {
    const FastSimulator sim{NeoHookean{mu, 99 * mu}, SDFContact{1e11, friction}};
    const auto states = sim.press(body, mesh, Scenario<Sphere>{Sphere{20e-3}, angle, 0.0, loads});
    REQUIRE(states.back().status == Status::converged);
    return states.back();
  };
  const double slick = pressed(0.0, {load}).depth_m;
  const double ratio = 2 * (1 - nu) / (2 - nu), t = std::tan(angle),
               N = load / (std::cos(angle) + ratio * t * std::sin(angle));
  std::vector<double> forces;
  for (const int asked : {1, 6}) {
    std::vector<double> loads;
    for (int k = asked; k-- > 0;) loads.push_back(load * std::pow(0.01, double(k) / asked));
    const MechanicalState end = pressed(1.0, loads);
    forces.push_back(-friction_of(end).x());
    CHECK(forces.back() == Approx(ratio * t * N).epsilon(0.03));
    CHECK(end.depth_m / slick == Approx(std::pow(std::cos(angle) * N / load, 2.0 / 3.0)).epsilon(0.01));
  }
  CHECK(forces[0] == Approx(forces[1]).epsilon(0.01));
}
