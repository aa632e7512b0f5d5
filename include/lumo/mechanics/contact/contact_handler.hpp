#pragma once

#include "lumo/core/error.hpp"

#include <concepts>
#include <optional>

namespace lumo {

/// Response of a contact law to a gap [m]: energy per reference area [J/m²], pressure [Pa] = −dE/dg, stiffness [N/m³]
/// = d²E/dg².
template <class S> struct ContactResponse {
  S energy;
  S pressure;
  S stiffness;
};

/// A contact law between the body's surface and a rigid surface. It is frictionless unless it has a `friction`,
/// Coulomb's coefficient, and acts all over the surface unless it has `points`. Laws: no pressure at gaps ≥ 0; pressure
/// ≥ 0; pressure and stiffness are the derivatives of the energy. The gap is a double, or a deduced scalar.
template <class C>
concept ContactHandler = requires(const C& contact, double gap) {
  { contact.respond(gap) } -> std::convertible_to<ContactResponse<double>>;
  { contact.stiffness_N_per_m3 } -> std::convertible_to<double>;
  validate(contact);
};

/// Where a contact law acts: at many points inside all faces, or at the mesh's nodes, each with its share of the area.
enum class ContactPoints { surface, vertices };

template <ContactHandler Contact> constexpr ContactPoints contact_points() {
  if constexpr (requires {
                  { Contact::points } -> std::convertible_to<ContactPoints>;
                })
    return Contact::points;
  else return ContactPoints::surface;
}

/// Coulomb's coefficient of a law; 0 where it has none.
template <ContactHandler Contact> double friction_coefficient(const Contact& contact) {
  if constexpr (requires { contact.friction; }) return contact.friction;
  else return 0.0;
}

/// The same with the carrier: as with the tool, unless the law has one of its own.
template <ContactHandler Contact> double carrier_friction(const Contact& contact) {
  if constexpr (requires { contact.carrier_friction; })
    return contact.carrier_friction.value_or(friction_coefficient(contact));
  else return friction_coefficient(contact);
}

/// Area [m²] that the law gives each vertex instead of its share of the surface; 0: its share.
template <ContactHandler Contact> double area_per_vertex(const Contact& contact) {
  if constexpr (requires { contact.area_per_vertex_m2; }) return contact.area_per_vertex_m2;
  else return 0.0;
}

/// How near [m] a sub-triangle of the surface must come to a tool to belong to the contact set, as a collision pipeline
/// records it, with force or without; 0: the set is where the surface touches.
template <ContactHandler Contact> double record_margin(const Contact& contact) {
  if constexpr (requires { contact.record_margin_m; }) return contact.record_margin_m;
  else return 0.0;
}

/// Response of a spring of `stiffness` [N/m³] to a gap; 0 while it is open.
template <class S> ContactResponse<S> penalty(double stiffness, const S& gap) {
  if (gap >= 0.0) return {0.0, 0.0, 0.0};
  return {0.5 * stiffness * gap * gap, -stiffness * gap, stiffness};
}

/// Penalty on the signed distance, over the full surface (points inside faces, not only vertices), per reference area.
/// Source: paper §III-B ("signed-distance full-surface rigid–soft collision").
struct SDFContact {
  double stiffness_N_per_m3 = 1e11;             ///< overlap at 0.3 MPa is 3 µm
  double friction = 0.0;                        ///< Coulomb's coefficient
  double record_margin_m = 0.0;                 ///< see record_margin
  std::optional<double> carrier_friction = {};  ///< Coulomb's coefficient with the carrier; nullopt: `friction`

  template <class S> ContactResponse<S> respond(const S& gap) const { return penalty(stiffness_N_per_m3, gap); }
};

inline void validate(const SDFContact& c) {
  require_in_range("contact stiffness", c.stiffness_N_per_m3, 1e6, 1e15, "N/m3");
  require_in_range("friction coefficient", c.friction, 0.0, 10.0, "");
  require_in_range("margin of contact records", c.record_margin_m * 1e3, 0.0, 10.0, "mm");
  require_in_range("friction coefficient of the carrier", carrier_friction(c), 0.0, 10.0, "");
}

static_assert(ContactHandler<SDFContact>);

/// A contact law with its penalty stiffness scaled.
template <class Contact> struct ScaledContact {
  const Contact* law;
  double scale;
  double stiffness_N_per_m3 = scale * law->stiffness_N_per_m3;
  double friction = friction_coefficient(*law);
  static constexpr ContactPoints points = contact_points<Contact>();

  template <class S> ContactResponse<S> respond(const S& gap) const {
    const ContactResponse<S> r = law->respond(gap);
    return {scale * r.energy, scale * r.pressure, scale * r.stiffness};
  }
};

template <class Contact> void validate(const ScaledContact<Contact>& c) {
  validate(*c.law);
  require_in_range("factor on contact pressures", c.scale, 1e-6, 1e6, "");
}

static_assert(ContactHandler<ScaledContact<SDFContact>>);

/// Penalty at the mesh's nodes with Coulomb friction, as Newton 1.8 has it: faces may overlap the indenter between
/// their nodes. A solver that goes in time steps takes each node's tangent plane of the indenter at the step's start
/// (`plane_frozen`). Newton's stiffness k_e [N/m] belongs to a vertex, whatever its share of the surface: that is
/// stiffness_N_per_m3 · area_per_vertex_m2.
struct VertexContact {
  static constexpr ContactPoints points = ContactPoints::vertices;
  static constexpr bool plane_frozen = true;
  double stiffness_N_per_m3 = 1e11;
  double friction = 0.5;                        ///< Coulomb's coefficient
  double area_per_vertex_m2 = 0.0;              ///< the same for all; 0: each vertex has its share of the surface
  double record_margin_m = 0.0;                 ///< see record_margin
  std::optional<double> carrier_friction = {};  ///< with the carrier; nullopt: `friction`

  template <class S> ContactResponse<S> respond(const S& gap) const { return penalty(stiffness_N_per_m3, gap); }
};

inline void validate(const VertexContact& c) {
  require_in_range("contact stiffness", c.stiffness_N_per_m3, 1e6, 1e15, "N/m3");
  require_in_range("friction coefficient", c.friction, 0.0, 10.0, "");
  require_in_range("contact area per vertex", c.area_per_vertex_m2 * 1e6, 0.0, 1e6, "mm2");
  require_in_range("margin of contact records", c.record_margin_m * 1e3, 0.0, 10.0, "mm");
  require_in_range("friction coefficient of the carrier", carrier_friction(c), 0.0, 10.0, "");
}

static_assert(ContactHandler<VertexContact>);

}  // namespace lumo
