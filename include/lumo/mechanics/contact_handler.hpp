#pragma once

#include "lumo/core/error.hpp"

#include <concepts>

namespace lumo {

/// What a contact law answers to a gap [m]: energy per reference area [J/m²], pressure [Pa] = −dE/dg, stiffness [N/m³] = d²E/dg².
struct ContactResponse {
  double energy;
  double pressure;
  double stiffness;
};

/// A frictionless contact law between the body's surface and a rigid surface.
/// Laws: no pressure at gaps ≥ 0; pressure ≥ 0; pressure and stiffness are the derivatives of the energy.
template <class C>
concept ContactHandler = requires(const C& contact, double gap) {
  { contact.respond(gap) } -> std::convertible_to<ContactResponse>;
  { contact.stiffness_N_per_m3 } -> std::convertible_to<double>;
  validate(contact);
};

/// Penalty on the signed distance, over the full surface (points inside faces, not only vertices), per reference area.
/// Source: paper §III-B ("signed-distance full-surface rigid–soft collision").
struct SDFContact {
  double stiffness_N_per_m3 = 1e11;  ///< overlap at 0.3 MPa is 3 µm

  ContactResponse respond(double gap) const {
    if (gap >= 0.0) return {0.0, 0.0, 0.0};
    return {0.5 * stiffness_N_per_m3 * gap * gap, -stiffness_N_per_m3 * gap, stiffness_N_per_m3};
  }
};

inline void validate(const SDFContact& c) { require_in_range("contact stiffness", c.stiffness_N_per_m3, 1e6, 1e15, "N/m3"); }

static_assert(ContactHandler<SDFContact>);

/// A contact law with all its pressures multiplied by a factor.
template <class Contact>
struct Firmness {
  const Contact* law;
  double factor;
  double stiffness_N_per_m3 = factor * law->stiffness_N_per_m3;

  ContactResponse respond(double gap) const {
    const ContactResponse r = law->respond(gap);
    return {factor * r.energy, factor * r.pressure, factor * r.stiffness};
  }
};

template <class Contact>
void validate(const Firmness<Contact>& c) {
  validate(*c.law);
  require_in_range("factor on contact pressures", c.factor, 1e-6, 1e6, "");
}

static_assert(ContactHandler<Firmness<SDFContact>>);

}  // namespace lumo
