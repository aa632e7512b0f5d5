#include "kernel.hpp"

#include "lumo/objective/optical_separation.hpp"

using namespace lumo;
using namespace lumo::micro;

// As large as an evaluation has it: 4 diameters, 7 places, 5 loads.
TEST_CASE("objective: separation of places", "[objective]") {
  std::vector<ObservedState> states;
  const OwenSobol u{3};
  for (std::uint32_t s = 0; s < 140; ++s) {
    ObservedState state{s, 0.01 * (1 + s % 4), 0.0, 0.001 * (s / 20), double(1 + s / 4 % 5), Eigen::MatrixXd(8, 11)};
    for (int replicate = 0; replicate < 8; ++replicate)
      for (int region = 0; region < 11; ++region)
        state.change(replicate, region) =
            1e-3 * u(s, region) + 1e-5 * u(1000 + 8 * s + std::uint32_t(replicate), region);
    states.push_back(state);
  }
  REQUIRE(optical_separation(states)->distance.value > 0.0);
  BENCHMARK(named("closest pair of places", "1 evaluation of 140 states, 8 replicates of 11 regions")) {
    return optical_separation(states)->first;
  };
  BENCHMARK(named("states to be retraced", "1 evaluation of 140 states, 8 replicates of 11 regions")) {
    return undecided_states(states).size();
  };
}
