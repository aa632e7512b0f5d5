#include "catch.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "mechanics/bodies.hpp"
#include "random_poison.hpp"

using namespace lumo;

namespace {

struct PressInputs {
  Body body = test::block_body(test::small_size);
  TetMesh mesh = test::small_mesh<QuadraticTet>();
  Scenario<Sphere> contact{Sphere{4.0 * test::small_size.x()}, 0.2, 0.5 * test::small_size.y(), {0.01, 0.02},
      TiltPlane::xz, 0.5 * test::small_size.x()};
  Simulator<NeoHookean, SDFContact> simulator{NeoHookean{1e5, 2e6}, SDFContact{}};

  PressInputs() {
    simulator.contact.friction = 0.1;
    simulator.solver.config.time_limit_s = 2.0;
    body.carrier = {{.center = {0.0, 0.0, -1e-2}, .half = {1e-2, 1e-2, 1e-3}, .edge_radius = 1e-4}};
  }
};

test::Poisonable numbers_of(PressInputs& in) {
  test::Poisonable at;
  for (int weight = 0; weight < 20; ++weight) {  // else nearly all would be coordinates
    auto& c = in.simulator.solver.config;
    for (double* x : {&in.contact.indenter.diameter_m, &in.contact.angle_rad, &in.contact.x_m, &in.contact.y_m,
             &in.simulator.material.mu, &in.simulator.material.lambda, &in.simulator.contact.stiffness_N_per_m3,
             &in.simulator.contact.friction, &in.simulator.contact.record_margin_m, &c.residual_tolerance,
             &c.chord_contraction, &c.late_contraction, &c.load_stride, &c.max_advance, &c.time_limit_s,
             &in.body.exact_volume_m3, &in.body.carrier[0].edge_radius})
      at.numbers.push_back(x);
    at.add(in.contact.loads_N);
    at.add(in.body.pivot);
    at.add(in.body.carrier[0].center);
    at.add(in.body.carrier[0].half);
    for (Patch& p : in.body.patches) {
      auto& plane = std::get<Plane>(p.shape);
      at.add(plane.point);
      at.add(plane.direction);
    }
    at.indices.insert(at.indices.end(), {&c.max_iterations, &c.stride_iterations, &in.mesh.order});
  }
  for (Vec3d& n : in.mesh.nodes) at.add(n);
  for (auto& t : in.mesh.tets)
    for (int& n : t) at.indices.push_back(&n);
  for (BoundaryFace& f : in.mesh.faces) {
    for (int& n : f.nodes) at.indices.push_back(&n);
    at.indices.push_back(&f.patch);
  }
  return at;
}

bool finite_press(const PressInputs& in) {
  const auto all_finite = [](const std::vector<Vec3d>& list) {
    return std::all_of(list.begin(), list.end(), [](const Vec3d& v) { return v.allFinite(); });
  };
  for (const MechanicalState& s : in.simulator.press(in.body, in.mesh, in.contact)) {
    for (const double x : {s.force_N, s.depth_m, s.contact_area_m2, s.reference_area_m2, s.residual_N, s.penetration_m,
             s.friction_push_N})
      if (!std::isfinite(x)) return false;
    if (!all_finite(s.displacement) || !all_finite(s.friction_N) || !all_finite(s.traction_Pa)) return false;
    for (const double p : s.pressure_Pa)
      if (!std::isfinite(p)) return false;
    for (const double phi : s.contact_field)
      if (std::isnan(phi) || phi == std::numeric_limits<double>::infinity()) return false;
  }
  return true;
}

void check_poisoned_presses(int count, unsigned seed) {
  const PressInputs sound;
  REQUIRE(finite_press(sound));
  const test::PoisonCount ended = test::poison_at_random(sound, count, seed, numbers_of, finite_press);
  INFO(ended.refused << " refused, " << ended.answered << " answered");
  CHECK(ended.not_finite == 0);
  CHECK(ended.odd == 0);
  CHECK(ended.refused > count / 4);
}

}  // namespace

TEST_CASE("poisoned inputs of a press are refused, or answered by finite numbers") { check_poisoned_presses(300, 1); }

TEST_CASE("ten thousand poisoned presses", "[long]") { check_poisoned_presses(10'000, 2); }
