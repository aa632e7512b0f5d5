#include "catch.hpp"
#include "lumo/core/executor.hpp"
#include "lumo/lab/observe_pad.hpp"
#include "pipeline/coarse_pipeline.hpp"

using namespace lumo;
using namespace lumo::sense;

TEST_CASE("a pad that finds no equilibrium has no responses for the lab: a failure of the numbers, not of the caller") {
  const SideSight sight;
  const CoarsePipeline coarse = coarse_pipeline();
  using Light = Tracer<BeerLambert, SideSight, Embree>;
  Pipeline<TetgenMesher, decltype(coarse.simulator), Light> p{coarse.mesher, coarse.simulator,
      Light({.rays_per_emitter = 1 << 8, .carrier_rays = 1 << 8, .exit_rays = 1 << 8}, sight), coarse.focus};
  p.rays.rounds = 0;
  p.simulator.solver.config.max_iterations = 1;
  const PadGrid grid{.load_N = {1.0, 2.0, 5.0, 10.0}, .spacing_m = 13.0_mm, .places = 2, .tilt_place_m = {}};
  CHECK_THROWS_AS(
      observe_pad(finger(baseline_design(), dragon_skin(), coarse_finger()), sight, grid, p, Serial{}), PressFailure);
}
