#include "catch.hpp"

#include "lumo/core/units.hpp"
#include "lumo/sense/devices/replay.hpp"
#include "lumo/sense/force/force_baselines.hpp"
#include "lumo/sense/force/force_estimator.hpp"
#include "lumo/sense/localize/bayes_localizer.hpp"
#include "lumo/sense/profile/led_detector.hpp"
#include "lumo/support/json.hpp"
#include "lumo/support/opencv.hpp"
#include "sense/synthetic.hpp"
#include "temporary_folder.hpp"

#include <stdlib.h>

#include <filesystem>

using namespace lumo;
using namespace lumo::sense;

namespace {

using synthetic::ms;
constexpr double joint_to_origin_m = 0.055, constant = 0.8;
constexpr std::int64_t joint_clock_ahead = 7'000 * ms;

/// Three presses at three places; the truth goes into wrench.csv and the segments, which the estimator does not read.
double place(std::int64_t t) { return t < 1500 * ms ? -15.2e-3 : t < 2500 * ms ? 4.3e-3 : 18.9e-3; }
double force(std::int64_t t) {
  const std::int64_t phase = (t - 500 * ms) % (1000 * ms);
  return t < 500 * ms || phase < 200 * ms ? 0.0 : std::min(8.0, 8.0 * double(phase - 200 * ms) / (300.0 * ms));
}

TorqueModel joint_truth() {
  TorqueModel m;
  m.torque_constant_Nm_per_A = constant;
  m.bias_Nm = 0.03;
  m.coulomb_Nm = 0.01;
  m.noise_Nm = 0.006;
  return m;
}

/// Everything that a rig would leave behind, in a folder.
void record(const std::string& folder) {
  synthetic::View view{320, 240, {160.0, 120.0}, 0.05, 4700.0, 1.5};
  Recording log;
  log.path = folder;
  log.session.joint_to_origin_m = joint_to_origin_m;
  log.session.torque_constant_Nm_per_A = {constant};
  log.session.joint_clock = {0, -1e-9 * double(joint_clock_ahead), 0.0, 0.0};
  std::filesystem::create_directories(folder + "/frames");
  for (int k = 0; k < 105; ++k) {
    const std::int64_t t = k * 33'333'333LL;
    const Image image = synthetic::paint(
        view,
        [&](double y, double across) {
          return synthetic::leds(y, across, 90.0) +
                 1.6 * force(t) * std::exp(-0.5 * std::pow((y - place(t)) / 4.5e-3, 2));
        },
        2.0, 100 + std::uint64_t(k));
    log.frames.push_back({t, "f" + std::to_string(1000 + k) + ".png", 0.001, 64.0});
    write_image(folder + "/frames/" + log.frames.back().file, image.view());
    log.wrenches.push_back({t, Vec3d(0, 0, -force(t)), Vec3d::Zero()});
  }
  synthetic::Normal normal(4);
  const TorqueModel m = joint_truth();
  for (std::int64_t t = 0; t < 3500 * ms; t += 2 * ms) {
    const double s = 0.4e-9 * double(t), q = 0.75 * std::sin(s), v = 0.3 * std::cos(s);
    const double torque = m.unloaded(q, v) + force(t) * (joint_to_origin_m + place(t)) + m.noise_Nm * normal();
    log.joints.push_back({t + joint_clock_ahead, JointVector::Constant(1, q), JointVector::Constant(1, v),
        JointVector::Constant(1, torque / constant), Effort::current_A});
  }
  log.session.segments = {{0, 480 * ms, SegmentKind::unloaded}};
  write_log_folder(log);
}

/// Lets a stream through up to now, as live.
template <class Source> struct Gate {
  using Item = decltype(std::declval<Source&>().next());
  Source inner;
  const std::int64_t* now;
  Item held{};
  Item next() {
    if (!held) held = inner.next();
    return held && held->stamp_ns <= *now ? std::exchange(held, std::nullopt) : std::nullopt;
  }
  StreamState state() const { return inner.state(); }
};

/// Map, readout and reference from the unloaded stretch.
struct SeenFinger {
  GreenProfile readout;
  UnloadedReference unloaded;
};

SeenFinger seen_finger(const Recording& log) {
  const Session& session = log.session;
  const auto leds = LedDetector{session.led_count, session.led_pitch_m, session.led_first_y_m, session.distal}.find(
      read_image(log.path + "/frames/" + log.frames[0].file).view());
  REQUIRE(leds);
  CHECK(leds->map.y_m(leds->map.u_px(Eigen::Vector2d(160.0, 120.0))) == Approx(0.0).margin(0.1e-3));
  SeenFinger s{
      GreenProfile({leds->map, LongitudinalBins::uniform(-27.5_mm, 27.5_mm, 55), -7.0_mm, 7.0_mm, 320, 240}), {}};
  Profile p;
  FolderCamera first(log.path + "/frames", log.frames);
  for (auto f = first.next(); f && f->stamp_ns <= session.segments.at(0).to_ns; f = first.next())
    if (s.readout.read(*f, p)) s.unloaded.add(p);
  return s;
}

/// The torque model from the unloaded stretch. It does not distinguish friction and bias, and does not need to: the
/// joint turns one way only.
TorqueModel unloaded_torque(const std::vector<JointSample>& joints, const Session& session) {
  std::vector<JointSample> still;
  for (const JointSample& s : joints)
    if (s.stamp_ns <= session.segments.at(0).to_ns) still.push_back(s);
  TorqueModel start;
  start.torque_constant_Nm_per_A = session.torque_constant_Nm_per_A[0];
  const TorqueIdentification torque = identify_unloaded(still, 0, start);
  CHECK_FALSE(torque.linear.complete());
  CHECK(torque.model.unloaded(0.1, 0.28) == Approx(joint_truth().unloaded(0.1, 0.28)).margin(2e-3));
  return torque.model;
}

/// Errors of the samples with a contact, and their bounds.
void check_errors(const std::vector<ForceSample>& samples) {
  const ForceErrors e =
      force_errors(MomentArm{joint_to_origin_m}, std::span<const ForceSample>(samples), {0, -25.0_mm, 25.0_mm}, 0.01);
  INFO("MAE fused " << e.fused.mae_N << ", optical " << e.optical.mae_N << ", known " << e.known_location.mae_N
                    << ", fixed arm " << e.fixed_arm.mae_N << " N");
  CHECK(e.fused.samples == int(samples.size()));
  CHECK(e.fused.mae_N < 0.15);
  // Half a second without contact has little information on the joint; the filter goes on learning between presses.
  CHECK(e.optical.mae_N < 0.6);
  CHECK(e.fused.mae_N < 0.5 * e.optical.mae_N);
  CHECK(e.fixed_arm.mae_N > 1.0);
  CHECK(*e.recovery() > 0.95);
  CHECK(e.torque_only.samples == 0);
}

}  // namespace

TEST_CASE("stamps that are not in nanoseconds are refused by name", "[log]") {
  const auto log = [](std::int64_t picture_ns, std::int64_t joint_ns) {
    Recording r;
    r.path = "log";
    for (int k = 0; k < 30; ++k) {
      r.frames.push_back({k * picture_ns, ""});
      r.joints.push_back({k * joint_ns, JointVector::Zero(1), JointVector::Zero(1), JointVector::Zero(1)});
    }
    return r;
  };
  CHECK_NOTHROW(require_nanoseconds(log(33'000'000, 1'000'000)));
  CHECK_NOTHROW(require_nanoseconds(log(500'000, 50'000)));  // 2,000 pictures and 20,000 samples a second
  CHECK_NOTHROW(require_nanoseconds(Recording{}));
  CHECK_THROWS_WITH(require_nanoseconds(log(33'000, 1'000'000)),
      Catch::Contains("pictures come 30303 times") && Catch::Contains("µs"));
  CHECK_THROWS_WITH(require_nanoseconds(log(33, 1'000'000)), Catch::Contains("ms, must be in ns"));
  CHECK_THROWS_WITH(
      require_nanoseconds(log(33'000'000, 1'000)), Catch::Contains("joint samples") && Catch::Contains("µs"));
}

TEST_CASE("from a folder of pictures and currents to location and force, with the baselines", "[log]") {
  const TemporaryFolder folder;
  const std::string name = folder.path.string();
  record(name);
  const Recording log = read_log_folder(name);
  const Session& session = log.session;
  const auto [readout, unloaded] = seen_finger(log);
  BayesLocalizer::Config localizer;
  localizer.position_m = readout.positions_m();
  localizer.noise = unloaded.noise();
  localizer.unloaded = unloaded.mean();

  std::vector<JointSample> joints = log.joints;
  for (JointSample& s : joints) s.stamp_ns = session.joint_clock(s.stamp_ns);
  const TorqueModel torque = unloaded_torque(joints, session);

  // As live: step by step, each stream up to now.
  std::int64_t now = 0;
  Gate<FolderCamera> camera{FolderCamera(log.path + "/frames", log.frames), &now};
  Gate<RecordedActuator> actuator{RecordedActuator(joints), &now};
  using Estimator = ForceEstimator<Gate<FolderCamera>, Gate<RecordedActuator>, BayesLocalizer>;
  Estimator::Config config;
  config.torque = {torque};
  config.joints.period_s = 2e-3;
  config.filter.torque_bias_Nm = 0.01;
  Estimator estimator(
      camera, actuator, {readout, unloaded}, BayesLocalizer(localizer), MomentArm{session.joint_to_origin_m}, config);
  const ContactTorques torques(joints, {torque});
  std::vector<ForceSample> samples;
  double location_error = 0.0;
  int located = 0, covered = 0;
  for (const FrameRecord& f : log.frames) {
    now = f.stamp_ns;
    const ForceEstimate e = estimator.step(now);
    const auto truth = -log.wrenches[std::size_t(&f - log.frames.data())].force_N.z();
    const auto measured = torques.at(now);
    if (truth < 5.0 || !measured) continue;
    CHECK(e.state == EstimatorState::ok);
    ForceSample s;
    s.stamp_ns = now;
    s.position_rad = measured->head(1);
    s.contact_torque_Nm = measured->tail(1);
    s.fused_N = e.contact[0].force_N;
    s.true_y_m = place(now);
    s.true_force_N = truth;
    if (e.contacts == 1) s.estimated_y_m = estimator.location().contact[0].y_m;
    if (e.contacts == 1 && e.contact[0].y_m) {
      location_error += std::abs(*e.contact[0].y_m - s.true_y_m);
      ++located;
      covered += std::abs(e.contact[0].force_N.value_or(1e9) - truth) < 2.0 * std::sqrt(e.contact[0].force_variance_N2);
    }
    samples.push_back(s);
  }
  REQUIRE(samples.size() > 40);
  CHECK(located == int(samples.size()));
  CHECK(location_error / located < 0.5e-3);
  CHECK(covered >= located * 9 / 10);
  check_errors(samples);
}
