#pragma once

#include "computing/pad.hpp"
#include "computing/simulation.hpp"
#include "console/progress.hpp"

#include "lumo/optics/scattering_medium.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/pipeline/evaluate.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"

#include <string>
#include <utility>

/// The library's stages as the program puts them together.
namespace lumo::program {

template <ExitReadout Readout> using Light =
    Tracer<ScatteringMedium, Readout, Embree>;  // without scattering, BeerLambert to the last bit

/// Rays as they are asked for.
template <ExitReadout Readout> typename Light<Readout>::Config ray_numbers(const Configuration& o) {
  typename Light<Readout>::Config rays;
  rays.rays_per_emitter = o.light.rays_per_emitter;
  rays.carrier_rays = o.light.carrier_rays;
  rays.exit_rays = o.light.exit_rays;
  return rays;
}

/// Throws InvalidArgument if light is to be observed otherwise than by the side's regions, which only evaluate knows.
inline void require_side_light(const Configuration& o) {
  if (o.observation.by != Observation::By::side)
    throw InvalidArgument("observation.by is not side: camera and photodiodes are for evaluate and study observations");
}

/// Make it before threads start: the mesher forks a helper process.
template <ExitReadout Readout> auto pipeline_for(const Configuration& o, Light<Readout> light) {
  const Mechanics& m = o.mechanics;
  Pipeline<TetgenMesher, AnySimulation, Light<Readout>> p{
      TetgenMesher{}, simulation(m, o.pad.silicone), std::move(light)};
  p.focus = focus_of(o);
  p.mesh_order = m.mesh_order();
  p.refine_once = m.size_mm == 0.0;
  p.accept_held = m.holds();
  p.rays.tolerance = o.light.ray_error_percent / 100.0;
  p.rays.rounds = o.light.rounds;
  p.mirror_once = !m.holds();  // sweeps visit vertices one after the other: what they leave is not its own mirror image
  return p;
}
/// With the light of the side's regions.
inline auto pipeline_for(const Configuration& o) {
  return pipeline_for<ExitPower>(o, Light<ExitPower>(ray_numbers<ExitPower>(o)));
}

/// The stages of a computation, as it reports them.
inline ProgressReport shown_in(Progress& progress) {
  return [&progress, stage = std::string()](std::string_view now, int done, int total) mutable {
    if (now != stage) progress.stage(stage = now, total);
    if (done > 0) progress.step();
  };
}

}  // namespace lumo::program
