#pragma once

#include "catch.hpp"

#include "lumo/sense/hand/hand_observer.hpp"
#include "sense/synthetic.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <vector>

/// Pictures of a hand for tests and timings.
namespace synthetic {

using namespace lumo;
using namespace lumo::sense;

/// Two fingers of two links each before a dark ground, in one camera's picture; all lengths in mm, 3 px/mm.
struct HandScene {
  struct Touch {
    int link;
    double y_mm, change_DN;
  };
  static constexpr double px_per_mm = 3.0;
  std::vector<double> joints{0.0, 0.0, 0.0, 0.0};
  std::vector<Touch> touches;
  double lamps = 1.0, slope_DN = 0.0, noise_DN = 1.2;
  int covered = -1;  ///< link whose holes something hides
  std::uint64_t seed = 1;

  /// Middle of a link's pad [px], and where its tip points [rad in the image]. Links 0 and 1 are one finger, 2 and 3
  /// the other.
  std::array<double, 3> pose(int link) const {
    const bool second = link >= 2;
    const double q1 = joints[second ? 2 : 0], q2 = joints[second ? 3 : 1], up = -0.5 * std::numbers::pi;
    const double first = up + q1, length = 35.0 * px_per_mm, x = second ? 470.0 : 170.0, y = 430.0;
    if (link % 2 == 0) return {x + length * std::cos(first), y + length * std::sin(first), first};
    const double turned = first + q2;
    return {x + 2.0 * length * std::cos(first) + length * std::cos(turned),
        y + 2.0 * length * std::sin(first) + length * std::sin(turned), turned};
  }
  static bool clockwise(int link) { return link < 2; }  // the fingers' pads face each other
  static HandLink link(int k) {
    HandLink l;
    l.name = std::to_string(k);
    l.joints = k < 2 ? std::vector<int>{0, 1} : std::vector<int>{2, 3};
    if (k % 2 == 0) l.joints.pop_back();
    l.hole_m = Eigen::Matrix2Xd(2, 2);
    l.hole_m << -22e-3, 22e-3, -4e-3, -4e-3;
    l.z_clockwise = clockwise(k);
    return l;
  }
  LinkMap map(int k) const {
    const auto [x, y, turn] = pose(k);
    return {{x, y}, 1e3 * px_per_mm * Eigen::Vector2d(std::cos(turn), std::sin(turn)), clockwise(k), 0.0};
  }
  Image paint() const {
    Image image = Image::black(640, 480, PixelFormat::grey);
    synthetic::Normal draw(seed);
    for (int v = 0; v < image.height; ++v)
      for (int u = 0; u < image.width; ++u) {
        double light = 15.0;
        for (int k = 0; k < 4; ++k) {
          const auto [x, y, turn] = pose(k);
          const double du = (u - x) / px_per_mm, dv = (v - y) / px_per_mm, s = clockwise(k) ? 1.0 : -1.0;
          const double along = du * std::cos(turn) + dv * std::sin(turn),
                       across = s * (-du * std::sin(turn) + dv * std::cos(turn));
          if (std::abs(along) > 30.0 || across < -8.0 || across > 9.0) continue;
          if (across < 0.0) {
            light = std::hypot(std::abs(along) - 22.0, across + 4.0) < 1.5 && covered != k ? 20.0 : 90.0;
            continue;
          }
          light = lamps * (70.0 + 12.0 * std::cos(along / 11.0 * 2.0 * std::numbers::pi)) + slope_DN * along / 30.0;
          for (const Touch& t : touches)
            if (t.link == k) light += t.change_DN * std::exp(-0.5 * std::pow((along - t.y_mm) / 3.5, 2));
        }
        image.row(v)[u] = std::uint8_t(std::lround(std::clamp(light + noise_DN * draw(), 0.0, 255.0)));
      }
    return image;
  }
  JointVector sample() const {
    JointVector q(4);
    q << joints[0], joints[1], joints[2], joints[3];
    return q;
  }
};

inline std::vector<HandLink> all_links() {
  return {HandScene::link(0), HandScene::link(1), HandScene::link(2), HandScene::link(3)};
}

/// A hand that has seen its workspace in free motion: both fingers together, small steps, so that each picture's holes
/// are near those before.
inline HandObserver practised_hand() {
  HandScene s;
  std::vector<LinkMap> first;
  for (int k = 0; k < 4; ++k) first.push_back(s.map(k));
  HandObserver hand(all_links(), first, {});
  int count = 0;
  for (int i = 0; i <= 4; ++i)
    for (int j = 0; j <= 4; ++j) {
      const double q1 = 0.06 * i, q2 = 0.06 * (i % 2 == 0 ? j : 4 - j);
      s.joints = {q1, q2, -q1, -q2};
      s.seed = std::uint64_t(100 + ++count);
      CHECK(hand.add_reference(s.sample(), s.paint().view()) == 4);
    }
  return hand;
}

}  // namespace synthetic
