#include "catch.hpp"
#include "lumo/study/assumptions.hpp"
#include "lumo/support/tbb.hpp"
#include "pipeline/coarse_pipeline.hpp"

#include <cmath>
#include <set>

using namespace lumo;

TEST_CASE("Kendall's tau: order, opposite order, one exchange, ties") {
  const std::vector<double> a{1, 2, 3, 4}, back{4, 3, 2, 1}, swapped{1, 2, 4, 3}, tied{1, 1, 3, 4}, same{2, 2, 2, 2};
  CHECK(*kendall_tau(a, a) == 1.0);
  CHECK(*kendall_tau(a, back) == -1.0);
  CHECK(*kendall_tau(a, swapped) == Approx(4.0 / 6.0));
  CHECK(*kendall_tau(a, tied) == Approx(5.0 / std::sqrt(30.0)));
  CHECK(*kendall_tau(tied, tied) == 1.0);
  CHECK(!kendall_tau(a, same));
  CHECK(!kendall_tau(std::vector<double>{1}, std::vector<double>{2}));
  CHECK(!kendall_tau(a, std::vector<double>{1, 2}));
}

TEST_CASE("The effect of a reading: differences, ranks, what decides, and the choice, over designs that both score") {
  const auto score = [](double contact, double observation, std::string where) {
    return AssumptionScore{Estimate{contact, 0.01}, Estimate{observation, 0.1}, where, where};
  };
  const std::vector<AssumptionScore> usual = {
      score(0.5, 4.0, "a"), score(0.4, 8.0, "a"), score(0.3, 2.0, "b"), score(0.9, 9.0, "a"), {}};
  std::vector<AssumptionScore> varied = {score(0.6, 2.0, "a"), score(0.5, 4.0, "b"), score(0.2, 3.0, "b"),
      {std::nullopt, std::nullopt, "", ""}, score(1, 1, "")};
  const AssumptionEffect e = effect_of(usual, varied);
  CHECK(e.compared == 3);
  CHECK(e.lost == 1);
  CHECK(e.J_contact->median == Approx(0.1));
  CHECK(e.J_contact->positive == 2);
  CHECK(e.J_contact->negative == 1);
  CHECK(e.J_obs->median == Approx(-0.5));
  CHECK(*e.tau_contact == 1.0);
  CHECK(*e.tau_obs == Approx(1.0 / 3.0));
  CHECK(e.worst_contact_moved == 1);
  CHECK(e.worst_observation_moved == 1);
  CHECK(e.usual_choice == std::optional<std::size_t>(1));  // min(0.8, 1) against min(1, 0.5)
  CHECK(e.choice == std::optional<std::size_t>(1));
  varied[0] = score(0.6, 4.5, "a");
  CHECK(effect_of(usual, varied).choice == std::optional<std::size_t>(0));
  CHECK(effect_of({}, {}).compared == 0);
  CHECK(!effect_of({}, {}).J_contact);
}

TEST_CASE(
    "Every reading departs from the usual one, has a name of its own, and says by what it changes whether equilibria "
    "move") {
  const FingerAssumptions usual{dragon_skin(), {}};
  std::set<std::string> names, lit;
  for (const AssumptionVariant& d : assumption_variants()) {
    INFO(d.quantity << ": " << d.value);
    FingerAssumptions other = usual;
    d.apply(other);
    CHECK_FALSE(other == usual);
    names.insert(d.name());
    if (same_mechanics(other, usual)) lit.insert(d.quantity);
  }
  CHECK(names.size() == assumption_variants().size());
  const auto departs = [](const FingerAssumptions& from, const std::string& key) {
    const auto list = assumption_variants(from);
    return std::any_of(list.begin(), list.end(), [&](const AssumptionVariant& d) { return d.key == key; });
  };
  const FingerAssumptions plain{dragon_skin(), plain_finger()};
  CHECK((departs(usual, "bonded_stem") && departs(usual, "film_closes_on_touch") && departs(usual, "tilt_along")));
  CHECK_FALSE((departs(plain, "bonded_stem") || departs(plain, "film_closes_on_touch")));  // no recesses, no free stem
  CHECK((departs(usual, "both_sides_seen") && !departs(usual, "one_side_seen")));
  CHECK((departs(plain, "one_side_seen") && !departs(plain, "both_sides_seen")));

  std::set<std::string> keys;
  for (const auto& list : {all_assumption_variants(), absorption_variants()})
    for (const AssumptionVariant& d : list) keys.insert(d.key);
  CHECK(keys.size() == all_assumption_variants().size() + absorption_variants().size());
  for (const AssumptionVariant& d : absorption_variants()) {
    FingerAssumptions other = usual;
    d.apply(other);
    INFO(d.name());
    CHECK(other.silicone.extinction_per_m() == Approx(usual.silicone.extinction_per_m()).epsilon(1e-12));
    CHECK(other.silicone.absorption_per_m <= 71.0);
    CHECK(same_mechanics(other, usual));
  }
  CHECK(lit == std::set<std::string>{"LEDs", "visible normal", "visible side", "visible light", "bins",
                   "scattering albedo", "indenter", "carrier albedo", "film over LEDs"});
}

namespace {

std::vector<Scenario<Sphere>> three_contacts() {
  std::vector<Scenario<Sphere>> list;
  for (const auto& [angle, y] : {std::pair(0.0, 0.0), {0.3, 0.0}, {0.0, 5.5e-3}})
    list.push_back({Sphere{20e-3}, angle, y, {1.0, 2.0, 5.0, 10.0}});
  return list;
}

/// Three of the list, and one that no finger can be made under.
std::vector<AssumptionVariant> few_variants() {
  std::vector<AssumptionVariant> rows;
  for (const AssumptionVariant& d : all_assumption_variants())
    if (d.quantity == "tilt plane" || d.value == "0.95" || d.value == "+10 %") rows.push_back(d);
  rows.push_back({"thick", "pad", "too thick", [](FingerAssumptions& r) { r.finger.pad.t_min = 9.0; }});
  return rows;
}

CoarsePipeline pipeline_under(const FingerAssumptions& r) {
  CoarsePipeline p = coarse_pipeline();
  p.simulator.material = {.mu = r.silicone.mu_Pa, .lambda = r.silicone.lambda_Pa};
  p.simulator.contact.friction = r.friction;
  return p;
}

}  // namespace

TEST_CASE(
    "Assumptions that move no equilibrium share the presses, to the bit, the others press anew, and what fails leaves "
    "the rest whole") {
  const FingerDesign design{8, 4, 6, 4, 2};
  const std::vector<Scenario<Sphere>> contacts = three_contacts();
  int simulators = 0;
  const auto tools_for = [&](const FingerAssumptions& r) {
    ++simulators;
    return pipeline_under(r);
  };
  const FingerAssumptions usual{dragon_skin(), coarse_finger()};
  const std::vector<AssumptionVariant> rows = few_variants();
  REQUIRE(rows.size() == 4);
  const auto results = evaluate_assumptions(design, {usual, rows, contacts}, tools_for, TbbExecutor{2});
  REQUIRE(results.size() == 5);
  CHECK(simulators == 4);  // none for what is not feasible
  for (std::size_t k = 0; k < 4; ++k) {
    INFO(k << " " << results[k].why);
    REQUIRE(results[k].why.empty());
  }
  CHECK(results[4].why.find("t_min") != std::string::npos);
  const auto alone = [&](const FingerAssumptions& r, TiltPlane tilt) {
    auto turned = contacts;
    for (auto& s : turned)
      if (s.angle_rad != 0.0) s.tilt = tilt;
    const CoarsePipeline p = tools_for(r);
    return score(observe(finger(design, r.silicone, r.finger), turned, p, Serial{}), p);
  };
  const auto depth = [](const Evaluation& e, std::size_t scenario) {
    return e.observations.scenarios[scenario].states[3].depth_m;
  };
  const Evaluation own = alone(usual, TiltPlane::xz);
  CHECK(results[0].evaluation.J_obs->value == own.J_obs->value);
  for (std::size_t k = 1; k < 4; ++k) {
    FingerAssumptions r = usual;
    rows[k - 1].apply(r);
    const Evaluation e = alone(r, r.tilt);
    CHECK(results[k].evaluation.J_contact->value == e.J_contact->value);
    CHECK(results[k].evaluation.J_obs->value == e.J_obs->value);
    if (r.tilt == TiltPlane::yz) {
      CHECK(depth(e, 0) == depth(own, 0));
      CHECK(depth(e, 1) != depth(own, 1));
    } else if (!same_mechanics(r, usual)) {
      CHECK(depth(e, 0) < depth(own, 0));
    } else {
      CHECK(depth(e, 1) == depth(own, 1));
      CHECK(e.J_obs->value != own.J_obs->value);
    }
  }

  // Nothing is compared with what failed.
  const auto failing = [&](const FingerAssumptions& r) {
    CoarsePipeline p = tools_for(r);
    p.simulator.solver.config.max_iterations = 1;
    return p;
  };
  const auto none = evaluate_assumptions(design, {usual, rows, {contacts[0]}}, failing, Serial{});
  REQUIRE(none.size() == 1);
  CHECK(none[0].why.find("max_iterations") != std::string::npos);
}
