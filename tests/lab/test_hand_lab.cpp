#include "catch.hpp"

#include "lab/test_pad.hpp"
#include "lumo/lab/hand_lab.hpp"
#include "lumo/sense/hand/hand_log.hpp"

#include <algorithm>

using namespace lumo;
using namespace lumo::sense;

TEST_CASE("a virtual hand is seen where its joints put it, and is the same twice", "[lab]") {
  const PadLight light(test_pad());
  const HandLab lab(light, hand_plan(3, 2), 3);
  REQUIRE(lab.session().links.size() == 4);
  const Image image = lab.image(0);
  for (int l = 0; l < 4; ++l) {
    const SessionLink& s = lab.session().links[std::size_t(l)];
    const auto found = register_link(image.view(), s.link, LinkMap::fit(s.link.hole_m, s.hole_px, s.link.z_clockwise));
    REQUIRE(found);
    CHECK((found->origin_px - lab.map(l, lab.truth()[0].joints_rad).origin_px).norm() < 0.3);
  }
  CHECK((HandLab(light, hand_plan(3, 2), 3).image(5).pixels == lab.image(5).pixels));
  CHECK((HandLab(light, hand_plan(3, 2), 4).image(5).pixels != lab.image(5).pixels));
  CHECK_NOTHROW(validate(lab.session(), "session"));
  HandPlan far = hand_plan(3, 1);
  far.grasps[0].touches = {{4, 0.0, 5.0}};
  CHECK_THROWS_AS(HandLab(light, far), InvalidArgument);
  far.grasps[0].touches = {{0, 0.5, 5.0}};
  CHECK_THROWS_AS(HandLab(light, far), InvalidArgument);
  far.grasps[0].touches.clear();
  CHECK_NOTHROW(HandLab(light, far));
  far.grasps[0].joints_rad[2] = -1.2;  // outwards, beyond the picture's edge
  CHECK_THROWS_AS(HandLab(light, far), InvalidArgument);
}

TEST_CASE("grasps of a virtual hand: what presses is found on its link and place, and no more", "[lab]") {
  const PadLight light(test_pad());
  Rig rig;
  rig.camera.frames_per_s = 15.0;
  HandPlan plan = hand_plan(1, 5);
  plan.sweep_steps = 5;
  const HandLab lab(light, plan, 1, 1.0, {.rig = rig, .side = {}});
  HandObserver hand = hand_observer(lab.session());
  const std::int64_t free_ns = lab.session().segments.front().to_ns;
  int touched = 0, found = 0, false_alarms = 0, unloaded = 0, seen = 0, links = 0;
  double worst = 0.0;
  for (std::size_t k = 0; k < lab.frames().size(); ++k) {
    const HandTruth& truth = lab.truth()[k];
    JointVector q(4);
    for (int j = 0; j < 4; ++j) q[j] = truth.joints_rad[std::size_t(j)];
    const Image image = lab.image(k);
    if (truth.stamp_ns < free_ns) {
      if (k % 2 == 0) hand.add_reference(q, image.view());
      continue;
    }
    const HandEstimate e = hand.observe(truth.stamp_ns, q, image.view());
    for (const bool s : e.seen) {
      seen += s;
      ++links;
    }
    for (const HandTouch& t : truth.touches) {
      if (t.load_N < 5.0) continue;
      ++touched;
      const auto hit = std::find_if(e.contacts.begin(), e.contacts.end(),
          [&](const HandContact& c) { return c.link == t.link && std::abs(c.y_m - t.y_m) < 8.0_mm; });
      if (hit != e.contacts.end()) {
        ++found;
        worst = std::max(worst, std::abs(hit->y_m - t.y_m));
      }
    }
    unloaded += truth.touches.empty();
    if (truth.touches.empty()) false_alarms += !e.contacts.empty();
  }
  INFO(found << " of " << touched << " touches found, worst " << 1e3 * worst << " mm; " << false_alarms << " alarms in "
             << unloaded << " frames; " << seen << " of " << links << " links seen");
  CHECK(touched > 100);
  CHECK(found >= int(0.95 * touched));
  CHECK(false_alarms <= unloaded / 50);
  CHECK(seen >= int(0.98 * links));
}
