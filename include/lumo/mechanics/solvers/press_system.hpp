#pragma once

#include "lumo/mechanics/contact/carrier.hpp"
#include "lumo/mechanics/contact/contact_surface.hpp"
#include "lumo/mechanics/contact/friction.hpp"
#include "lumo/mechanics/elements/equations.hpp"
#include "lumo/mechanics/elements/solid.hpp"
#include "lumo/mechanics/solvers/press_solver.hpp"

namespace lumo {

/// All that does not change between scenarios on one sector of one mesh: elements, surfaces, equations, symbolic
/// factors.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, LinearSolver Linear>
struct SectorModel {
  Sector sector;
  Body body;
  Contact contact;
  Solid<Material, Element> solid;
  ContactSurface touchable;  ///< against the indenter
  ContactSurface resting;    ///< against the carrier
  Carrier carrier;

  /// Equations of one parity with the symbolic factorisation of their tangent.
  struct Block {
    Equations equations;
    Linear analysed;
  };
  std::vector<Block> blocks;  ///< first the even fields, then every other parity of the bounding planes

  SectorModel(
      const Body& b, const TetMesh& mesh, Symmetry planes, const PressPhysics<Material, Contact, Element>& physics)
      : sector(sector_of(mesh, planes)),
        body(b),
        contact(physics.contact),
        solid(sector.mesh, physics.material, physics.element),
        touchable(
            sector.mesh, b, [](const Patch& p) { return p.contactable; }, contact),
        resting(
            sector.mesh, b, [](const Patch& p) { return p.meets_carrier; }, contact),
        carrier{b.carrier} {
    blocks.reserve(4);
    for (int odd = 0; odd < 4; ++odd) {
      const Parity parity{(odd & 1) != 0, (odd & 2) != 0};
      if ((parity.odd_x && !planes.x) || (parity.odd_y && !planes.y)) continue;
      Block block{Equations(sector, body, parity), Linear{}};
      block.analysed.analyze(block.equations.pattern);
      blocks.push_back(std::move(block));
    }
  }
  SectorModel(const SectorModel&) = delete;  // the solid and the surfaces point into the sector's mesh
  SectorModel& operator=(const SectorModel&) = delete;
};

/// One scenario on one sector: energy, forces and tangent of pad and indenter as functions of positions x and advance
/// s. Loads are the sector's share of the whole load.
template <class Model, Indenter Tool> struct PressSystem {
  const Model& model;
  const Tool& tool;
  Vec3d origin;  ///< of the indenter at first touch
  Vec3d direction;
  double penalty_scale = 1.0;                       ///< of all contact pressures; 1 but on the way to equilibrium
  const FrictionHistory* touch_friction = nullptr;  ///< with the indenter
  const FrictionHistory* rest_friction = nullptr;   ///< with the carrier

  ScaledContact<decltype(Model::contact)> contact() const { return {&model.contact, penalty_scale}; }
  Moving<Tool> indenter(double advance) const { return {&tool, origin + advance * direction, direction}; }
  Moving<Carrier> support() const { return {&model.carrier, Vec3d::Zero(), Vec3d::Zero()}; }  ///< stands still

  /// Elastic + contact energy − load · advance [J]; +∞ for an inverted element.
  double energy(const Positions& x, double advance, double load) const {
    const double elastic = model.solid.energy(x);
    if (!std::isfinite(elastic)) return elastic;
    return elastic + add_contact_forces(model.touchable, contact(), indenter(advance), x, nullptr).energy +
           add_contact_forces(model.resting, contact(), support(), x, nullptr).energy - load * advance;
  }

  /// What the stiff parts of the energy, volume and contact, are linearised about; see QuasiStatic.
  struct LinearisationPoint {
    std::vector<double> ratios;
    SurfaceGaps touch, rest;
    /// Share of the carrier's curvature where it touches. What its rounded edges add to the tangent is negative, and
    /// large where pressure is.
    double curvature = 1.0;
  };
  ContactHistory<FrictionHistory> touch_history(const LinearisationPoint* about) const {
    return {about ? &about->touch : nullptr, touch_friction};
  }
  ContactHistory<FrictionHistory> rest_history(const LinearisationPoint* about) const {
    return {about ? &about->rest : nullptr, rest_friction};
  }
  /// A configuration of pad and indenter.
  struct Place {
    Positions x;
    double advance = 0.0;
    VolumeRatios volumes = {};  ///< at x
  };
  /// The values at `now`.
  LinearisationPoint values_at(const Place& now) const {
    return {now.volumes.J, surface_gaps(model.touchable, indenter(now.advance), now.x),
        surface_gaps(model.resting, support(), now.x)};
  }
  /// Those at `now`, carried on by (dx, ds) along the slopes at `linear`; of gaps that stay open only the sign.
  LinearisationPoint predicted(const Place& now, const Place& linear, const Positions& dx, double ds) const {
    using Touching = ContactPlace<Tool>;
    using Resting = ContactPlace<Carrier>;
    LinearisationPoint values{now.volumes.J,
        predicted_gaps(model.touchable, Touching{indenter(now.advance), now.x},
            Touching{indenter(linear.advance), linear.x}, dx, ds),
        predicted_gaps(model.resting, Resting{support(), now.x}, Resting{support(), linear.x}, dx, 0.0)};
    model.solid.carry_on(values.ratios, linear.x, dx);
    return values;
  }

  /// Out-of-balance forces on the free equations and, last, on the indenter: push − load.
  Eigen::VectorXd residual(const Positions& x, double advance, double load, const Equations& eq,
      const LinearisationPoint* about = nullptr) const {
    Positions f = Positions::Zero(3, x.cols());
    model.solid.add_forces(x, f, about ? &about->ratios : nullptr);
    const ContactSums touch =
        add_contact_forces(model.touchable, contact(), indenter(advance), x, &f, touch_history(about));
    add_contact_forces(model.resting, contact(), support(), x, &f, rest_history(about));
    Eigen::VectorXd r(eq.count + 1);
    for (std::size_t i = 0; i < eq.of.size(); ++i)
      if (eq.of[i] >= 0) r[eq.of[i]] = f.data()[i];
    r[eq.count] = touch.push_N - load;
    return r;
  }

  /// Tangents of several parities at once, the coupling of the even one to the advance, and the indenter's own
  /// stiffness.
  struct Tangent {
    std::vector<SparseLower> matrix;  ///< one per block asked for
    Eigen::VectorXd coupling;
    double stiffness = 0.0;
  };
  void tangent(const Positions& x, double advance, std::size_t first, std::size_t last, Tangent& t,
      const LinearisationPoint* about = nullptr) const {
    t.matrix.resize(last - first);
    std::vector<const Equations*> systems;
    std::vector<double*> values;
    for (std::size_t b = first; b < last; ++b) {
      const Equations& eq = model.blocks[b].equations;
      SparseLower& m = t.matrix[b - first];
      if (m.nonZeros() != eq.pattern.nonZeros()) m = eq.pattern;
      std::fill_n(m.valuePtr(), m.nonZeros(), 0.0);
      systems.push_back(&eq);
      values.push_back(m.valuePtr());
    }
    model.solid.add_tangent(x, systems, values, about ? &about->ratios : nullptr);
    for (std::size_t k = 0; k < systems.size(); ++k) {
      const bool even = first + k == 0;
      if (even) t.coupling = Eigen::VectorXd::Zero(systems[k]->count);
      const ContactSums s = add_contact_tangent(model.touchable, contact(), indenter(advance), x,
          {*systems[k], values[k], even ? &t.coupling : nullptr}, touch_history(about));
      if (even) t.stiffness = s.push_stiffness;
      add_contact_tangent(model.resting, contact(), support(), x,
          {*systems[k], values[k], nullptr, about ? about->curvature : 1.0}, rest_history(about));
    }
  }

  /// x moved by a field of the given equations.
  static void move(Positions& x, const Equations& eq, const Eigen::VectorXd& by, double factor) {
    for (std::size_t i = 0; i < eq.of.size(); ++i)
      if (eq.of[i] >= 0) x.data()[i] += factor * by[eq.of[i]];
  }
};

}  // namespace lumo
