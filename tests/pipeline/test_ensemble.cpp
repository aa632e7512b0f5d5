#include "catch.hpp"
#include "lumo/pipeline/ensemble.hpp"

using namespace lumo;

TEST_CASE(
    "the paper's ensembles have 28 and 140 scenarios: without mirror images 16 and 48 solves on 4 and 12 meshes") {
  const auto count = [](const Ensemble& e, Symmetry s) {
    const auto scenarios = e.scenarios();
    const ContactPlan p = plan_contacts(scenarios, s);
    CHECK(p.images.size() == scenarios.size());
    for (std::size_t k = 0; k < p.images.size(); ++k) {
      const auto &given = scenarios[k], &solved = p.solves[p.images[k].solve].scenario;
      CHECK(solved.indenter == given.indenter);
      CHECK((p.images[k].mirror.x ? -1.0 : 1.0) * solved.angle_rad == given.angle_rad);
      CHECK((p.images[k].mirror.y ? -1.0 : 1.0) * solved.y_m == given.y_m);
    }
    return std::pair(p.solves.size(), p.places.size());
  };
  CHECK(flat_ensemble().scenarios().size() == 28);
  CHECK(curved_ensemble().scenarios().size() == 140);
  CHECK(count(flat_ensemble(), {true, true}) == std::pair<std::size_t, std::size_t>(16, 4));
  CHECK(count(curved_ensemble(), {true, true}) == std::pair<std::size_t, std::size_t>(48, 12));
  CHECK(count(flat_ensemble(), {false, false}) == std::pair<std::size_t, std::size_t>(28, 7));
  CHECK(plan_contacts(flat_ensemble().scenarios(), {true, true}, {}).solves.size() == 28);
}

TEST_CASE("the authors' ensembles have 21 and 75 scenarios, and on a finger with unequal ends 21 and 45 solves") {
  const Ensemble flat = authors_flat_ensemble(), curved = authors_curved_ensemble();
  CHECK(flat.scenarios().size() == 21);
  CHECK(curved.scenarios().size() == 75);
  CHECK(plan_contacts(flat.scenarios(), {true, false}).solves.size() == 21);
  CHECK(plan_contacts(curved.scenarios(), {true, false}).solves.size() == 45);
  CHECK(flat.loads_N == std::vector<double>{1.0, 2.0, 5.0, 10.0});
  CHECK(flat.places_m == flat_ensemble().places_m);
  CHECK(curved.places_m == std::vector<double>{-11e-3, -5.5e-3, 0.0, 5.5e-3, 11e-3});
}

TEST_CASE("contacts off the plane x = 0 are mirrored together with their angle") {
  std::vector<Scenario<Sphere>> scenarios;
  for (const TiltPlane tilt : {TiltPlane::xz, TiltPlane::yz})
    for (const double angle : {-0.5, 0.0, 0.5})
      for (const double x : {-3e-3, 3e-3}) scenarios.push_back({Sphere{10e-3}, angle, 0.0, {1.0}, tilt, x});
  const ContactPlan p = plan_contacts(scenarios, {true, true});
  CHECK(p.solves.size() == 5);  // across 0 and ±0.5, along 0 and 0.5; all at +3 mm but one
  for (std::size_t k = 0; k < scenarios.size(); ++k) {
    CHECK(mirrored(p.solves[p.images[k].solve].scenario, p.images[k].mirror) == scenarios[k]);
    CHECK_FALSE(symmetry_of(scenarios[k]).x);
  }
  CHECK(plan_contacts(scenarios, {false, true}).solves.size() == 10);
  scenarios[0].x_m = 20.0;
  CHECK_THROWS_WITH(plan_contacts(scenarios, {true, true}), Catch::Contains("contact place x is 20000 mm"));
}

TEST_CASE("contacts tilted along the finger are mirrored together with their place") {
  Ensemble e;
  e.tilt = TiltPlane::yz;
  e.diameters_m = {10e-3};
  e.angles_rad = {-0.5, 0.0, 0.5};
  e.places_m = {-22e-3, 0.0, 22e-3};
  const auto scenarios = e.scenarios();
  const ContactPlan p = plan_contacts(scenarios, {true, true});
  CHECK(p.solves.size() == 5);  // −0.5 at 22 mm is no image of 0.5 there
  CHECK(p.places.size() == 5);
  for (std::size_t k = 0; k < scenarios.size(); ++k) {
    CHECK_FALSE(p.images[k].mirror.x);
    CHECK(mirrored(p.solves[p.images[k].solve].scenario, p.images[k].mirror) == scenarios[k]);
    CHECK(symmetry_of(scenarios[k]) == Symmetry{true, scenarios[k].y_m == 0.0 && scenarios[k].angle_rad == 0.0});
    const Vec3d image = mirrored(scenarios[k], {false, true}).direction(), given = scenarios[k].direction();
    CHECK(image == given.cwiseProduct(Vec3d(1, -1, 1)));
  }
  CHECK(plan_contacts(scenarios, {true, false}).solves.size() == 9);
}
