#include "catch.hpp"

#include "lab/test_pad.hpp"
#include "lumo/lab/virtual_rig.hpp"
#include "lumo/sense/force/calibration.hpp"
#include "lumo/sense/profile/finger_view.hpp"

using namespace lumo;
using namespace lumo::sense;

namespace {

LabPlan press_plan() {
  LabPlan plan{"one press, and a look with the LEDs off", 0.0, {}};
  plan.contacts.push_back({0, 0.0, 0, lab_holds({2, 5, 10, 15, 20}, 0.5, 1.0), 0.0, 3.0});
  plan.contacts.push_back({0, 0.0, 1, lab_holds({2}, 0.5, 0.2), 0.0, 2.0, 1});
  plan.views = {LabView{}, LabView{{}, 1.0, 0.0}};
  return plan;
}

}  // namespace

TEST_CASE("stiffness of a specimen comes back from its press curve, with an interval that holds it", "[lab]") {
  // The specimen is what the rig presses; the nominal pad is softer by a known factor. Linear pad: 5 N/mm.
  const PadLight light(test_pad());
  for (const double truth : {0.8, 1.0, 1.25}) {
    int held = 0;
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
      SiliconeRig still;
      still.part = {0.0, 0.0, 0.0};
      Rig rig;
      rig.silicone = still;
      const VirtualRig lab(light, press_plan(), seed, 1.0, rig);
      std::vector<double> depth, force;
      for (std::size_t k = 0; k < lab.markers().size() && 1e-9 * double(lab.markers()[k].stamp_ns) < 10.0; k += 5) {
        depth.push_back(lab.markers()[k].displacement_m);
        force.push_back(-lab.wrenches()[k].force_N.z() - 0.0);
      }
      const StiffnessFit fit = fit_stiffness(depth, force, [&](double d) { return std::max(0.0, d) * 5000.0 / truth; });
      CHECK(fit.factor.value == Approx(truth).epsilon(0.03));
      held += fit.factor.low <= truth && truth <= fit.factor.high;
    }
    CHECK(held >= 10);  // the sensor's offset (0.05 N) is no noise of samples; half of the seeds hold in spite of it
  }
}

TEST_CASE("a stiffer specimen with weaker lamps is one: less depth and less light under the same loads", "[lab]") {
  const PadLight light(test_pad());
  Rig rig, other;
  other.specimen = {1.25, 0.7};
  const VirtualRig nominal(light, press_plan(), 4, 0.0, rig), lab(light, press_plan(), 4, 0.0, other);
  for (std::size_t k = 0; k < lab.truth().size(); ++k) {
    const TruthSample &a = nominal.truth()[k], &b = lab.truth()[k];
    CHECK(b.force_N == a.force_N);
    CHECK(b.equivalent_N == Approx(a.equivalent_N / 1.25).margin(1e-12));
    if (b.contact >= 0) CHECK(b.depth_m == light.depth_m(b.y_m, b.equivalent_N));
  }
  rig.specimen.stiffness = 0.9;  // 20 N on it are 22 N on the computed pad
  CHECK_THROWS_AS(VirtualRig(light, press_plan(), 4, 0.0, rig), InvalidArgument);
}

TEST_CASE("camera gain and lamp level come back from unloaded pictures", "[lab]") {
  const PadLight light(test_pad());
  for (const double shot : {0.02, 0.03, 0.06}) {
    Rig rig;
    rig.camera.shot_DN = shot;
    const VirtualRig lab(light, press_plan(), 5, 1.0, rig);
    PhotonTransfer transfer;
    MeanImage lit, dark;
    for (std::size_t k = 0; k < lab.frames().size(); ++k) {
      const double t = 1e-9 * double(lab.frames()[k].stamp_ns);
      const bool off = lab.truth()[k].contact < 0 && t > 12.0;
      if (t < 2.9 || off) {
        const Image image = lab.image(k);
        if (t < 2.9) {
          transfer.add(image.view());
          lit.add(image.view());
        } else dark.add(image.view());
      }
    }
    const auto r = transfer.result(rig.camera.black_DN);
    CHECK(r.gain_DN_per_electron.value == Approx(shot).epsilon(0.1));
    CHECK(r.gain_DN_per_electron.low < shot);
    CHECK(r.gain_DN_per_electron.high > shot);
    CHECK(r.dark_sigma_DN == Approx(std::sqrt(rig.camera.read_DN * rig.camera.read_DN + 1.0 / 12.0)).epsilon(0.25));
    const LampLevel lamp = lamp_level(lit.image().view(), dark.image().view(), r.gain_DN_per_electron);
    CHECK(lamp.level_DN == Approx(rig.camera.level_DN).epsilon(0.12));  // LEDs' own spots add to the side's light
    CHECK(lamp.electrons.low < lamp.level_DN / shot);
    CHECK(lamp.electrons.high > lamp.level_DN / shot);
  }
}

TEST_CASE("calibrations report what the data leave open", "[lab]") {
  const auto nominal = [](double d) { return std::max(0.0, 5000.0 * d); };
  const std::vector<double> none{0.0, -1e-3, -2e-3, -3e-3}, zero(4, 0.0), one{1e-3, 1e-3, 1e-3, 1e-3}, five(4, 5.0);
  CHECK_THROWS_AS(fit_stiffness(none, zero, nominal), InvalidArgument);
  CHECK_THROWS_AS(fit_stiffness(one, five, nominal), InvalidArgument);  // one depth: stiffness or onset, not both
  PhotonTransfer alike;
  const Image flat = Image::black(20, 20);
  for (int k = 0; k < 10; ++k) alike.add(flat.view());
  CHECK_THROWS_AS(alike.result(), InvalidArgument);
  CHECK_THROWS_AS(lamp_level(flat.view(), flat.view(), {0.03, 0.02, 0.04}), InvalidArgument);
}
