#include "catch.hpp"
#include "lumo/core/executor.hpp"
#include "lumo/lab/observe_pad.hpp"
#include "pipeline/coarse_pipeline.hpp"

#include <cmath>
#include <vector>

using namespace lumo;

TEST_CASE("a pad with unequal ends is pressed at both, one with equal ends at one") {
  const auto places = [](const PadGrid& grid) {
    std::vector<double> y_mm;
    for (const Scenario<Sphere>& s : grid.scenarios()) y_mm.push_back(std::round(1e3 * s.y_m));
    return y_mm;
  };
  CHECK(places({.place_m = even_places(0.0, 26.0_mm, 13.0_mm), .tilt_place_m = {0.0, 13.0_mm}}) ==
        std::vector<double>{0, 13, 26, 0, 13});
  const PadGrid both{.place_m = even_places(-24.0_mm, 28.0_mm, 13.0_mm), .tilt_place_m = {}};
  CHECK(places(both) == std::vector<double>{-24, -11, 2, 15, 28});
  CHECK_THROWS_WITH(observe_pad(finger(plain_baseline(), dragon_skin(), coarse_finger()), SideSight{}, both,
                        coarse_pipeline(), Serial{}),
      Catch::Contains("the first place is y = -24 mm, must be 0"));
}

TEST_CASE("a pad that finds no equilibrium has no responses for the lab: a failure of the numbers, not of the caller") {
  const SideSight sight;
  const CoarsePipeline coarse = coarse_pipeline();
  using Light = Tracer<BeerLambert, SideSight, Embree>;
  Pipeline<TetgenMesher, decltype(coarse.simulator), Light> p{coarse.mesher, coarse.simulator,
      Light({.rays_per_emitter = 1 << 8, .carrier_rays = 1 << 8, .exit_rays = 1 << 8}, sight), coarse.focus};
  p.rays.rounds = 0;
  p.simulator.solver.config.max_iterations = 1;
  const PadGrid grid{.load_N = {1.0, 2.0, 5.0, 10.0}, .place_m = {0.0, 13.0_mm}, .tilt_place_m = {}};
  CHECK_THROWS_AS(
      observe_pad(finger(plain_baseline(), dragon_skin(), coarse_finger()), sight, grid, p, Serial{}), PressFailure);
}
