#include "../catch.hpp"

#include "lumo/sense/live_force.hpp"
#include "lumo/sense/log_recorder.hpp"
#include "lumo/sense/moment_arm.hpp"
#include "lumo/support/json.hpp"
#include "lumo/support/opencv.hpp"
#include "synthetic.hpp"
#include "temporary_folder.hpp"

#include <cmath>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

using namespace lumo;

namespace {

using synthetic::ms;

/// A finger, its camera and its motor on a clock that goes on by a millisecond whenever somebody looks. It is pressed from two seconds on.
struct Bench {
  static constexpr double joint_to_origin_m = 0.055, place_m = 12.0e-3;
  static constexpr std::int64_t begin = 5'000'000 * ms;
  static inline std::int64_t now = begin;
  Bench() { now = begin; }
  bool with_motor = true, camera_there = true;
  std::int64_t camera_goes_ns = INT64_MAX, motor_goes_ns = INT64_MAX;

  double since_s(std::int64_t t) const { return 1e-9 * double(t - begin); }
  double force_N(std::int64_t t) const { return std::clamp(8.0 * (since_s(t) - 2.0) / 0.3, 0.0, 8.0); }
  TorqueModel joint() const {
    TorqueModel m;
    m.torque_constant_Nm_per_A = 1.0, m.bias_Nm = 0.03, m.noise_Nm = 0.006;
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
        [&](double y, double across) { return synthetic::leds(y, across, 90.0) + change * std::exp(-0.5 * std::pow((y - Bench::place_m) / 4.5e-3, 2)); }, 2.0, 500 + std::uint64_t(count_));
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
    if (state() != StreamState::open || next_ > bench_->now) return std::nullopt;
    const std::int64_t t = std::exchange(next_, next_ + 2 * ms);
    const TorqueModel m = bench_->joint();
    const double torque = m.unloaded(0.3, 0.0) + bench_->force_N(t) * (Bench::joint_to_origin_m + Bench::place_m) + m.noise_Nm * normal_();
    return JointSample{t, JointVector::Constant(1, 0.3), JointVector::Zero(1), JointVector::Constant(1, torque), Effort::torque_Nm};
  }
  StreamState state() const { return !bench_->with_motor || bench_->now >= bench_->motor_goes_ns ? StreamState::failed : StreamState::open; }

 private:
  Bench* bench_;
  std::int64_t next_ = Bench::begin;
  synthetic::Normal normal_{7};
};

static_assert(Actuator<BenchMotor>);

const LongitudinalBins bench_bins = LongitudinalBins::uniform(-27.5e-3, 27.5e-3, 55);

BayesLocalizer make_bayes(const GreenProfile& readout, const UnloadedReference& unloaded) { return BayesLocalizer(finger_localizer(readout, unloaded)); }

std::vector<ForceEstimate> press(Bench& bench, double seconds) {
  BenchCamera camera(bench);
  BenchMotor motor(bench);
  std::vector<ForceEstimate> told;
  LiveWait wait;
  wait.now_ns = [] { return Bench::now; };
  estimate_forces_live(
      camera, motor, {{bench.joint()}, {0.01}}, Session{}, bench_bins, make_bayes, MomentArm{Bench::joint_to_origin_m}, [&](const ForceEstimate& e) { return told.push_back(e), bench.since_s(e.stamp_ns) < seconds; },
      "bench", 0, wait);
  return told;
}

}  // namespace

TEST_CASE("force and place are told picture by picture while the streams come", "[live]") {
  Bench bench;
  const auto told = press(bench, 4.0);
  CHECK(told.size() > 80);
  CHECK(told.size() < 100);   // 30 pictures a second for three seconds
  int pressed = 0;
  for (const ForceEstimate& e : told) {
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
}

TEST_CASE("a camera or motor that goes is a state, and the end only when both have gone", "[live]") {
  Bench bench;
  bench.camera_goes_ns = Bench::begin + 3000 * ms;
  bench.motor_goes_ns = Bench::begin + 3600 * ms;
  const auto told = press(bench, 60.0);
  REQUIRE(!told.empty());
  CHECK(bench.since_s(told.back().stamp_ns) == Approx(3.5).margin(0.15));
  CHECK(told.back().state == EstimatorState::torque_only);
  CHECK(told.back().faults.has(Fault::camera_lost));

  Bench mute;
  mute.with_motor = false;
  try {
    press(mute, 2.0);
    FAIL("a motor that says nothing must be refused");
  } catch (const InputError& e) {
    CHECK(std::string(e.what()) == "bench: 0 samples came from the motors while the finger rested: does something command them?");
  }
}

TEST_CASE("what is recorded reads back as a log, from the first picture on", "[live]") {
  const TemporaryFolder folder;
  const std::string name = folder.path.string();
  std::filesystem::create_directories(name + "/frames");
  Bench bench;
  BenchCamera camera(bench), again(bench);
  BenchMotor motor(bench);
  LiveWait wait;
  wait.now_ns = [] { return Bench::now; };
  Session plan;
  plan.title = "plan";
  plan.segments = {{0, 500 * ms, "unloaded"}};
  std::vector<double> asked;
  {
    LogRecorder recorder(name, to_json(plan), [](const ImageView& v) { return encode_image(".png", v); });
    record_live(camera, motor, recorder, [&](double s) { return asked.push_back(s), s <= 1.0; }, "bench", wait);
    recorder.finish();
    CHECK(recorder.frames() == 31);
    CHECK(recorder.lost_frames() == 0);
    CHECK(recorder.lost_samples() <= 6);   // before the first picture
  }
  CHECK(asked.front() == 0.0);
  CHECK(std::is_sorted(asked.begin(), asked.end()));
  const RecordedLog log = read_log_folder(name);
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
    for (int y = 0; y < f->image.height; ++y) REQUIRE(std::equal(f->image.row(y), f->image.row(y) + 3 * f->image.width, truth->image.row(y)));
  }
}

TEST_CASE("a recorder leaves out what goes back in time or cannot be seen, and says what it cannot write", "[live]") {
  const TemporaryFolder folder;
  const std::string name = folder.path.string();
  std::filesystem::create_directories(name + "/frames");
  const Image image = Image::black(16, 8, PixelFormat::grey);
  const auto frame = [&](std::int64_t t) { return Frame{image.view(), t, 0.0, 0.0, 0}; };
  const JointSample sample{40, JointVector::Zero(2), JointVector::Zero(2), JointVector::Zero(2), Effort::current_A};
  {
    LogRecorder recorder(name, to_json(Session{}), [](const ImageView& v) { return encode_image(".png", v); });
    recorder.add(sample);   // nothing to be stamped by yet
    recorder.add(frame(100));
    recorder.add(frame(100));
    recorder.add(frame(90));
    recorder.add(Frame{{}, 200, 0.0, 0.0, 0});
    recorder.add(frame(300));
    recorder.add(JointSample{sample}), recorder.add(JointSample{sample});
    recorder.finish();
    CHECK(recorder.frames() == 2);
    CHECK(recorder.lost_frames() == 3);
    CHECK(recorder.samples() == 1);
    CHECK(recorder.lost_samples() == 2);
    JointSample other = sample;
    other.stamp_ns = 50, other.unit = Effort::torque_Nm;
    CHECK_THROWS_AS(recorder.add(other), InputError);
  }
  CHECK(read_frame_log(*std::make_unique<std::ifstream>(name + "/frames.csv"), "frames.csv").size() == 2);
  std::filesystem::remove_all(name + "/frames");
  LogRecorder nowhere(name, to_json(Session{}), [](const ImageView& v) { return encode_image(".png", v); });
  nowhere.add(frame(1));
  try {
    nowhere.finish();
    FAIL("a picture that cannot be written must be told");
  } catch (const InputError& e) {
    CHECK(std::string(e.what()).find("000000.png: cannot be written") != std::string::npos);
  }
}
