#include "catch.hpp"

#include "lumo/sense/live/live.hpp"
#include "lumo/sense/live/log_recorder.hpp"
#include "lumo/sense/recording/recording.hpp"
#include "lumo/support/json.hpp"
#include "lumo/support/opencv.hpp"
#include "sense/synthetic.hpp"
#include "temporary_folder.hpp"

#include <cmath>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

using namespace lumo;
using namespace lumo::sense;

namespace {

using synthetic::ms;

/// A finger, its camera and its motor on a clock that goes on by a millisecond whenever somebody looks. It is pressed
/// from two seconds on.
struct Bench {
  static constexpr double joint_to_origin_m = 0.055, place_m = 12.0e-3;
  static constexpr std::int64_t begin = 5'000'000 * ms;
  static inline std::int64_t now = begin;
  Bench() { now = begin; }
  bool with_motor = true, camera_there = true;
  std::int64_t camera_goes_ns = INT64_MAX, motor_goes_ns = INT64_MAX, dark_from_ns = INT64_MAX;
  double step_Nm = 0.0, noise_Nm = 0.006;
  int backlog = 0;  ///< samples that queued up before, and are stamped when they are read

  double since_s(std::int64_t t) const { return 1e-9 * double(t - begin); }
  double force_N(std::int64_t t) const { return std::clamp(8.0 * (since_s(t) - 2.0) / 0.3, 0.0, 8.0); }
  TorqueModel joint() const {
    TorqueModel m;
    m.torque_constant_Nm_per_A = 1.0;
    m.bias_Nm = 0.03;
    m.noise_Nm = noise_Nm;
    return m;
  }
};

class BenchCamera {
 public:
  explicit BenchCamera(Bench& bench) : bench_(&bench) {}
  std::optional<Frame> next() {
    bench_->now += ms;
    if (state() != StreamState::open || bench_->now < due()) return std::nullopt;
    const std::int64_t t = due();
    const double change = 1.6 * bench_->force_N(t);
    image_ = synthetic::paint(
        {320, 240, {160.0, 120.0}, 0.05, 4700.0, 1.5},
        [&](double y, double across) {
          return synthetic::leds(y, across, 90.0) +
                 change * std::exp(-0.5 * std::pow((y - Bench::place_m) / 4.5e-3, 2));
        },
        2.0, 500 + std::uint64_t(count_));
    if (t >= bench_->dark_from_ns) image_ = Image::black(320, 240, PixelFormat::bgr);
    return Frame{image_.view(), t, 0.001, 64.0, count_++};
  }
  StreamState state() const { return bench_->now >= bench_->camera_goes_ns ? StreamState::failed : StreamState::open; }

 private:
  std::int64_t due() const { return Bench::begin + 10 * ms + 33'333'333LL * count_; }
  Bench* bench_;
  Image image_;
  std::int64_t count_ = 0;
};

static_assert(Camera<BenchCamera>);

class BenchMotor {
 public:
  explicit BenchMotor(Bench& bench) : bench_(&bench) {}
  std::optional<JointSample> next() {
    if (bench_->backlog > 0 && bench_->backlog-- > 0)
      return JointSample{
          bench_->now, JointVector::Zero(1), JointVector::Zero(1), JointVector::Zero(1), Effort::torque_Nm};
    if (state() != StreamState::open || next_ > bench_->now) return std::nullopt;
    const std::int64_t t = std::exchange(next_, next_ + 2 * ms);
    const TorqueModel m = bench_->joint();
    double torque = m.unloaded(0.3, 0.0) + bench_->force_N(t) * (Bench::joint_to_origin_m + Bench::place_m) +
                    m.noise_Nm * normal_();
    if (bench_->step_Nm > 0.0) torque = bench_->step_Nm * std::round(torque / bench_->step_Nm);
    return JointSample{
        t, JointVector::Constant(1, 0.3), JointVector::Zero(1), JointVector::Constant(1, torque), Effort::torque_Nm};
  }
  StreamState state() const {
    return !bench_->with_motor || bench_->now >= bench_->motor_goes_ns ? StreamState::failed : StreamState::open;
  }

 private:
  Bench* bench_;
  std::int64_t next_ = Bench::begin;
  synthetic::Normal normal_{7};
};

static_assert(Actuator<BenchMotor>);

LiveWait bench_wait() {
  return {.name = "bench", .now_ns = [] { return Bench::now; }};
}

std::vector<ForceEstimate> press(Bench& bench, double seconds, const JointReference& joints) {
  BenchCamera camera(bench);
  BenchMotor motor(bench);
  std::vector<ForceEstimate> reported;
  Session session;
  session.joint_to_origin_m = Bench::joint_to_origin_m;
  FingerModel<> finger = finger_model(session);
  finger.joints = joints;
  estimate_live(
      camera, motor, finger, bayes_localizer,
      [&](const ForceEstimate& e) { return reported.push_back(e), bench.since_s(e.stamp_ns) < seconds; }, bench_wait());
  return reported;
}
std::vector<ForceEstimate> press(Bench& bench, double seconds) {
  return press(bench, seconds, {{bench.joint()}, {0.01}, 0.0});
}

}  // namespace

TEST_CASE("force and place are reported picture by picture while the streams come", "[live]") {
  Bench bench;
  const auto reported = press(bench, 4.0);
  CHECK(reported.size() > 80);
  CHECK(reported.size() < 100);  // 30 pictures a second for three seconds
  int pressed = 0;
  for (const ForceEstimate& e : reported) {
    const double t = bench.since_s(e.stamp_ns);
    INFO(t << " s, " << to_string(e.state) << ", " << to_string(e.faults));
    if (t < 1.95) CHECK(e.contacts == 0);
    if (t < 2.6) continue;
    ++pressed;
    CHECK(e.state == EstimatorState::ok);
    REQUIRE(e.contact[0].force_N);
    REQUIRE(e.contact[0].y_m);
    CHECK(*e.contact[0].force_N == Approx(8.0).margin(0.8));
    CHECK(*e.contact[0].y_m == Approx(Bench::place_m).margin(1.5e-3));
  }
  CHECK(pressed > 35);
  CHECK(reported.front().state == EstimatorState::ok);  // what begins is not missing
  CHECK_FALSE(reported.front().faults.any());
}

TEST_CASE("a motor whose driver gives torque in steps is not taken for stuck, and what had queued up does not count",
    "[live]") {
  Bench bench;
  bench.step_Nm = 36.0 / 4095.0;
  bench.noise_Nm = 0.002;
  bench.backlog = 400;
  std::vector<JointSample> before;
  BenchMotor motor(bench);
  bench.now = Bench::begin + 1500 * ms;
  while (const auto s = motor.next()) before.push_back(*s);
  bench.now = Bench::begin;
  JointReference joints = identify_joints(before, {}, INT64_MAX);
  CHECK(joints.effort_step == Approx(bench.step_Nm));
  CHECK(identify_joints(std::vector<JointSample>(before.begin(), before.begin() + 3), {}, INT64_MAX).effort_step ==
        0.0);  // too few
  const auto reported = press(bench, 4.0, joints);
  int stuck = 0, dropped = 0;
  for (const ForceEstimate& e : reported) {
    stuck += e.faults.has(Fault::torque_stuck);
    dropped += e.faults.has(Fault::joint_dropped);
  }
  CHECK(reported.size() > 80);
  CHECK(stuck == 0);
  CHECK(dropped == 0);
  REQUIRE(reported.back().contact[0].force_N);
  CHECK(*reported.back().contact[0].force_N == Approx(8.0).margin(0.8));
}

TEST_CASE("what a camera gives that cannot be used does not silence the estimate", "[live]") {
  Bench bench;
  bench.dark_from_ns = Bench::begin + 2000 * ms;
  bench.camera_goes_ns = Bench::begin + 3500 * ms;
  bench.motor_goes_ns = Bench::begin + 3500 * ms;
  int dark = 0;
  for (const ForceEstimate& e : press(bench, 60.0))
    if (bench.since_s(e.stamp_ns) > 2.3) {
      ++dark;
      CHECK(e.state == EstimatorState::torque_only);
      CHECK((e.faults.has(Fault::frame_black) || e.faults.has(Fault::frame_repeated)));  // all alike
    }
  CHECK(dark >= 5);  // every 0.2 s
}

TEST_CASE("a camera or motor that goes is a state, and the end only when both have gone", "[live]") {
  Bench bench;
  bench.camera_goes_ns = Bench::begin + 3000 * ms;
  bench.motor_goes_ns = Bench::begin + 3600 * ms;
  const auto reported = press(bench, 60.0);
  REQUIRE(!reported.empty());
  CHECK(bench.since_s(reported.back().stamp_ns) == Approx(3.5).margin(0.15));
  CHECK(reported.back().state == EstimatorState::torque_only);
  CHECK(reported.back().faults.has(Fault::camera_lost));

  Bench mute;
  mute.with_motor = false;
  try {
    press(mute, 2.0);
    FAIL("a motor that says nothing must be refused");
  } catch (const InputError& e) {
    CHECK(std::string(e.what()) == "the motors: 0 samples came while the finger rested; does something command them?");
  }
}

TEST_CASE("what is recorded reads back as a log, from the first picture on", "[live]") {
  const TemporaryFolder folder;
  const std::string name = folder.path.string();
  std::filesystem::create_directories(name + "/frames");
  Bench bench;
  BenchCamera camera(bench), again(bench);
  BenchMotor motor(bench);
  Session plan;
  plan.title = "plan";
  plan.segments = {{0, 500 * ms, SegmentKind::unloaded}};
  std::vector<double> asked;
  {
    LogRecorder recorder(name, to_json(plan), [](const ImageView& v) { return encode_image(".png", v); });
    record_live(
        camera, motor, recorder, [&](double s) { return asked.push_back(s), s <= 1.0; }, bench_wait());
    recorder.finish();
    CHECK(recorder.frames() == 31);
    CHECK(recorder.lost_frames() == 0);
    CHECK(recorder.lost_samples() <= 6);  // before the first picture
  }
  CHECK(asked.front() == 0.0);
  CHECK(std::is_sorted(asked.begin(), asked.end()));
  const Recording log = read_log_folder(name);
  CHECK(log.session.title == "plan");
  CHECK(log.session.segments == plan.segments);
  REQUIRE(log.frames.size() == 31);
  CHECK(log.frames[0].stamp_ns == 0);
  CHECK(log.frames[30].stamp_ns == 30 * 33'333'333LL);
  CHECK(log.frames[30].exposure_s == 0.001);
  REQUIRE(log.joints.size() > 480);
  CHECK(log.joints.front().stamp_ns < 4 * ms);
  CHECK(log.joints.front().unit == Effort::torque_Nm);
  bench.now = Bench::begin;
  FolderCamera recorded(name + "/frames", log.frames);
  for (auto f = recorded.next(); f; f = recorded.next()) {
    std::optional<Frame> truth;
    while (!truth) truth = again.next();
    REQUIRE(f->image.width == truth->image.width);
    for (int y = 0; y < f->image.height; ++y)
      REQUIRE(std::equal(f->image.row(y), f->image.row(y) + 3 * f->image.width, truth->image.row(y)));
  }
}

TEST_CASE(
    "a recorder leaves out what goes back in time or cannot be seen, and reports what it cannot write", "[live]") {
  const TemporaryFolder folder;
  const std::string name = folder.path.string();
  std::filesystem::create_directories(name + "/frames");
  const Image image = Image::black(16, 8, PixelFormat::grey);
  const auto frame = [&](std::int64_t t) { return Frame{image.view(), t, 0.0, 0.0, 0}; };
  const JointSample sample{140, JointVector::Zero(2), JointVector::Zero(2), JointVector::Zero(2), Effort::current_A};
  {
    LogRecorder recorder(name, to_json(Session{}), [](const ImageView& v) { return encode_image(".png", v); });
    recorder.add(sample);  // nothing to be stamped by yet
    recorder.add(frame(100));
    recorder.add(frame(100));
    recorder.add(frame(90));
    recorder.add(Frame{{}, 200, 0.0, 0.0, 0});
    recorder.add(frame(300));
    JointSample early = sample, cut_off = sample;
    early.stamp_ns = 90;
    cut_off.stamp_ns = 150;
    cut_off.saturated = true;
    for (const JointSample& s : {early, sample, sample, cut_off}) recorder.add(s);
    recorder.finish();
    CHECK(recorder.frames() == 2);
    CHECK(recorder.lost_frames() == 3);
    CHECK(recorder.samples() == 1);
    CHECK(recorder.lost_samples() == 4);
    JointSample other = sample;
    other.stamp_ns = 160;
    other.unit = Effort::torque_Nm;
    CHECK_THROWS_AS(recorder.add(other), InputError);
  }
  CHECK(read_frame_log(*std::make_unique<std::ifstream>(name + "/frames.csv"), "frames.csv").size() == 2);
  std::filesystem::remove_all(name + "/frames");
  LogRecorder nowhere(name, to_json(Session{}), [](const ImageView& v) { return encode_image(".png", v); });
  nowhere.add(frame(1));
  try {
    nowhere.finish();
    FAIL("a picture that cannot be written must be reported");
  } catch (const InputError& e) {
    CHECK(std::string(e.what()).find("000000.png: cannot be written") != std::string::npos);
  }
}

TEST_CASE("a recording that breaks off is a log up to there", "[live]") {
  const TemporaryFolder folder;
  const std::string name = folder.path.string();
  std::filesystem::create_directories(name + "/frames");
  Bench bench;
  bench.camera_goes_ns = INT64_MAX;
  BenchCamera camera(bench);
  BenchMotor motor(bench);
  struct {
    BenchCamera* inner;
    std::optional<Frame> next() {  // falls silent after half a second
      auto f = inner->next();
      return f && f->stamp_ns > Bench::begin + 500 * ms ? std::nullopt : f;
    }
    StreamState state() const { return StreamState::open; }
  } silent{&camera};
  try {
    LogRecorder recorder(name, to_json(Session{}), [](const ImageView& v) { return encode_image(".png", v); });
    record_live(
        silent, motor, recorder, [](double) { return true; }, bench_wait());
    FAIL("a silent camera must be reported");
  } catch (const InputError& e) {
    CHECK(std::string(e.what()) == "bench: has given no picture for 2 s");
  }
  const Recording log = read_log_folder(name);  // written by the recorder's end
  CHECK(log.frames.size() == 15);
  CHECK(log.joints.size() > 1000);
}

TEST_CASE("an encoder that throws anything is a fault of the recording, not of the program", "[live]") {
  const TemporaryFolder folder;
  std::filesystem::create_directories(folder / "frames");
  const Image image = Image::black(16, 8, PixelFormat::grey);
  for (const bool standard : {true, false}) {
    LogRecorder recorder(folder.path.string(), to_json(Session{}), [&](const ImageView&) -> std::vector<std::uint8_t> {
      if (standard) throw std::runtime_error("no memory for it");
      throw 7;
    });
    recorder.add(Frame{image.view(), 1, 0.0, 0.0, 0});
    try {
      recorder.finish();
      FAIL("it must be reported");
    } catch (const InputError& e) {
      CHECK(std::string(e.what()).find(standard ? "no memory for it" : "cannot be encoded") != std::string::npos);
    }
  }
}

TEST_CASE("pictures that the disk is too far behind with are left out and counted", "[live]") {
  const TemporaryFolder folder;
  std::filesystem::create_directories(folder / "frames");
  const Image image = Image::black(16, 8, PixelFormat::grey);
  std::mutex gate;
  std::unique_lock shut(gate);
  LogRecorder recorder(folder.path.string(), to_json(Session{}), [&](const ImageView& v) {
    const std::lock_guard through(gate);
    return encode_image(".png", v);
  });
  for (std::int64_t t = 0; t < 100; ++t) recorder.add(Frame{image.view(), t, 0.0, 0.0, t});
  CHECK(recorder.frames() >= recorder.most_waiting);
  CHECK(recorder.frames() <= recorder.most_waiting + 1);  // one may be under way
  CHECK(recorder.frames() + recorder.lost_frames() == 100);
  shut.unlock();
  recorder.finish();
  CHECK(read_log_folder(folder.path.string()).frames.size() == recorder.frames());
}

TEST_CASE(
    "a plan is announced in the order of time, moved where it begins too soon, and keeps what was done", "[live]") {
  const auto segment = [](double from_s, double to_s, int place) {
    Segment s;
    s.from_ns = std::int64_t(1e9 * from_s);
    s.to_ns = std::int64_t(1e9 * to_s);
    s.place = place;
    return s;
  };
  RecordingPlan plan({segment(6.0, 8.0, 1), segment(3.0, 5.0, 0)});
  CHECK(plan.seconds() == Approx(8.0));
  CHECK(plan.announced(0.9) == nullptr);
  const Segment* first = plan.announced(1.0);
  REQUIRE(first);
  CHECK(first->place == 0);
  CHECK(first->from_ns == 3'000'000'000);  // as the plan says
  CHECK(plan.announced(1.0) == nullptr);
  REQUIRE(plan.announced(7.0));
  CHECK(plan.announced(7.0) == nullptr);
  CHECK(plan.done(7'999'999'999).size() == 1);
  CHECK(plan.done(8'000'000'000).size() == 2);
  for (const double begin_s : {0.0, 1.0, 1e6, -50.0}) {  // too soon, or of another recording's clock
    const RecordingPlan moved({segment(begin_s, begin_s + 1.0, 0), segment(begin_s + 5.0, begin_s + 6.5, 1)});
    CHECK(moved.segments()[0].from_ns == 2'000'000'000);
    CHECK(moved.seconds() == Approx(8.5));
  }
  CHECK(RecordingPlan({}).seconds() == 0.0);
}
