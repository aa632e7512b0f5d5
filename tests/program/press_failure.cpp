#include "catch.hpp"

#include "commands/pressing.hpp"

namespace {

using namespace lumo;
using namespace lumo::program;

std::string failure(Status status, const Configuration& asked) {
  ScenarioRecord scenario;
  scenario.diameter_m = 10e-3;
  scenario.status = status;
  scenario.states.resize(1);
  scenario.states.back().load_N = 15.0;
  return failure_of(asked, {scenario});
}

}  // namespace

TEST_CASE("a press that fails says where, and that friction may hold a pad that slips off its stem") {
  const Configuration built;
  CHECK(failure(Status::converged, built).empty());
  CHECK_THAT(failure(Status::not_positive_definite, built), Catch::Contains("no equilibrium at 15 N") &&
                                                                Catch::Contains("sphere of 10 mm") &&
                                                                Catch::EndsWith("--assume carrier_friction_0.5"));

  Configuration rubs, bonded;
  rubs.mechanics.carrier_friction = 0.5;
  bonded.pad.finger.pad.stem = Stem::bonded;
  for (const Configuration& holds : {rubs, bonded})  // friction would change nothing, or is there
    CHECK_THAT(failure(Status::not_positive_definite, holds), !Catch::Contains("friction"));
  CHECK_THAT(
      failure(Status::inverted, built), Catch::Contains("an element is crushed") && !Catch::Contains("friction"));
}
