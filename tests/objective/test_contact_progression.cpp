#include "catch.hpp"
#include "lumo/objective/contact_progression.hpp"

#include "mechanics/bodies.hpp"

using namespace lumo;

namespace {

/// A block whose top carries given contact discs: terms with known values.
struct Made {
  Body body;
  TetMesh mesh;
  std::vector<MechanicalState> states;

  Made()
      : body(test::block_body(Vec3d(20e-3, 20e-3, 2e-3))),
        mesh(test::block_mesh(Vec3d(20e-3, 20e-3, 2e-3), test::even(20), test::even(20), test::even(1), 2, false)) {}
  void add(double load, double depth, double radius, double area) {
    MechanicalState s;
    s.status = Status::converged;
    s.load_N = s.force_N = load;
    s.depth_m = depth;
    s.contact_area_m2 = area;
    s.energy_error = 0.01;
    s.spots = {{.force_N = load, .area_m2 = area, .rim_m = 2.0 * area / radius, .edge_m = 0.2 * radius}};
    for (const Vec3d& p : mesh.nodes) s.contact_field.push_back(radius - std::hypot(p.x() - 10e-3, p.y() - 10e-3));
    states.push_back(s);
  }
};

}  // namespace

TEST_CASE("the three contact terms and their geometric mean follow the paper's equations") {
  Made m;
  m.add(1, 1.0e-3, 2e-3, 12e-6);
  m.add(2, 1.5e-3, 3e-3, 28e-6);
  m.add(5, 2.5e-3, 4e-3, 50e-6);
  m.add(10, 3.0e-3, 6e-3, 110e-6);
  const ContactTerms q = contact_terms(m.body, m.mesh, m.states, 5e-3);
  REQUIRE(q.form);
  REQUIRE(q.stable);
  REQUIRE(q.stiff);
  CHECK(q.form->value == Approx(std::sqrt(28.0 / (pi * 25.0))));
  CHECK(q.stable->value == Approx(9.0 / 36.0).epsilon(0.02));  // nested discs
  CHECK(q.stiff->value == Approx(1.0 - (1.0 / 0.5e-3) / (5.0 / 0.5e-3)));
  CHECK(q.score()->value == Approx(std::cbrt(q.form->value * q.stable->value * q.stiff->value)));
  CHECK(q.score()->error > 0.0);
  CHECK(q.score()->error < 0.05);
}

TEST_CASE("an indenter that did not move on between two loads leaves the stiffness undefined") {
  Made m;
  m.add(1, 1.0e-3, 2e-3, 12e-6);
  m.add(2, 1.0e-3, 3e-3, 28e-6);  // its force rose while it was held
  m.add(5, 2.5e-3, 4e-3, 50e-6);
  m.add(10, 3.0e-3, 6e-3, 110e-6);
  CHECK_FALSE(contact_terms(m.body, m.mesh, m.states, 5e-3).stiff);
  m.states[1].depth_m = 1.2e-3;
  m.states[3].depth_m = m.states[2].depth_m;
  const ContactTerms q = contact_terms(m.body, m.mesh, m.states, 5e-3);
  CHECK_FALSE(q.stiff);
  CHECK(q.form);
  CHECK(q.stable);
  CHECK_FALSE(q.score());
}

TEST_CASE("terms are clipped to [0, 1], and a patch that is more than full has no error from its area") {
  Made m;
  m.add(1, 1.0e-3, 2e-3, 12e-6);
  m.add(2, 1.1e-3, 3e-3, 1.0);
  m.add(5, 2.5e-3, 4e-3, 50e-6);
  m.add(10, 9.0e-3, 6e-3, 110e-6);  // softer late than early
  const ContactTerms q = contact_terms(m.body, m.mesh, m.states, 5e-3);
  CHECK(q.form->value == 1.0);
  CHECK(q.form->error == 0.0);
  CHECK(q.stiff->value == 0.0);
  CHECK(q.score()->value == 0.0);
  CHECK(std::isfinite(q.score()->error));
}

TEST_CASE("a term that is just cut off keeps the error that reaches back over the edge") {
  Made m;
  m.add(1, 1.0e-3, 2e-3, 12e-6);
  m.add(2, 1.5e-3, 3e-3, 28e-6);
  m.add(5, 2.5e-3, 4e-3, 50e-6);
  m.add(10, 5.004e-3, 6e-3, 110e-6);  // 2 N/mm early, 1.997 N/mm late
  const Estimate stiff = *contact_terms(m.body, m.mesh, m.states, 5e-3).stiff;
  CHECK(stiff.value == 0.0);
  CHECK(stiff.error ==
        Approx(std::sqrt(2.0) * MechanicalError{}.stiffness * 0.01 * (5.008 / 5.0) - 0.008 / 5.0).epsilon(1e-3));
}

TEST_CASE("errors grow with the edges over the contact's radius, and with what presses outside of the contact") {
  const MechanicalError error;
  ContactSpot spot{.force_N = 2.0, .area_m2 = pi * 4e-6, .rim_m = 4e-3 * pi, .edge_m = 0.2e-3};
  CHECK(spot.radius_m() == Approx(2e-3));
  const double fine = error.of_area(spot);
  CHECK(fine == Approx(error.area * std::pow(0.1, error.area_power)));
  spot.edge_m = 0.4e-3;
  CHECK(error.of_area(spot) > 2.0 * fine);
  spot.force_outside_N = 0.1;
  CHECK(error.of_area(spot) > 0.1);
  CHECK(error.wanted_edge(spot) == spot.edge_m);
  spot.edge_m = 3e-3;
  CHECK(error.wanted_edge(spot) < 0.3 * spot.radius_m());
  spot.area_m2 = 0.0;
  CHECK(error.of_area(spot) == 1.0);
}

TEST_CASE("terms of a contact that its mesh does not resolve are empty, and the contact is named") {
  Made m;
  m.add(1, 1.0e-3, 2e-3, 12e-6);
  m.add(2, 1.5e-3, 3e-3, 28e-6);
  m.add(5, 2.5e-3, 4e-3, 50e-6);
  m.add(10, 3.0e-3, 6e-3, 110e-6);
  m.states[1].spots.push_back({.force_N = 0.1, .area_m2 = 1e-6, .rim_m = 4e-3, .edge_m = 2e-3});
  const ContactTerms q = contact_terms(m.body, m.mesh, m.states, 5e-3);
  CHECK_FALSE(q.form);
  CHECK_FALSE(q.stable);
  CHECK(q.stiff);
  const auto spot = MechanicalError{}.unresolved_in(m.states[1]);
  REQUIRE(spot);
  CHECK(spot->load_N == 2.0);
  CHECK(spot->radius_m == Approx(0.5e-3));
  CHECK(spot->edge_m == Approx(2e-3));
  m.states[1].spots.back().force_N = 0.01;  // bears next to nothing
  CHECK(contact_terms(m.body, m.mesh, m.states, 5e-3).form);
}

TEST_CASE("what the loads do not define, and what did not converge, is empty") {
  Made m;
  m.add(1, 1.0e-3, 2e-3, 12e-6);
  m.add(2, 1.5e-3, 3e-3, 28e-6);
  ContactTerms q = contact_terms(m.body, m.mesh, m.states, 5e-3);
  CHECK(q.form);
  CHECK_FALSE(q.stable);
  CHECK_FALSE(q.stiff);
  CHECK_FALSE(q.score());
  m.states.back().status = Status::max_iterations;
  CHECK_FALSE(contact_terms(m.body, m.mesh, m.states, 5e-3).form);
}
