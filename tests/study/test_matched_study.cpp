#include "catch.hpp"
#include "lumo/study/choice_stability.hpp"
#include "lumo/study/matched_study.hpp"
#include "lumo/study/paired_differences.hpp"
#include "lumo/support/tbb.hpp"
#include "pipeline/coarse_pipeline.hpp"

#include <atomic>
#include <cmath>

using namespace lumo;

TEST_CASE("Differences are summed up by their signs and a distribution-free interval of the median") {
  CHECK(!summarize({}));
  const auto numbered = [](int n) {
    std::vector<Estimate> list;
    for (int k = n; k >= 1; --k) list.push_back({double(k), 0.0});
    return list;
  };
  // Ranks of the 95 % interval from tables of the sign test: 1 and 6 of 6, 2 and 9 of 10, 6 and 15 of 20, 14 and 27
  // of 40.
  CHECK(!summarize(numbered(5))->median_95);
  for (const auto& [n, low] : {std::pair(6, 1), {10, 2}, {20, 6}, {40, 14}}) {
    const auto s = summarize(numbered(n));
    CHECK(s->median == 0.5 * (n + 1));
    REQUIRE(s->median_95);
    CHECK(s->median_95->first == low);
    CHECK(s->median_95->second == n + 1 - low);
  }
  const auto s = summarize({{0.3, 0.1}, {0.3, 0.2}, {-0.3, 0.1}, {-0.1, 0.1}, {0.0, 0.0}});
  CHECK(s->positive == 1);
  CHECK(s->negative == 1);
  CHECK(s->undecided == 3);
  CHECK(s->above_zero == 2);
  CHECK(s->count() == 5);
  const Estimate d = paired_difference({0.5, 0.03}, {0.2, 0.04});
  CHECK(d.value == Approx(0.3));
  CHECK(d.error == Approx(0.05));
}

TEST_CASE("D is the median over scenarios of the norm of the change at its load") {
  std::vector<ScenarioRecord> scenarios;
  for (const double scale : {3.0, 1.0, 2.0}) {
    ScenarioRecord s;
    for (const double load : {1.0, 2.0}) {
      StateRecord state;
      state.load_N = load;
      state.contact_area_m2 = 1e-4;
      state.contact_area_error_m2 = 5e-6;
      state.change = (Eigen::MatrixXd(2, 2) << 3.0, 4.0, 3.0, 4.0).finished() * scale * load;
      s.states.push_back(state);
    }
    scenarios.push_back(s);
  }
  CHECK(median_change(scenarios, 1.0, {3.0})->value == Approx(10.0));
  // The change grows as the load: 3 times the area's 5 %, of the change and of its equal rise.
  CHECK(median_change(scenarios, 1.0, {3.0})->error == Approx(3.0));
  CHECK(median_change(scenarios, 2.0, {3.0})->value == Approx(20.0));
  CHECK(median_change(scenarios, 2.0, {3.0})->error == Approx(6.0));
  CHECK(median_change({scenarios[0], scenarios[1]}, 1.0, {0.0})->value == Approx(10.0));
  CHECK(!median_change(scenarios, 5.0, {3.0}));
  CHECK(!median_change({}, 1.0, {3.0}));
}

TEST_CASE("A study draws the same designs however many it compares, and no more than it can draw evenly") {
  Optimizer<> few(study_problem(finger_space(plain_pad()), 3, 1)),
      most(study_problem(finger_space(plain_pad()), largest_study, 1));
  for (int k = 0; k < 3; ++k) CHECK(few.ask()->x == most.ask()->x);
  CHECK(study_problem(finger_space(plain_pad()), largest_study, 1).sobol >=
        2 * largest_study + CampaignConfig{}.failures.at_least);  // never a search, even if half fail
  for (const int designs : {0, largest_study + 1})
    CHECK_THROWS_AS(study_problem(finger_space(plain_pad()), designs, 1), InvalidArgument);
}

TEST_CASE("Variants of a design: softer without a carrier, and the design without gaps is its own variant") {
  Ensemble contacts = middle_contacts();
  contacts.diameters_m = {20e-3};
  contacts.loads_N = {1.0, 2.0, 5.0, 10.0};
  const FingerDesign design{5, 10, 10, 6, 3};
  const auto run = [&](const FingerDesign& d, const MatchedStudy& study) {
    return compare_variants({d, dragon_skin(), coarse_finger()}, contacts, study, coarse_pipeline(), TbbExecutor{2});
  };

  const auto carrier = run(design, {{Twin::bonded_base, Twin::unsupported_base}, false});
  REQUIRE(carrier.size() == 3);
  CHECK(carrier[1].twin == Twin::bonded_base);
  for (const VariantResult& v : carrier) {
    REQUIRE(v.why == "");
    REQUIRE(v.J_contact);
    CHECK(!v.change);
  }
  for (std::size_t k = 0; k < 4; ++k)  // each takes a constraint away
    for (std::size_t v = 1; v < 3; ++v)
      CHECK(carrier[v].observations.scenarios[0].states[k].depth_m >
            carrier[v - 1].observations.scenarios[0].states[k].depth_m);

  const auto gaps = run(design, {{Twin::no_void}, true});
  FingerDesign closed = design;
  closed.w_v = 0.0;
  const auto same = run(closed, {{Twin::no_void}, true});
  REQUIRE(gaps.size() == 2);
  CHECK(gaps[1].J_contact->value == same[0].J_contact->value);
  CHECK(gaps[1].change->value == same[0].change->value);
  CHECK(same[1].J_contact->value == same[0].J_contact->value);
  CHECK(gaps[0].J_contact->value != gaps[1].J_contact->value);
  CHECK(gaps[0].J_contact->value == carrier[0].J_contact->value);  // light changes nothing in mechanics
}

namespace {

/// Gives the meshes of one body (as the design gave it, and finer at the contact), then fails.
struct TiringMesher {
  MeshError::Reason reason;
  int* fills;
  LinearTets fill(const MeshInput& input) const {
    if (++*fills > 2) throw MeshError(reason, "tired");
    return TetgenMesher{}.fill(input);
  }
};

}  // namespace

TEST_CASE(
    "A variant that cannot be meshed leaves the design whole, one that the machine failed at is left to another try") {
  Ensemble contacts = middle_contacts();
  contacts.diameters_m = {20e-3};
  contacts.loads_N = {1.0};
  const auto run = [&](MeshError::Reason reason) {
    int fills = 0;
    const CoarsePipeline usual = coarse_pipeline();
    const Pipeline<TiringMesher, decltype(usual.simulator), CoarseLight> pipeline{
        TiringMesher{reason, &fills}, usual.simulator, usual.tracer, usual.focus};
    return compare_variants({{5, 10, 10, 6, 3}, dragon_skin(), coarse_finger()}, contacts, {{Twin::bonded_base}, false},
        pipeline, Serial{});
  };
  const auto broken = run(MeshError::Reason::self_intersecting);
  REQUIRE(broken.size() == 2);
  CHECK(broken[0].why == "");
  CHECK(broken[0].observations.scenarios[0].status == Status::converged);
  CHECK(broken[1].why == "mesh: tired");
  CHECK(broken[1].observations.scenarios.empty());
  CHECK_THROWS_AS(run(MeshError::Reason::out_of_memory), MeshError);
  CHECK_THROWS_AS(run(MeshError::Reason::timed_out), MeshError);
}

TEST_CASE("Searches that see the whole lattice all make the same choice, that of the model") {
  Problem p;
  p.space.variables = {{"a", 0.0, 10.0, 0.5, ""}};
  p.objectives = {{"f", true, 0.0}, {"g", true, 0.0}};
  p.sobol = 3;
  const auto outputs = [](double a) {
    return std::pair(2.0 + std::sin(0.5 * a), std::exp(-0.02 * (a - 8.0) * (a - 8.0)));
  };
  std::vector<Trial> trials;
  std::vector<std::pair<double, double>> all;
  for (int k = 0; k <= 20; ++k) {
    all.push_back(outputs(0.5 * k));
    trials.push_back({k, {0.5 * k}, Trial::State::observed, {all.back().first, all.back().second}, {}, false, ""});
  }
  trials.push_back({21, {1.0}, Trial::State::failed, {}, {}, false, "left out"});
  std::atomic<int> watched = 0;
  const auto make = [](const Problem& problem) { return Optimizer<>(problem); };
  const auto choices = choices_over_seeds(p, trials, {5, 21}, make, TbbExecutor{2}, [&] { ++watched; });
  CHECK(watched == 5);
  REQUIRE(choices.size() == 5);
  for (const auto& c : choices) {
    REQUIRE(c);
    CHECK((*c)[0] == trials[*balanced_choice(all)].x[0]);
  }
  CHECK(choices_over_seeds(p, trials, {5, 6}, make, Serial{}, [] {}) ==
        choices_over_seeds(p, trials, {5, 6}, make, TbbExecutor{2}, [] {}));
  CHECK_THROWS_AS(choices_over_seeds(p, {trials[0], trials[21]}, {5, 6}, make, Serial{}, [] {}), InvalidArgument);
}
