#include "catch.hpp"
#include "lumo/support/tbb.hpp"
#include "pipeline/coarse_pipeline.hpp"

using namespace lumo;

namespace {

Ensemble small_ensemble() {
  Ensemble e;
  e.diameters_m = {20e-3};
  e.places_m = {-11e-3, 0.0, 11e-3};
  e.angles_rad = {-15 * pi / 180, 15 * pi / 180};
  e.loads_N = {1.0, 2.0, 5.0, 10.0};
  return e;
}

bool same_bits(const Evaluation& a, const Evaluation& b) {
  if (a.J_contact.has_value() != b.J_contact.has_value() || (a.J_contact && a.J_contact->value != b.J_contact->value))
    return false;
  if (a.J_obs->value != b.J_obs->value || a.J_obs->error != b.J_obs->error) return false;
  for (std::size_t k = 0; k < a.observations.scenarios.size(); ++k)
    for (std::size_t s = 0; s < a.observations.scenarios[k].states.size(); ++s) {
      const StateRecord &x = a.observations.scenarios[k].states[s], &y = b.observations.scenarios[k].states[s];
      if (x.depth_m != y.depth_m || x.response != y.response || x.residual_N != y.residual_N ||
          x.contact_area_m2 != y.contact_area_m2)
        return false;
    }
  return true;
}

}  // namespace

TEST_CASE("an evaluation is bit-identical for any number of threads, and mirror images are what solving both gives") {
  const FingerDesign design{8, 4, 6, 4, 2};
  const Evaluation one =
      evaluate({design, dragon_skin(), coarse_finger()}, small_ensemble(), coarse_pipeline(), Serial{});
  REQUIRE(one.J_contact);
  REQUIRE(one.J_obs);
  CHECK(one.J_contact->value > 0.0);
  CHECK(one.observations.scenarios.size() == 6);
  const Evaluation two =
      evaluate({design, dragon_skin(), coarse_finger()}, small_ensemble(), coarse_pipeline(), TbbExecutor{2});
  CHECK(same_bits(one, two));

  CoarsePipeline both = coarse_pipeline();
  both.mirror_once = false;
  const Evaluation all = evaluate({design, dragon_skin(), coarse_finger()}, small_ensemble(), both, TbbExecutor{2});
  CHECK(all.J_contact->value == Approx(one.J_contact->value).epsilon(1e-4));
  for (std::size_t k = 0; k < 6; ++k) {
    const ScenarioRecord &a = one.observations.scenarios[k], &b = all.observations.scenarios[k];
    CHECK(a.y_m == b.y_m);
    CHECK(a.angle_rad == b.angle_rad);
    for (std::size_t s = 0; s < 4; ++s) {
      CHECK(a.states[s].depth_m == Approx(b.states[s].depth_m).epsilon(1e-6));
      for (std::size_t r = 0; r < 11; ++r)
        CHECK(a.states[s].response[r] == Approx(b.states[s].response[r]).margin(1e-6));
    }
  }
}

TEST_CASE("states that decide J_obs are traced again until its error is small, and no other states") {
  Ensemble e = small_ensemble();
  e.angles_rad = {0.0};
  e.loads_N = {1.0, 8.0};
  const FingerDesign design{8, 4, 6, 4, 2};
  const Evaluation once = evaluate({design, solaris(), coarse_finger()}, e, coarse_pipeline(), Serial{});
  CoarsePipeline p = coarse_pipeline();
  p.rays = {.tolerance = 0.15, .rounds = 8, .pilot = 1.0};
  const Evaluation one = evaluate({design, solaris(), coarse_finger()}, e, p, Serial{}),
                   two = evaluate({design, solaris(), coarse_finger()}, e, p, TbbExecutor{2});
  REQUIRE(one.J_obs);
  CHECK(same_bits(one, two));
  CHECK_FALSE(undecided_states(once.observed, p.rays.tolerance, p.optical_error).empty());
  CHECK(undecided_states(one.observed, p.rays.tolerance, p.optical_error).empty());
  CHECK(one.J_obs->error < 2.3 * p.rays.tolerance * one.J_obs->value);
  CHECK(one.J_obs->error < once.J_obs->error);
  CHECK(one.observations.ledger.imbalance() < 1e-9);
  int retraced = 0;
  for (std::size_t k = 0; k < one.observed.size(); ++k) retraced += one.observed[k].change != once.observed[k].change;
  CHECK(retraced >= 2);
  CHECK(retraced < int(one.observed.size()));
  CHECK(one.observations.unloaded_response == once.observations.unloaded_response);
}

TEST_CASE("a scenario that fails leaves no score, and says which") {
  CoarsePipeline p = coarse_pipeline();
  p.simulator.solver.config.max_iterations = 1;
  const Evaluation e = evaluate({plain_baseline(), dragon_skin(), coarse_finger()}, small_ensemble(), p, Serial{});
  CHECK_FALSE(e.J_contact);
  CHECK_FALSE(e.J_obs);
  for (const ScenarioRecord& s : e.observations.scenarios) CHECK(s.status == Status::max_iterations);
}

TEST_CASE("an infeasible design is refused before anything is spent") {
  CHECK_THROWS_AS(
      evaluate({{2, 1, 8, 5, 0}, dragon_skin()}, small_ensemble(), coarse_pipeline(), Serial{}), InfeasibleDesign);
}

TEST_CASE(
    "what was pressed once can be lit again, and light whose channels have no mirror image asks for presses of its "
    "own") {
  const FingerDesign design{8, 4, 6, 4, 2};
  Ensemble e = small_ensemble();
  e.places_m = {0.0, 11e-3};
  e.loads_N = {1.0};
  const CoarsePipeline p = coarse_pipeline();
  const Body body = finger(design, dragon_skin(), coarse_finger());
  const auto pressed = press(body, e.scenarios(), p, Serial{});
  const Evaluation whole = evaluate({design, dragon_skin(), coarse_finger()}, e, p, Serial{});
  for (int again = 0; again < 2; ++again) {
    const Evaluation lit = score(observe(body, pressed, p, TbbExecutor{2}), p);
    CHECK(lit.J_obs->value == whole.J_obs->value);
    CHECK(lit.observations.scenarios[1].states[0].response == whole.observations.scenarios[1].states[0].response);
  }
  FingerOptions bright = coarse_finger(), one_side = coarse_finger();
  bright.carrier_albedo = 0.95;
  one_side.readout.one_side = true;
  const Evaluation other = score(observe(finger(design, dragon_skin(), bright), pressed, p, Serial{}), p);
  CHECK(other.J_obs->value == evaluate({design, dragon_skin(), bright}, e, p, Serial{}).J_obs->value);
  CHECK(other.J_obs->value != whole.J_obs->value);
  CHECK(has_image_channels(body, pressed, p));
  // Of one side alone: its mirror image stands for the other.
  const Body half_seen = finger(design, dragon_skin(), one_side);
  CHECK(has_image_channels(half_seen, pressed, p));
  CHECK(evaluate({design, dragon_skin(), one_side}, e, p, Serial{}).J_obs->value ==
        score(observe(half_seen, pressed, p, Serial{}), p).J_obs->value);
  Body lopsided = half_seen;  // −15° was not pressed, and this body's light has no mirror image
  lopsided.symmetry.x = false;
  CHECK_FALSE(has_image_channels(lopsided, pressed, p));
  CHECK_THROWS_AS(observe(lopsided, pressed, p, Serial{}), InvalidArgument);
}

TEST_CASE("where one side is seen, a contact from the other side is known from its mirror image") {
  const FingerDesign design{8, 4, 6, 4, 2};
  Ensemble e = small_ensemble();
  e.places_m = {5e-3};
  e.loads_N = {2.0};
  FingerOptions one_side = coarse_finger();
  one_side.readout.one_side = true;
  CoarsePipeline p = coarse_pipeline();
  const Evaluation once = evaluate({design, solaris(), one_side}, e, p, Serial{});
  p.mirror_once = false;
  const Evaluation each = evaluate({design, solaris(), one_side}, e, p, Serial{});
  CHECK(once.observations.unloaded_response.size() == 11);
  double apart = 0.0;
  for (std::size_t k = 0; k < 2; ++k) {
    const StateRecord &a = once.observations.scenarios[k].states[0], &b = each.observations.scenarios[k].states[0];
    REQUIRE(a.response.size() == 11);
    CHECK(a.change.cols() == 11);
    CHECK(a.change_error.size() == 11);
    for (std::size_t r = 0; r < 11; ++r) {
      CHECK(a.response[r] == Approx(b.response[r]).margin(1e-6));
      apart = std::max(apart, std::abs(a.response[r] - once.observations.scenarios[1 - k].states[0].response[r]));
    }
  }
  CHECK(apart > 1e-4);  // ±15° are not seen alike
}
