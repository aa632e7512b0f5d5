#pragma once

#include "catch.hpp"
#include "lumo/mechanics/contact/contact_handler.hpp"
#include "mechanics/dual.hpp"

// One suite for every contact law: the laws that stand beside the concept.
namespace lumo::test {

/// `overlap_m`: about the largest that the law is meant for.
template <ContactHandler C> void check_contact_laws(const C& c, double overlap_m = 10e-6) {
  CHECK_NOTHROW(validate(c));
  for (const double gap : {0.0, 1e-12, 1e-9, 1e-3, 1.0}) {  // nothing acts across a gap
    CHECK(c.respond(gap).energy == 0.0);
    CHECK(c.respond(gap).pressure == 0.0);
    CHECK(c.respond(gap).stiffness == 0.0);
  }
  CHECK(c.stiffness_N_per_m3 > 0.0);
  CHECK(friction_coefficient(c) >= 0.0);
  double pressure = 0.0, energy = 0.0;
  for (const double part : {1e-3, 1e-2, 0.1, 0.3, 1.0}) {
    const double gap = -part * overlap_m, h = 1e-4 * part * overlap_m;
    const ContactResponse<double> at = c.respond(gap), out = c.respond(gap + h), in = c.respond(gap - h);
    CHECK(at.pressure > pressure);  // it pushes, and harder the deeper
    CHECK(at.energy > energy);
    CHECK(-(out.energy - in.energy) / (2.0 * h) == Approx(at.pressure).epsilon(1e-6));
    CHECK(-(out.pressure - in.pressure) / (2.0 * h) == Approx(at.stiffness).epsilon(1e-6));
    if constexpr (requires(const Dual& g) {
                    { c.respond(g) } -> std::same_as<ContactResponse<Dual>>;
                  }) {
      const ContactResponse<Dual> dual = c.respond(Dual(gap, 1.0));
      CHECK(-dual.energy.slope == Approx(at.pressure).epsilon(1e-12));
      CHECK(-dual.pressure.slope == Approx(at.stiffness).epsilon(1e-12));
    }
    pressure = at.pressure;
    energy = at.energy;
  }
  CHECK(c.respond(-1e-9 * overlap_m).pressure < 1e-6 * pressure);  // no jump at first touch
  C broken = c;
  broken.stiffness_N_per_m3 = std::nan("");
  CHECK_THROWS_AS(validate(broken), InvalidArgument);
}

}  // namespace lumo::test
