#include "catch.hpp"

#include "lab/test_pad.hpp"
#include "lumo/core/units.hpp"
#include "lumo/lab/pad_templates.hpp"
#include "lumo/lab/virtual_rig.hpp"

#include <cmath>
#include <functional>

using namespace lumo;

namespace {

LabPlan two_presses() {
  LabPlan plan{"two presses", 0.0, {}};
  for (int p = 0; p < 2; ++p) plan.contacts.push_back({p, 20e-3 * p - 8e-3, 0, lab_holds({5, 10}, 0.2, 0.3), 0.0, 0.6});
  plan.frames_per_s = 10.0;
  return plan;
}

VirtualRig disturbed(const PadLight& light, const std::function<void(Rig&)>& change, double noise = 0.0) {
  Rig rig;
  change(rig);
  return VirtualRig(light, two_presses(), 3, noise, rig);
}

double mean_of(const sense::Image& image) {
  double sum = 0.0;
  for (const std::uint8_t v : image.pixels) sum += v;
  return sum / double(image.pixels.size());
}

/// The first frame that has a contact.
std::size_t first_touched(const VirtualRig& rig) {
  std::size_t k = 0;
  while (rig.truth()[k].contact < 0) ++k;
  return k;
}

}  // namespace

TEST_CASE("without what is not asked for a picture is that of the pad's light alone", "[lab]") {
  const PadLight light(test_pad());
  const VirtualRig rig = disturbed(light, [](Rig&) {});
  const SidePainter painter(SideCamera(rig.rig().camera, {}, {}), {}, light.responses().position_m, 3);
  for (const std::size_t k : {std::size_t(0), first_touched(rig) + 3}) {
    const TruthSample& s = rig.truth()[k];
    Eigen::VectorXd seen = light.responses().unloaded;
    if (s.contact >= 0) seen += light.change(s.y_m, s.equivalent_N, s.tilt_rad);
    seen *= light.scale_to(70.0, 220.0);
    CHECK(rig.image(k).pixels == painter.paint(seen, 1.0, 5.0, 0.0, RandomStream(3, 1000 + k)).pixels);
  }
}

TEST_CASE("light of a pad that is exposed like all others grows with its own", "[lab]") {
  PadResponses twice = test_pad();
  twice.unloaded *= 2.0;
  for (auto& m : twice.change) m *= 2.0;
  const PadLight light(test_pad()), brighter(twice);
  const auto one = [](Rig& r) {
    r.camera.exposure_DN = 7e4;  // 35 DN at rest
    r.light.spot_DN = r.light.ambient_DN = 0.0;
    r.camera.black_DN = 0.0;
  };
  const auto own = [&](Rig& r) {
    one(r);
    r.camera.exposure_DN = 0.0;
  };
  CHECK(mean_of(disturbed(brighter, one).image(0)) ==
        Approx(2.0 * mean_of(disturbed(light, one).image(0))).epsilon(0.02));
  CHECK(mean_of(disturbed(brighter, own).image(0)) == Approx(mean_of(disturbed(light, own).image(0))).epsilon(0.001));
}

TEST_CASE("the distorted camera's pixel and ray are each other's inverse", "[lab]") {
  const CameraRig rig;
  const SideGeometry side;
  const SideCamera plain(rig, side, {}), bent(rig, side, {}, 0.4), none(rig, side, {}, 0.0);
  for (const double y : {-25e-3, 3e-3, 20e-3}) {
    const Eigen::Vector2d p = bent.pixel(y, 6e-3);
    CHECK((bent.on_side(p.x(), p.y()) - Eigen::Vector3d(side.half_width_m, y, 6e-3)).norm() < 1e-9);
    CHECK(plain.pixel(y, 6e-3) == none.pixel(y, 6e-3));
    const Eigen::Vector2d straight = plain.off_axis(plain.pixel(y, 6e-3).x(), plain.pixel(y, 6e-3).y()),
                          seen = plain.off_axis(p.x(), p.y());
    CHECK((seen * (1.0 + 0.4 * seen.squaredNorm()) - straight).norm() < 1e-9);
  }
}

TEST_CASE("LEDs that change one by one change the light about them, a shadow the room's about the contact", "[lab]") {
  const PadLight light(test_pad());
  const VirtualRig none = disturbed(light, [](Rig&) {}),
                   lamps = disturbed(light, [](Rig&r) { r.light.one_lamp_sigma = 0.2; }),
                   shadow = disturbed(light,
                       [](Rig&r) {
                         r.light.ambient_DN = 50.0;
                         r.light.shadow = 0.5;
                       }),
                   lit = disturbed(light, [](Rig&r) { r.light.ambient_DN = 50.0; });
  CHECK(none.image(0).pixels != lamps.image(0).pixels);
  CHECK(lit.image(0).pixels == shadow.image(0).pixels);  // nothing touches
  const std::size_t k = first_touched(lit);
  const sense::Image bright = lit.image(k), dark = shadow.image(k);
  const Eigen::Vector2d at = SideCamera(lit.rig().camera, SideGeometry{}, {}).pixel(lit.truth()[k].y_m, 4e-3);
  const auto u = std::size_t(std::lround(at.x()));  // far above the pad, where only the room's light is
  CHECK(int(bright.pixels[u]) - int(dark.pixels[u]) == Approx(25.0).margin(2.0));
}

TEST_CASE("contacts slide, stamps shift and motors cog as asked for, and the session does not know", "[lab]") {
  const PadLight light(test_pad());
  const VirtualRig none = disturbed(light, [](Rig&) {}), all = disturbed(light, [](Rig&r) {
    r.contact.slide_m = 4e-3;
    r.motor.clock_offset_s = 0.02;
    r.motor.cogging_Nm = 0.01;
    r.motor.backlash_rad = 0.002;
    r.assembly = {1e-3, 1e-3, 0.02, 0.1};
  });
  double first = 1.0, last = -1.0;
  for (const TruthSample& s : all.truth())
    if (s.contact == 1) {
      first = std::min(first, s.y_m);
      last = std::max(last, s.y_m);
    }
  CHECK(last - first > 3e-3);
  CHECK(last - first <= 4e-3);
  CHECK(all.joints()[7].stamp_ns - none.joints()[7].stamp_ns == 20'000'000);
  double cogging = 0.0;
  for (std::size_t k = 0; k < 20; ++k)
    cogging = std::max(cogging, std::abs(all.joints()[k].effort[0] - none.joints()[k].effort[0]));
  CHECK(cogging * none.rig().motor.torque_constant_Nm_per_A <= 0.0101);
  CHECK(cogging > 0.0);
  CHECK(all.session().camera_distance_m == none.session().camera_distance_m);
  CHECK(all.session().led_depth_m == none.session().led_depth_m);
  CHECK(all.session().segments.back().y_mm == none.session().segments.back().y_mm);
}

TEST_CASE("light moved along the finger is that of the same shape elsewhere", "[lab]") {
  const PadLight light(test_pad());
  const Eigen::VectorXd here = light.change(4e-3, 10.0), there = light.change(6e-3, 10.0);
  CHECK((light.moved(here, 2e-3) - there).cwiseAbs().maxCoeff() < 1e-2 * there.maxCoeff());
  CHECK((light.moved(here, 0.0) - here).cwiseAbs().maxCoeff() < 1e-12 * here.maxCoeff());
}

TEST_CASE("templates of a computed pad are its responses, mirror images included", "[lab]") {
  const PadResponses pad = test_pad();
  const PadLight light(pad);
  const sense::ResponseTemplates t = templates_of(pad, 0.01);
  REQUIRE(t.place_m.size() == 53);
  CHECK(t.place_m[0] == -26e-3);
  CHECK(t.value[0].col(1) == light.change(-26e-3, 10.0));
  CHECK(
      (t.sideways[30].col(2) - (light.change(t.place_m[30], 20.0, 0.01) - light.change(t.place_m[30], 20.0))).norm() ==
      0.0);
  const sense::TemplateField field(t);
  const auto between = field.at(t.position_m, 7.4e-3, 7.0);
  CHECK((between.value - light.change(7.4e-3, 7.0)).cwiseAbs().maxCoeff() < 0.02 * between.value.maxCoeff());
}
