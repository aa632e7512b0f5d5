#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/lab/random_stream.hpp"
#include "lumo/sense/recording/csv.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace lumo {

using HandJoints = std::array<double, 4>;  ///< proximal and distal of the left finger, then of the right; bending
                                           ///< inwards is positive [rad]

/// Something that presses on a link: 0 and 1 are the left finger's, from proximal to distal, 2 and 3 the right one's.
struct HandTouch {
  int link;
  double y_m, load_N;
};

/// A grasp: what the hand looks like while it holds, and what presses where.
struct HandGrasp {
  HandJoints joints_rad;
  std::vector<HandTouch> touches;
};

/// The joints sweep their workspace without contact, then grasp after grasp is closed, held and opened.
struct HandPlan {
  std::string title = "grasps of a hand with two fingers";
  int sweep_steps = 6;                   ///< of each joint, there and back
  double low_rad = 0.0, high_rad = 0.4;  ///< of the sweep; the fingers then do not meet
  double speed_rad_per_s = 0.5;
  double close_s = 0.4, hold_s = 0.8;
  std::vector<HandGrasp> grasps;
};

/// `count` grasps with one to four links touched, drawn from a seed; loads of 5 to 15 N, places within ±22 mm; where
/// `step_m` is not 0, at its nearest multiple.
inline HandPlan hand_plan(std::uint64_t seed, int count = 12, double step_m = 0.0) {
  require_in_range("number of grasps", count, 1, 1000, "");
  require_in_range("step of the touched places", 1e3 * step_m, 0.0, 22.0, "mm");
  HandPlan plan;
  RandomStream draws(seed, 40);
  for (int g = 0; g < count; ++g) {
    HandGrasp grasp;
    for (double& q : grasp.joints_rad)
      q = plan.low_rad + (plan.high_rad - plan.low_rad) * (0.1 + 0.8 * draws.uniform());
    const int links = 1 + g % 4, first = int(4.0 * draws.uniform());
    for (int k = 0; k < links; ++k) {
      const double y = (2.0 * draws.uniform() - 1.0) * 22.0_mm;
      grasp.touches.push_back(
          {(first + k) % 4, step_m > 0.0 ? step_m * std::round(y / step_m) : y, 5.0 + 10.0 * draws.uniform()});
    }
    std::sort(grasp.touches.begin(), grasp.touches.end(),
        [](const HandTouch& a, const HandTouch& b) { return a.link < b.link; });
    plan.grasps.push_back(std::move(grasp));
  }
  return plan;
}

/// What really pressed on the hand at a frame.
struct HandTruth {
  std::int64_t stamp_ns = 0;
  HandJoints joints_rad{};
  std::vector<HandTouch> touches;  ///< with the loads of this moment
};

/// truth.csv of a hand: stamp_ns, link, y_mm, force_N; a row for each touch of each frame.
inline std::string truth_text(const std::vector<HandTruth>& truth) {
  std::string t = "stamp_ns,link,y_mm,force_N\n";
  for (const HandTruth& s : truth)
    for (const HandTouch& c : s.touches)
      t += std::to_string(s.stamp_ns) + ',' + std::to_string(c.link) + ',' + sense::csv_number(1e3 * c.y_m) + ',' +
           sense::csv_number(c.load_N) + '\n';
  return t;
}

}  // namespace lumo
