#pragma once

#include "lumo/mechanics/contact/carrier.hpp"
#include "lumo/mechanics/contact/contact_surface.hpp"
#include "lumo/mechanics/elements/element.hpp"
#include "lumo/mechanics/solvers/press_solver.hpp"
#include "lumo/mechanics/solvers/vertex_block.hpp"
#include "lumo/mechanics/solvers/vertex_packs.hpp"
#include "lumo/mesh/sector.hpp"

#include <cmath>
#include <optional>

namespace lumo {

/// Where the sweeps of a time step begin.
enum class Predictor {
  position,     ///< where the last step ended
  inertia,      ///< as if nothing held it: x + v Δt, as Newton 1.8 does
  acceleration  ///< as if the last step's acceleration went on: x + v Δt + a Δt² (Chen et al. 2024, without their clamp
                ///< to gravity)
};

/// Settings of vertex block descent; the defaults are the paper's.
struct DescentConfig {
  double time_step_s = 0.01;
  int sweeps = 10;  ///< per time step
  Predictor predictor = Predictor::inertia;
  double density_kg_per_m3 = 1070.0;  ///< Dragon Skin
  double viscosity_Pa_s = 10.0;       ///< η on the rate of C = FᵀF
  double speed_m_per_s = 5e-3;        ///< of the indenter's advance
  double hold_s = 1.0;                ///< at each load
  double slip_speed_m_per_s = 1e-2;   ///< below it friction is smooth
  double detection_m = 1e-3;          ///< points nearer than this at a step's start are watched during the step
  double max_advance_m = 20e-3;       ///< a load that is not met by then is given up
  double time_limit_s = 1e9;          ///< per scenario, wall clock
  bool packs = true;                  ///< eight vertices of a color at once, where material and element allow it
  VertexColors colors = {};           ///< empty: color_vertices
  PressWatch watch = {};              ///< called after each time step, and as a load ends
};

/// Throws InvalidArgument for settings out of range.
inline void validate(const DescentConfig& c) {
  require_in_range("time step", c.time_step_s, 1e-6, 1.0, "s");
  require_in_range("sweeps", c.sweeps, 1, 1e6, "");
  require_in_range("density", c.density_kg_per_m3, 1.0, 1e5, "kg/m3");
  require_in_range("viscosity", c.viscosity_Pa_s, 0.0, 1e6, "Pa s");
  require_in_range("speed of the indenter", c.speed_m_per_s * 1e3, 1e-3, 1e3, "mm/s");
  require_in_range("time of a hold", c.hold_s, 0.0, 1e3, "s");
  require_in_range("slip speed", c.slip_speed_m_per_s, 1e-9, 1e3, "m/s");
  require_in_range("distance at which contact is watched", c.detection_m * 1e3, 1e-3, 100.0, "mm");
  require_in_range("largest advance", c.max_advance_m * 1e3, 1e-3, 1e3, "mm");
  require_in_range("time limit of a scenario", c.time_limit_s, 0.0, 1e12, "s");
}

namespace detail {

struct NoPacks {
  struct Start {};
};
template <class Material, class Element> struct PacksFor { using type = NoPacks; };
template <DilatationalMaterial Material> struct PacksFor<Material, LinearTet> { using type = VertexPacks<Material>; };

}  // namespace detail

/// All that does not change between scenarios on one mesh: masses, colors, elements, surfaces.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element> struct DescentModel {
  using Packs = typename detail::PacksFor<Material, Element>::type;
  static constexpr bool batched = !std::same_as<Packs, detail::NoPacks>;

  Sector sector;
  Contact contact;
  VertexElasticity<Material, Element> elasticity;
  ContactSurface touchable;  ///< against the indenter
  ContactSurface resting;    ///< against the carrier
  Carrier carrier;
  std::vector<double> mass;  ///< per node [kg]
  std::vector<char> moves;   ///< per node: it is not bonded
  VertexColors colors;       ///< of the nodes that move
  bool resists_inversion;    ///< the material's energy has no bound where J ≤ 0

  std::optional<Packs> packs;  ///< where they are asked for

  /// Throws InvalidArgument when the given colors are none.
  DescentModel(const Body& body, const TetMesh& mesh, Symmetry planes,
      const PressPhysics<Material, Contact, Element>& physics, const DescentConfig& config)
      : sector(sector_of(mesh, planes)),
        contact(physics.contact),
        elasticity(sector.mesh, physics.material, physics.element),
        touchable(
            sector.mesh, body, [](const Patch& p) { return p.contactable; }, contact),
        resting(
            sector.mesh, body, [](const Patch& p) { return p.meets_carrier; }, contact),
        carrier{body.carrier},
        mass(lumped_masses<Element>(sector.mesh, config.density_kg_per_m3)),
        moves(sector.mesh.nodes.size(), 1),
        resists_inversion(!std::isfinite(energy_density(physics.material, Mat3d(-Mat3d::Identity())))) {
    for (const BoundaryFace& f : sector.mesh.faces)
      if (body.patches[std::size_t(f.patch)].bonded)
        for (int k = 0; k < sector.mesh.nodes_per_face(); ++k) moves[std::size_t(f.nodes[std::size_t(k)])] = 0;
    const VertexColors all = config.colors.empty() ? color_vertices(sector.mesh) : config.colors;
    validate(all, sector.mesh);
    for (const std::vector<int>& color : all) {
      colors.emplace_back();
      for (int v : color)
        if (moves[std::size_t(v)]) colors.back().push_back(v);
    }
    if constexpr (batched)
      if (config.packs) packs.emplace(sector.mesh, elasticity, colors);
  }
  DescentModel(const DescentModel&) = delete;  // elements and surfaces point into the sector's mesh
  DescentModel& operator=(const DescentModel&) = delete;
};

}  // namespace lumo
