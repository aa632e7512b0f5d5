#pragma once

#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/pipeline/evaluate.hpp"
#include "lumo/support/cholmod.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/tetgen.hpp"

using CoarseLight = lumo::Tracer<lumo::BeerLambert, lumo::ExitPower, lumo::Embree>;
using CoarsePipeline = lumo::Pipeline<lumo::TetgenMesher,
    lumo::Simulator<lumo::NeoHookean, lumo::SDFContact, lumo::QuadraticTet, lumo::QuasiStatic<lumo::Cholmod>>,
    CoarseLight>;

/// Coarse in every respect: for contracts between stages.
inline CoarsePipeline coarse_pipeline() {
  CoarseLight::Config light;
  light.rays_per_emitter = 1 << 12;
  light.carrier_rays = 1 << 14;
  light.exit_rays = 1 << 16;
  CoarsePipeline p{lumo::TetgenMesher{}, {}, CoarseLight{light}};
  p.focus = {1.2e-3, 0.4, 1.0};
  p.rays.rounds = 0;
  p.optical_error.area = 0.0;
  return p;
}

inline lumo::FingerOptions coarse_finger() {
  lumo::FingerOptions o = lumo::plain_finger();
  o.mesh.contact_edge = o.mesh.coarsest_edge = 6e-3;
  return o;
}
