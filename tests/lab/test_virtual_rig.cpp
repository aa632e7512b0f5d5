#include "catch.hpp"

#include "lab/test_pad.hpp"
#include "lumo/lab/side_camera.hpp"
#include "lumo/lab/virtual_rig.hpp"
#include "lumo/sense/decode/cycle_metrics.hpp"
#include "lumo/sense/estimate.hpp"
#include "lumo/sense/profile/finger_view.hpp"

#include <cmath>
#include <sstream>
#include <vector>

using namespace lumo;
using namespace lumo::sense;

namespace {

LabPlan short_plan() {
  LabPlan plan{"short", 3.0, {}};
  for (const int p : {1, 4})
    plan.contacts.push_back({p, lab_places_m[std::size_t(p)], 0, lab_holds({5, 20}, 0.2, 0.4), 0.0, 0.6});
  return plan;
}

}  // namespace

TEST_CASE("a plan goes where a pad bears it, and no further than it does", "[lab]") {
  const LabPlan whole = force_plan(), less = up_to(moved(whole, 1e-3), 15.0);
  REQUIRE(less.contacts.size() == whole.contacts.size());
  for (std::size_t k = 0; k < less.contacts.size(); ++k) {
    CHECK(less.contacts[k].y_m == Approx(whole.contacts[k].y_m + 1e-3));
    CHECK(less.contacts[k].steps.size() == 4);
    CHECK(less.contacts[k].steps.back().load_N == 15.0);
    CHECK(whole.contacts[k].steps.back().load_N == 20.0);
  }
  CHECK(up_to(recontact_plan(), 15.0).contacts[7].steps.size() == 4);
}

TEST_CASE("same seed, same log, another seed, another one, without noise no scatter", "[lab]") {
  const PadLight light(test_pad());
  const VirtualRig a(light, short_plan(), 3), b(light, short_plan(), 3), c(light, short_plan(), 4);
  REQUIRE(a.frames().size() == b.frames().size());
  const std::size_t middle = a.frames().size() / 2;
  CHECK(a.image(middle).pixels == b.image(middle).pixels);
  CHECK(a.image(middle).pixels != c.image(middle).pixels);
  CHECK(joint_log_text(a.joints()) == joint_log_text(b.joints()));
  CHECK(truth_text(a.truth()) == truth_text(b.truth()));
  CHECK(truth_text(a.truth()) != truth_text(c.truth()));
  for (const Segment& s : a.session().segments)
    if (s.kind == SegmentKind::hold)
      CHECK((s.load_N == 5.0 || s.load_N == 20.0));  // what was asked for; what came out scatters
  const VirtualRig quiet(light, short_plan(), 3, 0.0);
  for (const TruthSample& t : quiet.truth())
    if (t.contact >= 0) CHECK(std::abs(t.y_m) == Approx(15e-3));
}

TEST_CASE(
    "the deformation creeps up to what the load gives in equilibrium, and an instant step shows the instantaneous "
    "modulus",
    "[lab]") {
  const SiliconeRig rig{{0.2, 0.1, 0.1}, {0.1, 1.0, 10.0}};
  Relaxation pad(rig);
  CHECK(pad.step(10.0, 1e-9) ==
        Approx(10.0 * 0.6).epsilon(1e-6));  // equilibrium modulus in parts of the instantaneous one
  double last = pad.equivalent_N();
  for (int k = 0; k < 400; ++k) {
    const double e = pad.step(10.0, 0.5);
    CHECK(e >= last - 1e-12);
    last = e;
  }
  CHECK(last == Approx(10.0).epsilon(1e-4));
  // One branch alone has a closed form: creep at constant load, e = F (1 − g exp(−(1 − g) t/τ)).
  Relaxation one({{0.3, 0.0, 0.0}, {1.0, 1.0, 1.0}});
  one.step(1.0, 1e-9);
  double t = 0.0;
  for (int k = 0; k < 2000; ++k) {
    t += 1e-3;
    one.step(1.0, 1e-3);
  }
  CHECK(one.equivalent_N() == Approx(1.0 - 0.3 * std::exp(-0.7 * t)).epsilon(1e-4));
}

TEST_CASE("pixels scatter as the sensor's model says", "[lab]") {
  const PadLight light(test_pad());
  CameraRig camera;
  camera.row_DN = camera.pixel_gain = 0.0;
  const SidePainter painter({camera, SideGeometry{}, {}}, LightRig{}, light.responses().position_m, 1);
  const Eigen::VectorXd level = Eigen::VectorXd::Constant(60, 100.0);
  const Eigen::Vector2d at = painter.view().pixel(5.5e-3, 2.5e-3);  // away from LEDs
  const int u = int(std::lround(at.x())), v = int(std::lround(at.y()));
  double sum = 0.0, squares = 0.0;
  constexpr int n = 1500;
  for (int k = 0; k < n; ++k) {
    const double g = painter.paint(level, 1.0, 5.0, 1.0, RandomStream(7, std::uint64_t(k))).view().green(u, v);
    sum += g;
    squares += g * g;
  }
  const double mean = sum / n, variance = squares / n - mean * mean;
  CHECK(mean == Approx(107.0).margin(1.5));  // light, room and black level; vignetting takes a little
  CHECK(variance == Approx(camera.shot_DN * 105.0 + camera.read_DN * camera.read_DN + 1.0 / 12.0).epsilon(0.1));
}

TEST_CASE("a camera is placed so that the pad lies in its picture, however badly it aims", "[lab]") {
  const PadLight light(test_pad());
  int in_sight = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    const VirtualRig rig(light, short_plan(), seed, 4.0);
    const Image image = rig.image(0);
    double left = 0.0, right = 0.0;  // nothing shines at the picture's ends
    for (int v = 0; v < image.height; ++v) {
      left += image.view().green(0, v) / image.height;
      right += image.view().green(image.width - 1, v) / image.height;
    }
    in_sight += left < 35.0 && right < 35.0;
  }
  CHECK(in_sight == 60);
  CHECK_FALSE(SideCamera(CameraRig{}, SideGeometry{}, {0.0, 0.0, 0.0, 0.03, 0.0}).shows_side());
  CHECK_FALSE(SideCamera(CameraRig{}, SideGeometry{}, {0.0, 0.0, 0.6, 0.0, 0.0}).shows_side());
  CHECK(SideCamera(CameraRig{}, SideGeometry{}, {0.02, 0.02, 0.02, 1e-3, 1e-3}).shows_side());
}

TEST_CASE("the five LEDs are found in the unloaded picture, and their map gives places on the side to its parallax",
    "[lab]") {
  const PadLight light(test_pad());
  for (const std::uint64_t seed : {1u, 2u, 3u, 4u, 5u}) {
    const VirtualRig rig(light, short_plan(), seed);
    VirtualCamera camera(rig);
    const FingerView view = view_finger(camera, rig.session(), UnloadedStretch::of(rig.session(), 0), "lab");
    CHECK(view.leds.map.residual_px < 0.4);
    CHECK(view.band_high_m - view.band_low_m == Approx(9e-3).margin(1.5e-3));  // the visible side's height
  }
  // A point on the side, straight: LEDs lie 14.75/1.41 mm behind it, 4 % farther from the camera.
  const SidePainter painter({CameraRig{}, SideGeometry{}, {}}, LightRig{}, light.responses().position_m, 1);
  const double lamp = painter.view().lamp_pixel(22e-3).x() - painter.view().lamp_pixel(0.0).x(),
               side = painter.view().pixel(22e-3, 5e-3).x() - painter.view().pixel(0.0, 5e-3).x();
  CHECK(side / lamp == Approx((0.25 + 14.75e-3 / 1.41) / 0.25).epsilon(1e-3));
}

TEST_CASE("with known depth of the LEDs and place of the camera there is no parallax", "[lab]") {
  const PadLight light(test_pad());
  LabPlan plan{"one contact", 0.0, {}};
  plan.contacts.push_back({0, 0.0, 0, lab_holds({5}, 0.3, 0.5), 0.0, 1.0});
  const VirtualRig rig(light, plan, 1, 0.0);
  const Image image = rig.image(0);
  const SidePainter painter({rig.rig().camera, SideGeometry{}, {}}, rig.rig().light, light.responses().position_m, 1);
  const auto error_m = [&](const Session& session, double y) {
    const AxisMap map = view_finger(image.view(), session, "lab").leds.map;
    return map.y_m(map.u_px(painter.view().pixel(y, 4.5e-3))) - y;
  };
  Session silent = rig.session();
  silent.camera_distance_m = 0.0;
  for (const double y : {-25e-3, -10e-3, 0.0, 15e-3, 25e-3}) {
    INFO("y " << 1e3 * y << " mm");
    CHECK(std::abs(error_m(rig.session(), y)) < 0.2e-3);
    CHECK(error_m(silent, y) == Approx(0.042 * y).margin(0.2e-3));  // 14.75 mm / 1.41 behind the side, 250 mm away
  }
}

TEST_CASE("the finger's localiser finds places along a pad with clear ends, and its intervals hold them", "[lab]") {
  PadResponses clear = test_pad();
  for (Eigen::Index k = 0; k < clear.place_m.size(); ++k) {  // an end at 30 mm throws a contact's light back
    const Eigen::VectorXd image =
        (-0.5 * ((clear.position_m.array() - (60e-3 - clear.place_m[k])) / 4e-3).square()).exp();
    clear.change[std::size_t(k)] += image * (2e-5 * clear.load_N.transpose());
  }
  const PadLight light(clear);
  int samples = 0, located = 0;
  double error = 0.0, held = 0.0;
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    LabPlan plan{"six places", 0.0, {}};
    for (int p = 0; p < 6; ++p)
      plan.contacts.push_back({p, 10e-3 * (p - 2.5), 0, lab_holds({5, 10}, 0.2, 0.3), 0.0, 1.0});
    const VirtualRig rig(light, plan, seed);
    const UnloadedStretch rest = UnloadedStretch::of(rig.session(), rig.frames().front().stamp_ns);
    VirtualCamera first(rig), all(rig);
    FingerOptics finger;
    finger.view = view_finger(first, rig.session(), rest, "lab");
    GreenProfile readout = finger.readout();
    const std::vector<Profile> profiles = read_profiles(all, readout);
    finger.unloaded = unloaded_reference(profiles, rest, "lab");
    const auto estimates = locate(profiles, finger, bayes_localizer);
    std::istringstream table(truth_text(rig.truth()));
    const LocationScore s = location_score(estimates, LogTruth::from_table(table, "truth"), 4.5);
    samples += s.samples;
    located += s.located;
    error += s.mae_m * s.located;
    held += s.coverage_90 * s.located;
  }
  INFO(located << " of " << samples << " located, mean error " << 1e3 * error / located << " mm, "
               << 100.0 * held / located << " % held");
  CHECK(samples > 150);
  CHECK(located > 0.98 * samples);
  CHECK(error < 0.6e-3 * located);
  CHECK(held > 0.85 * located);
}

TEST_CASE("current times constant is force times arm, apart from what the rig adds", "[lab]") {
  const PadLight light(test_pad());
  const VirtualRig rig(light, short_plan(), 1, 0.0);
  const MotorRig& m = rig.rig().motor;
  int loaded = 0;
  for (const TruthSample& t : rig.truth()) {
    if (t.contact < 0) continue;
    const auto j = std::min_element(rig.joints().begin(), rig.joints().end(), [&](const auto& a, const auto& b) {
      return std::abs(a.stamp_ns - t.stamp_ns) < std::abs(b.stamp_ns - t.stamp_ns);
    });
    const double torque = m.torque_constant_Nm_per_A * j->effort[0] - m.weight_Nm * std::sin(j->position_rad[0]);
    CHECK(torque == Approx(t.force_N * (m.joint_to_origin_m + t.y_m)).margin(0.03));  // ramps: 2 ms off
    ++loaded;
  }
  CHECK(loaded > 50);
}

TEST_CASE("what is known of a finger needs joint samples, unloaded ones, of the session's joints", "[lab]") {
  const PadLight light(test_pad());
  const VirtualRig rig(light, short_plan(), 1);
  const Recording whole{"lab", rig.session(), rig.frames(), rig.joints(), {}, {}, {}};
  const auto known = [&](const Recording& r) { return known_finger(r, [&] { return VirtualCamera(rig); }); };
  const FingerModel<> finger = known(whole);
  REQUIRE(finger.joints.torque.size() == 1);
  CHECK(finger.joints.torque[0].torque_constant_Nm_per_A == rig.session().torque_constant_Nm_per_A[0]);

  Recording none = whole, late = whole, two = whole;
  none.joints.clear();
  late.joints.erase(late.joints.begin(), late.joints.end() - 10);
  two.session.joint_to_joint_m = {0.04};
  CHECK_THROWS_WITH(known(none), "lab: has no joint samples (joint.csv) to estimate a force from");
  CHECK_THROWS_WITH(known(late), "lab: has no joint samples of the finger without contact");
  CHECK_THROWS_WITH(known(two), "lab: the session describes 2 joints (joint_to_joint_mm), the samples have 1");
}

TEST_CASE("LEDs off and no noise: what is left is the room", "[lab]") {
  const PadLight light(test_pad());
  LabPlan plan = short_plan();
  plan.views = {LabView{{}, 1.0, 0.0}};
  const VirtualRig rig(light, plan, 1, 0.0);
  for (std::size_t k = 0; k < rig.frames().size(); k += 40) {
    const Image i = rig.image(k);
    CHECK(*std::max_element(i.pixels.begin(), i.pixels.end()) <=
          std::uint8_t(rig.rig().camera.black_DN + rig.rig().light.ambient_DN * 1.2 + 1.0));
  }
}

TEST_CASE("the cycle plan leaves what W_cycle needs: conditioning, both branches, loads at each picture", "[lab]") {
  const PadLight light(test_pad());
  LabPlan plan = cycle_plan(1);
  CHECK(plan.contacts.size() == 6);
  CHECK(cycle_plan().contacts.size() == 18);
  plan.contacts.resize(1);
  const auto cycles_of = [&](double noise) {
    const VirtualRig rig(light, plan, 2, noise);
    int conditioning = 0, measured = 0;
    for (const Segment& s : rig.session().segments)
      if (s.kind == SegmentKind::cycle) {
        (s.cycle < 0 ? conditioning : measured) += 1;
        CHECK(s.load_N == 15.0);
        CHECK(1e-9 * double(s.to_ns - s.from_ns) == Approx(28.0));  // 13 N up and down at 1 N/s, 1 s at both ends
      }
    CHECK(conditioning == 2);
    CHECK(measured == 5);
    CHECK(rig.frames().size() == Approx(5.0 * (2.0 + 3.0 + 7 * 28.0 + 1.2)).margin(2));
    VirtualCamera first(rig), all(rig);
    const FingerView view = view_finger(first, rig.session(), UnloadedStretch::of(rig.session(), 0), "lab");
    GreenProfile readout = view.readout(LongitudinalBins::regions());
    return cycle_runs(read_profiles(all, readout), rig.session(), rig.wrenches());
  };
  const LoggedCycles quiet = cycles_of(0.0), loud = cycles_of(1.0);
  REQUIRE(quiet.runs.size() == 1);
  REQUIRE(quiet.runs[0].size() == 5);
  CHECK(quiet.lost == 0);
  const CycleVariation silent = cycle_variation(quiet.runs), noisy = cycle_variation(loud.runs);
  INFO("W_cycle " << silent.W_cycle_DN << " and " << noisy.W_cycle_DN << " DN");
  CHECK(silent.from_N == 3.0);
  CHECK(silent.to_N == Approx(14.0));
  CHECK(noisy.W_cycle_DN > 2.0 * silent.W_cycle_DN);
  // The deformation lags behind the load: at one load there is more light on the way back. No part of W_cycle.
  const LoadCycle& last = quiet.runs[0].back();
  CHECK((*profile_at(last.unloading, 8.0) - *profile_at(last.loading, 8.0)).maxCoeff() > 3.0 * silent.W_cycle_DN);
}

TEST_CASE("plans beyond what was computed are refused", "[lab]") {
  const PadLight light(test_pad());
  LabPlan plan = short_plan();
  plan.contacts[0].steps[0].load_N = 25.0;
  CHECK_THROWS_AS(VirtualRig(light, plan), InvalidArgument);
  plan = short_plan();
  plan.contacts[0].y_m = 0.03;
  CHECK_THROWS_AS(VirtualRig(light, plan), InvalidArgument);
}
