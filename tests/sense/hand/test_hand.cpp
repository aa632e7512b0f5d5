#include "catch.hpp"

#include "lumo/sense/hand/hand_log.hpp"
#include "lumo/sense/live/live.hpp"
#include "sense/hand/hand_scene.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

using namespace lumo;
using namespace lumo::sense;
using synthetic::all_links, synthetic::HandScene, synthetic::practised_hand;

TEST_CASE("a link's map is the turn, shift and scale that its points were given", "[hand]") {
  Eigen::Matrix2Xd points(2, 4), pixels(2, 4);
  points << -0.02, 0.02, 0.0, 0.01, -0.004, -0.004, 0.003, 0.008;
  for (const bool clockwise : {false, true}) {
    const LinkMap made{{320.5, 111.25}, {2100.0, -1300.0}, clockwise, 0.0};
    for (Eigen::Index k = 0; k < 4; ++k) pixels.col(k) = made.pixel(points(0, k), points(1, k));
    const LinkMap fit = LinkMap::fit(points, pixels, clockwise);
    CHECK((fit.origin_px - made.origin_px).norm() < 1e-9);
    CHECK((fit.along_px_per_m - made.along_px_per_m).norm() < 1e-6);
    CHECK(fit.residual_px < 1e-9);
    CHECK(LinkMap::fit(points, pixels, !clockwise).residual_px > 1.0);  // a mirror image is no turn
  }
  CHECK_THROWS_AS(LinkMap::fit(points.leftCols(1), pixels.leftCols(1), true), InvalidArgument);
  points.setZero();
  CHECK_THROWS_AS(LinkMap::fit(points, pixels, true), InvalidArgument);
}

TEST_CASE("links are found by their holes to a fraction of a pixel, and are not where holes are hidden", "[hand]") {
  for (int k = 0; k < 12; ++k) {
    HandScene s;
    s.joints = {0.04 * k - 0.2, 0.02 * k, -0.03 * k, 0.02 * k};
    s.seed = std::uint64_t(k);
    const Image image = s.paint();
    for (int l = 0; l < 4; ++l) {
      LinkMap guess = s.map(l);
      guess.origin_px += Eigen::Vector2d(6.0, -7.0);  // 3 mm off
      const auto found = register_link(image.view(), HandScene::link(l), guess);
      INFO(k << " link " << l);
      REQUIRE(found);
      CHECK((found->origin_px - s.map(l).origin_px).norm() < 0.3);
      CHECK((found->along_px_per_m - s.map(l).along_px_per_m).norm() < 0.01 * 3000.0);
    }
    s.covered = 1;
    CHECK_FALSE(register_link(s.paint().view(), HandScene::link(1), s.map(1)));
  }
  CHECK_FALSE(register_link(Image::black(640, 480, PixelFormat::grey).view(), HandScene::link(0), HandScene{}.map(0)));
  CHECK_FALSE(register_link({}, HandScene::link(0), HandScene{}.map(0)));
  LinkMap outside = HandScene{}.map(0);
  outside.origin_px.x() += 5000.0;
  CHECK_FALSE(register_link(HandScene{}.paint().view(), HandScene::link(0), outside));
}

TEST_CASE(
    "contacts on several links at once are found where they are, bright and dark, whatever the lamps do", "[hand]") {
  HandObserver hand = practised_hand();
  CHECK(hand.references(0) == 25);
  double worst = 0.0;
  for (int round = 0; round < 12; ++round) {
    HandScene s;
    const double q1 = 0.03 + 0.015 * round, q2 = 0.21 - 0.012 * round;
    s.joints = {q1, q2, -q1, -q2};
    s.seed = std::uint64_t(500 + round);
    s.lamps = 1.0 + 0.08 * std::cos(round);
    s.slope_DN = 4.0 * std::sin(round);
    const HandEstimate free = hand.observe(round, s.sample(), s.paint().view());
    CHECK(free.seen == std::vector<bool>(4, true));
    INFO("round " << round);
    CHECK(free.contacts.empty());
    for (const auto& c : free.contacts)
      UNSCOPED_INFO("free " << c.link << " y " << 1e3 * c.y_m << " peak " << c.peak_DN);
    const double place = -20.0 + 3.5 * round;
    s.touches = {{0, place, 25.0}, {1, -place, -22.0}, {3, 0.5 * place, 30.0}};
    const HandEstimate grasp = hand.observe(1000 + round, s.sample(), s.paint().view());
    for (const auto& c : grasp.contacts)
      UNSCOPED_INFO(c.link << " y " << 1e3 * c.y_m << " z " << 1e3 * c.z_m << " peak " << c.peak_DN << " area "
                           << 1e6 * c.area_m2);
    REQUIRE(grasp.contacts.size() == 3);
    for (std::size_t c = 0; c < 3; ++c) {
      CHECK(grasp.contacts[c].link == s.touches[c].link);
      worst = std::max(worst, std::abs(1e3 * grasp.contacts[c].y_m - s.touches[c].y_mm));
      CHECK((grasp.contacts[c].pixel - s.map(s.touches[c].link).pixel(grasp.contacts[c].y_m, grasp.contacts[c].z_m))
                .norm() < 2.0);
    }
  }
  CHECK(worst < 2.0);
}

TEST_CASE("two contacts on one link are two, and what cannot be seen or compared says so", "[hand]") {
  HandObserver hand = practised_hand();
  HandScene s;
  s.joints = {0.1, 0.1, -0.1, -0.1};
  s.touches = {{2, -15.0, 25.0}, {2, 14.0, 28.0}};
  HandEstimate e = hand.observe(1, s.sample(), s.paint().view());
  for (const auto& c : e.contacts)
    UNSCOPED_INFO(
        c.link << " y " << 1e3 * c.y_m << " z " << 1e3 * c.z_m << " peak " << c.peak_DN << " area " << 1e6 * c.area_m2);
  REQUIRE(e.contacts.size() == 2);
  CHECK(1e3 * e.contacts[0].y_m == Approx(-15.0).margin(2.0));
  CHECK(1e3 * e.contacts[1].y_m == Approx(14.0).margin(2.0));
  s.covered = 2;
  e = hand.observe(2, s.sample(), s.paint().view());
  CHECK(e.seen == std::vector<bool>{true, true, false, true});
  CHECK(e.reference[2] == -1);
  CHECK(e.contacts.empty());
  s.covered = -1;
  JointVector far = s.sample();
  far[3] = 2.0;  // the picture is near a reference, the joints are not: nothing is known of such a picture
  e = hand.observe(3, far, s.paint().view());
  CHECK(e.seen == std::vector<bool>{true, true, true, false});
  e = hand.observe(4, s.sample(), Image::black(640, 480, PixelFormat::grey).view());
  CHECK(e.seen == std::vector<bool>(4, false));
  far[0] = std::nan("");
  CHECK_THROWS_AS(hand.observe(5, far, s.paint().view()), InvalidArgument);
  CHECK_THROWS_AS(hand.observe(6, JointVector::Zero(2), s.paint().view()), InvalidArgument);
  CHECK_THROWS_AS(HandObserver(all_links(), {}, {}), InvalidArgument);
  HandLink loose = HandScene::link(0);
  loose.hole_m = Eigen::Matrix2Xd(2, 1);
  CHECK_THROWS_AS(HandObserver({loose}, {LinkMap{}}, {}), InvalidArgument);
}

namespace {

/// Pictures of a hand in motion, made as they are asked for.
class SceneCamera {
 public:
  explicit SceneCamera(std::vector<HandScene> scenes) : scenes_(std::move(scenes)) {}
  std::optional<Frame> next() {
    if (next_ == scenes_.size()) return std::nullopt;
    image_ = scenes_[next_].paint();
    return Frame{image_.view(), stamp(next_), 0.0, 0.0, std::int64_t(next_++)};
  }
  StreamState state() const { return next_ == scenes_.size() ? StreamState::ended : StreamState::open; }
  static std::int64_t stamp(std::size_t k) { return 1'000'000'000 + 33'000'000 * std::int64_t(k); }

 private:
  std::vector<HandScene> scenes_;
  std::size_t next_ = 0;
  Image image_;
};

static_assert(Camera<SceneCamera>);

/// Pictures of a hand that opens and closes, free at first and then touched once, with joints on a clock of their own.
struct RecordedHand {
  std::vector<HandScene> scenes;
  Session session;
  std::vector<JointSample> joints;
};

RecordedHand recorded_hand() {
  RecordedHand log;
  auto& [scenes, session, joints] = log;
  for (int l = 0; l < 4; ++l) {
    SessionLink link{HandScene::link(l), Eigen::Matrix2Xd(2, 2)};
    for (int k = 0; k < 2; ++k)
      link.hole_px.col(k) = HandScene{}.map(l).pixel(link.link.hole_m(0, k), link.link.hole_m(1, k)).array().round();
    session.links.push_back(link);
  }
  for (int i = 0; i < 24; ++i) {
    HandScene s;
    const double q = 0.02 * (i < 12 ? i : 23 - i);  // there and back
    s.joints = {q, q, -q, -q};
    s.seed = std::uint64_t(900 + i);
    if (i == 20) s.touches = {{0, -9.0, 26.0}, {3, 12.0, 30.0}};
    scenes.push_back(s);
  }
  Segment free;
  free.kind = SegmentKind::free;
  free.from_ns = SceneCamera::stamp(0);
  free.to_ns = SceneCamera::stamp(15);
  session.segments = {free};
  session.joint_clock = {0, -5.0, 0.0, 0.0};  // the joints' clock is 5 s ahead
  session.frame_delay_s = 0.010;
  session.joint_delay_s = 0.004;
  for (std::size_t i = 0; i < scenes.size(); ++i) {
    JointVector still = JointVector::Zero(4);
    joints.push_back({SceneCamera::stamp(i) + 5'000'000'000 - 10'000'000 + 4'000'000, scenes[i].sample(), still, still,
        Effort::torque_Nm});
  }
  return log;
}

}  // namespace

TEST_CASE("a hand's log: free pictures are references, joints are taken at the pictures' times on their own clock",
    "[hand]") {
  auto [scenes, session, joints] = recorded_hand();
  const TimeSeries positions = joint_positions(joints, session);
  CHECK((*positions.at(SceneCamera::stamp(7) - 10'000'000, 0.1) - Eigen::VectorXd(scenes[7].sample())).norm() < 1e-12);

  HandObserver hand = hand_observer(session);
  SceneCamera camera(scenes);
  std::vector<HandEstimate> estimates;
  int pictures = 0;
  const int references =
      observe_hand(camera, hand, positions, session, [&](const std::optional<HandEstimate>& e, const ImageView& image) {
        CHECK_FALSE(image.empty());
        ++pictures;
        if (e) estimates.push_back(*e);
      });
  CHECK(pictures == 24);
  CHECK(references == 16);
  REQUIRE(estimates.size() == 8);
  const std::string table = "link,stamp_ns,force_N,y_mm\n0," + std::to_string(SceneCamera::stamp(20)) + ",8,-9\n3," +
                            std::to_string(SceneCamera::stamp(20)) + ",9,12\n1," +
                            std::to_string(SceneCamera::stamp(21)) + ",1,0\n";
  std::istringstream in(table);
  const HandTouches truth = HandTouches::from_table(in, "truth.csv");
  CHECK(truth.at(SceneCamera::stamp(20)).size() == 2);
  CHECK(truth.at(SceneCamera::stamp(19)).empty());
  HandScore score;
  for (const HandEstimate& e : estimates) {
    CHECK(e.seen == std::vector<bool>(4, true));
    score.add(e, truth.at(e.stamp_ns));
  }
  CHECK((score.touches == 2 && score.found == 2));  // that of 1 N does not count
  CHECK((score.contacts == 2 && score.unfounded == 0));
  CHECK(score.mae_m < 2e-3);
  HandScore wrong;
  wrong.add(estimates[4], {{2, -9.0e-3, 8.0}});  // another link is touched
  CHECK((wrong.touches == 1 && wrong.found == 0 && wrong.contacts == 2 && wrong.unfounded == 2));

  // Without joints near a picture no link is seen in it.
  HandObserver blind = hand_observer(session);
  SceneCamera again(scenes);
  joints.erase(joints.begin() + 17, joints.end());
  int unseen = 0;
  observe_hand(again, blind, joint_positions(joints, session), session,
      [&](const std::optional<HandEstimate>& e, const ImageView&) {
        if (e) unseen += e->seen == std::vector<bool>(4, false) && e->contacts.empty();
      });
  CHECK(unseen == 7);
  CHECK_THROWS_AS(hand_observer(Session{}), InvalidArgument);
  joints[3].position_rad = JointVector::Zero(2);
  CHECK_THROWS_AS(joint_positions(joints, session), InvalidArgument);
  std::istringstream none("stamp_ns,link,y_mm\n1,2,3\n");
  CHECK_THROWS_AS(HandTouches::from_table(none, "truth.csv"), InputError);
}

TEST_CASE("a live hand is reported picture by picture, with the joints at the time of each", "[hand][live]") {
  struct Stage {
    int picture = -1;  ///< the newest
    static std::int64_t stamp(int k) { return 1'000'000'000 + 40'000'000LL * k; }
    static double turn(int k) { return 0.06 + 0.01 * k; }
  } stage;
  struct HandCamera {
    Stage* stage;
    Image image{};
    std::optional<Frame> next() {
      if (state() != StreamState::open) return std::nullopt;
      const int k = ++stage->picture;
      HandScene s;
      const double q = Stage::turn(k);
      s.joints = {q, 0.06, -q, -0.06};
      s.seed = std::uint64_t(800 + k);
      if (k >= 3) s.touches = {{1, 8.0, 30.0}};
      image = s.paint();
      return Frame{image.view(), Stage::stamp(k), 0.0, 0.0, k};
    }
    StreamState state() const { return stage->picture == 9 ? StreamState::ended : StreamState::open; }
  } camera{&stage};
  struct HandMotors {  // every 20 ms, the newest a little older than the picture; none with pictures 6 and 7
    Stage* stage;
    int count = 0;
    std::optional<JointSample> next() {
      if (stage->picture < 0 || stage->picture == 6 || stage->picture == 7) return std::nullopt;
      const double k = stage->picture - 0.6 + 0.5 * (count % 2);
      if (count / 2 > stage->picture) return std::nullopt;
      if (count / 2 < stage->picture) count = 2 * stage->picture;
      ++count;
      const double q = 0.06 + 0.01 * k;
      JointVector joints(4);
      joints << q, 0.06, -q, -0.06;
      return JointSample{std::int64_t(double(Stage::stamp(0)) + 40e6 * k), joints, JointVector::Zero(4),
          JointVector::Zero(4), Effort::torque_Nm};
    }
    StreamState state() const { return StreamState::open; }
  } motors{&stage};
  HandObserver hand = practised_hand();
  int reported = 0;
  observe_hand_live(camera, motors, hand, Session{},
      [&](const HandEstimate& e, const ImageView& image) {
        const int k = reported++;
        INFO("picture " << k);
        CHECK(e.stamp_ns == Stage::stamp(k));
        CHECK(image.width == 640);
        const bool known = k != 7;  // 6 is near enough to the samples before it
        CHECK(std::count(e.seen.begin(), e.seen.end(), true) == (known ? 4 : 0));
        CHECK(e.contacts.size() == (known && k >= 3 ? 1u : 0u));
        if (!e.contacts.empty()) {
          CHECK(e.contacts[0].link == 1);
          CHECK(1e3 * e.contacts[0].y_m == Approx(8.0).margin(0.6));
        }
        return true;
      },
      {.name = "hand", .max_gap_s = 0.06});
  CHECK(reported == 10);
}
