#include "catch.hpp"

#include "lumo/sense/decode/bayes_decoder.hpp"
#include "lumo/sense/decode/decoder.hpp"
#include "lumo/sense/decode/nearest_template.hpp"
#include "lumo/sense/decode/segment_responses.hpp"

using namespace lumo;
using namespace lumo::sense;

namespace {

/// Three places, two re-contacts, loads 2, 5, 10 N: channel c responds with (c + 1) · (place + 1) · load, re-contact 1
/// by a tenth more; lamps drift by 7 from one re-contact to the next. Four profiles each, two of them outside.
struct Made {
  std::vector<Segment> segments;
  std::vector<Profile> profiles;
  Made() {
    std::int64_t t = 0;
    double lamps = 100.0;
    const auto add = [&](const Segment& s, const Eigen::Vector3d& response) {
      for (const int k : {-1, 0, 10, 11})
        profiles.push_back({t + k, Eigen::VectorXd(response.array() + lamps + (k < 0 || k > 10 ? 1e3 : 0.0)), 0.0});
      segments.push_back(s);
      segments.back().from_ns = t;
      segments.back().to_ns = t + 10;
      t += 100;
    };
    const Eigen::Vector3d channels(1, 2, 3);
    for (int place = 0; place < 3; ++place)
      for (int r = 0; r < 2; ++r) {
        lamps += 7.0;
        Segment s;
        s.kind = SegmentKind::unloaded;
        add(s, Eigen::Vector3d::Zero());
        s.kind = SegmentKind::hold;
        s.place = place;
        s.y_mm = 10.0 * place - 10.0;
        s.repetition = r;
        for (const double load : {2.0, 5.0, 10.0}) {
          s.load_N = load;
          add(s, channels * (place + 1) * (1.0 + 0.1 * r) * load);
        }
        s.kind = SegmentKind::cycle;  // is no hold
        add(s, channels * 10.0);
      }
  }
};

}  // namespace

TEST_CASE("holds are means against the last unloaded stretch", "[segments]") {
  const Made made;
  const auto holds = hold_responses(made.profiles, made.segments);
  REQUIRE(holds.size() == 3 * 2 * 3);
  CHECK(holds[0].profiles == 2);
  CHECK((holds[0].response - 2.0 * Eigen::Vector3d(1, 2, 3)).norm() < 1e-9);
  CHECK((holds[15].response - 3.0 * 1.1 * 2.0 * Eigen::Vector3d(1, 2, 3)).norm() < 1e-9);
  auto late = made.segments;
  late.erase(late.begin());
  CHECK_THROWS_AS(hold_responses(made.profiles, late), InvalidArgument);
}

TEST_CASE("slopes and decoding tasks are those that were put in", "[segments]") {
  const Made made;
  const auto holds = hold_responses(made.profiles, made.segments);
  const auto slopes = slope_profiles(holds);
  REQUIRE(slopes.size() == 3);
  for (int place = 0; place < 3; ++place)
    for (int r = 0; r < 2; ++r)
      CHECK(
          (slopes[std::size_t(place)].col(r) - (place + 1) * (1.0 + 0.1 * r) * Eigen::Vector3d(1, 2, 3)).norm() < 1e-9);
  auto raw = holds;  // the unloaded profile drops out of a slope: lamps at 500 for all holds of the second place
  for (HoldResponse& h : raw)
    if (h.segment.place == 1) h.response.array() += 500.0;
  CHECK((slope_profiles(raw)[1] - slopes[1]).norm() < 1e-9);
  // By hand: medians (1.05, 2.1, 3.15) · (place + 1); neighbours differ by 1.05 √(14/3), re-contacts by 0.05 (place +
  // 1) √(14/3), whose median is the second place's.
  CHECK(*recontact_metrics(slopes).Q == Approx(10.5));

  const auto task = decoding_task(holds, {2.0, 5.0});
  CHECK(task.data.response.rows() == 3);
  CHECK(task.data.response.cols() == 6);
  CHECK(task.data.place_m[0] == Approx(-0.01));
  CHECK(task.fold == std::vector<int>{0, 1, 0, 1, 0, 1});
  CHECK((task.data.response.col(5) - 3.0 * 3.0 * 1.1 * Eigen::Vector3d(1, 2, 3)).norm() < 1e-9);
  CHECK(cross_validate(NearestTemplate{}, task.data, task.fold).accuracy.value == 1.0);
  const auto steps = decoding_task(holds, {2.0, 5.0, 10.0});
  CHECK(steps.data.response.rows() == 6);
  CHECK((steps.data.response.col(0).tail(3) - 5.0 * Eigen::Vector3d(1, 2, 3)).norm() < 1e-9);
  CHECK_THROWS_AS(decoding_task(holds, {2.0, 7.0}), InvalidArgument);
  CHECK(common_loads(holds, 2.0) == std::vector<double>{2.0, 5.0, 10.0});
  CHECK(common_loads(holds, 4.0) == std::vector<double>{5.0, 10.0});
  auto fewer = holds;  // one re-contact ends early
  fewer.erase(std::find_if(fewer.begin(), fewer.end(),
      [](const HoldResponse& h) { return h.segment.kind == SegmentKind::hold && h.segment.load_N == 10.0; }));
  CHECK(common_loads(fewer, 2.0) == std::vector<double>{2.0, 5.0});
}

TEST_CASE("indenters and angles are kept apart, and no load of a re-contact counts twice", "[segments]") {
  Made made;
  std::vector<HoldResponse> first = hold_responses(made.profiles, made.segments), second = first;
  for (HoldResponse& h : first) h.segment.diameter_mm = 10.0;
  for (HoldResponse& h : second) {
    h.segment.diameter_mm = 30.0;
    h.response *= 3.0;
  }
  std::vector<HoldResponse> both = first;
  both.insert(both.end(), second.begin(), second.end());
  CHECK_THROWS_AS(slope_profiles(both), InvalidArgument);
  CHECK_THROWS_AS(decoding_task(both, {2.0, 5.0}), InvalidArgument);
  for (std::size_t i = 0; i < 3; ++i)
    CHECK((slope_profiles(responses_of(both, 30.0, 0.0))[i] - 3.0 * slope_profiles(first)[i]).norm() < 1e-9);
  CHECK(decoding_task(responses_of(both, 10.0, 0.0), {2.0, 5.0}).data.response.cols() == 6);
  for (HoldResponse& h : second) {
    h.segment.diameter_mm = 10.0;
    h.segment.angle_deg = 15.0;
  }
  std::vector<HoldResponse> tilted = first;
  tilted.insert(tilted.end(), second.begin(), second.end());
  CHECK_THROWS_AS(slope_profiles(tilted), InvalidArgument);
  std::vector<HoldResponse> twice = first;
  twice.insert(twice.end(), first.begin(), first.end());
  CHECK_THROWS_AS(slope_profiles(twice), InvalidArgument);
  CHECK_THROWS_AS(decoding_task(twice, {2.0, 5.0}), InvalidArgument);
}

TEST_CASE("places that are not neighbours are not compared as such", "[segments]") {
  const Made made;
  auto holds = hold_responses(made.profiles, made.segments);
  auto gap = holds;
  std::erase_if(gap, [](const HoldResponse& h) { return h.segment.place == 1; });
  CHECK_THROWS_AS(slope_profiles(gap), InvalidArgument);
  CHECK(decoding_task(gap, {2.0, 5.0}).data.places() == 2);  // a decoder may well be asked about two places far apart
  auto end = holds;
  std::erase_if(end, [](const HoldResponse& h) { return h.segment.place == 0; });
  CHECK(slope_profiles(end).size() == 2);
  for (HoldResponse& h : holds) h.segment.y_mm = -h.segment.y_mm;  // numbered against the finger
  CHECK_THROWS_AS(slope_profiles(holds), InvalidArgument);
}
