#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/lab/pad_responses.hpp"
#include "lumo/lab/random_stream.hpp"
#include "lumo/lab/side_camera.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/hand/link_map.hpp"
#include "lumo/sense/recording/csv.hpp"
#include "lumo/sense/recording/session.hpp"
#include "lumo/sense/recording/tables.hpp"

#include <Eigen/Core>
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

/// `count` grasps with one to four links touched, drawn from a seed; loads of 5 to 15 N, places within ±22 mm, or the
/// nearest ones of `places_m`.
inline HandPlan hand_plan(std::uint64_t seed, int count = 12, const std::vector<double>& places_m = {}) {
  require_in_range("number of grasps", count, 1, 1000, "");
  HandPlan plan;
  RandomStream draws(seed, 40);
  for (int g = 0; g < count; ++g) {
    HandGrasp grasp;
    for (double& q : grasp.joints_rad)
      q = plan.low_rad + (plan.high_rad - plan.low_rad) * (0.1 + 0.8 * draws.uniform());
    const int links = 1 + g % 4, first = int(4.0 * draws.uniform());
    for (int k = 0; k < links; ++k) {
      double y = (2.0 * draws.uniform() - 1.0) * 22.0_mm;
      const auto nearer = [y](double a, double b) { return std::abs(a - y) < std::abs(b - y); };
      if (!places_m.empty()) y = *std::min_element(places_m.begin(), places_m.end(), nearer);
      grasp.touches.push_back({(first + k) % 4, y, 5.0 + 10.0 * draws.uniform()});
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

/// Two fingers of two links each that bend in the plane of the picture, towards each other; the camera looks along
/// their joints. Every number is assumed. The distance of the fingers and the range of their joints were changed once
/// after the first pictures, in which the fingers ran into each other; all else was fixed before.
struct HandRig {
  Rig rig;                        ///< camera, lamps, specimen and motors, as for one finger
  SideGeometry side;              ///< of the pad on each link
  int width = 640, height = 480;  ///< of the picture [px]
  double scale_m_per_px = 0.55_mm;
  double link_m = 68.0_mm;                         ///< from joint to joint, and from the last joint to the tip
  double base_x_m = 92.0_mm, base_y_m = 120.0_mm;  ///< of the first joints: ± across the picture's middle, and below it
  double carrier_m = 8.0_mm;                       ///< how far the carrier's side reaches behind the pad
  double carrier_DN = 90.0, hole_DN = 14.0, ground_DN = 8.0;
  std::array<double, 2> hole_y_m{-22.0_mm, 22.0_mm};
  double hole_z_m = -4.0_mm, hole_radius_m = 1.8_mm;
  double edge_m = 1.0_mm;          ///< of the pad's side, above and below, that an observer leaves out
  double joint_sigma_rad = 0.002;  ///< σ of a joint's reading
};

/// A hand, a camera and four joints that go through a plan and leave a log as a real rig would. All four links carry
/// the same pad, whose light comes from computed responses, in equilibrium (no relaxation). A pure function of
/// responses, plan, seed and `noise`.
class HandLab {
 public:
  /// `light` stays the caller's. Throws InvalidArgument for places and loads beyond those computed, or a grasp in which
  /// a link leaves the picture.
  HandLab(const PadLight& light, HandPlan plan, std::uint64_t seed = 1, double noise = 1.0, const HandRig& hand = {});

  const sense::Session& session() const { return session_; }
  const std::vector<sense::FrameRecord>& frames() const { return frames_; }
  const std::vector<sense::JointSample>& joints() const { return joints_; }
  const std::vector<HandTruth>& truth() const { return truth_; }
  const HandPlan& plan() const { return plan_; }
  /// Picture k; the same whenever it is asked for.
  sense::Image image(std::size_t k) const;
  /// Where a link really is in the image.
  sense::LinkMap map(int link, const HandJoints& joints) const;

 private:
  // Times of every plan; assumed.
  static constexpr double first_rest_s = 0.5, pause_s = 0.3, settle_s = 0.05, first_frame_s = 0.01;

  void check_plan() const;
  void sweep_workspace();
  void describe_links();
  void close_grasps();
  void record_frames();
  void record_joints();
  void add_segment(double from_s, double to_s, sense::SegmentKind kind) {
    session_.segments.push_back({lab_stamp(from_s), lab_stamp(to_s), kind});
  }

  struct Key {
    double t_s;
    HandJoints joints;
    int grasp;     ///< whose touches there are, −1: none
    double share;  ///< of their loads
  };
  void move_to(const HandJoints& joints) {
    double way = 0.0;
    for (std::size_t k = 0; k < 4; ++k) way = std::max(way, std::abs(joints[k] - keys_.back().joints[k]));
    keys_.push_back({keys_.back().t_s + way / plan_.speed_rad_per_s + settle_s, joints, -1, 0.0});
  }
  HandTruth at(double t_s) const;
  void require_seen(const HandJoints& joints) const {
    for (int l = 0; l < 4; ++l)
      for (const double y : {-hand_.side.half_length_m, hand_.side.half_length_m})
        for (const double z : {-hand_.carrier_m, hand_.side.high_m}) {
          const auto p = map(l, joints).pixel(y, z);
          if (!(p.x() >= 0.0 && p.y() >= 0.0 && p.x() <= hand_.width - 1 && p.y() <= hand_.height - 1))
            throw InvalidArgument(message("link ", l, " leaves the picture at ", p.x(), ", ", p.y(), " px of ",
                hand_.width, " x ", hand_.height));
        }
  }

  const PadLight* light_;
  HandPlan plan_;
  std::uint64_t seed_;
  double noise_, per_DN_;
  HandRig hand_;
  sense::Session session_;
  std::vector<Key> keys_;
  std::vector<sense::FrameRecord> frames_;
  std::vector<sense::JointSample> joints_;
  std::vector<HandTruth> truth_;
  std::vector<double> lamps_, room_DN_;
};

inline auto HandLab::map(int link, const HandJoints& joints) const -> sense::LinkMap {
  const bool right = link >= 2;
  const double inwards = right ? -1.0 : 1.0, length = hand_.link_m / hand_.scale_m_per_px;
  Eigen::Vector2d at(0.5 * (hand_.width - 1) + (right ? 1.0 : -1.0) * hand_.base_x_m / hand_.scale_m_per_px,
      0.5 * (hand_.height - 1) + hand_.base_y_m / hand_.scale_m_per_px);
  double turn = -0.5 * pi + inwards * joints[right ? 2 : 0];  // image rows run down: −90° points up
  if (link % 2 == 1) {
    at += length * Eigen::Vector2d(std::cos(turn), std::sin(turn));
    turn += inwards * joints[std::size_t(link)];
  }
  const Eigen::Vector2d along(std::cos(turn), std::sin(turn));
  sense::LinkMap m;
  m.origin_px = at + 0.5 * length * along;
  m.along_px_per_m = along / hand_.scale_m_per_px;
  m.z_clockwise = !right;  // the pads face each other
  return m;
}

inline HandLab::HandLab(const PadLight& light, HandPlan plan, std::uint64_t seed, double noise, const HandRig& hand)
    : light_(&light),
      plan_(std::move(plan)),
      seed_(seed),
      noise_(noise),
      per_DN_(light.exposure(hand.rig.camera)),
      hand_(hand) {
  check_plan();
  session_.title = plan_.title;
  session_.clock = "virtual";
  session_.material = light.responses().material;
  session_.theta_mm = light.responses().theta_mm;
  session_.torque_constant_Nm_per_A.assign(4, hand_.rig.motor.torque_constant_Nm_per_A);
  sweep_workspace();
  describe_links();
  close_grasps();
  record_frames();
  record_joints();
}

inline void HandLab::check_plan() const {
  validate(hand_.rig);
  require_in_range("noise of the virtual lab", noise_, 0.0, 100.0, "");
  require_in_range("steps of the hand's sweep", plan_.sweep_steps, 2, 100, "");
  require_positive("speed of the hand's joints", plan_.speed_rad_per_s, "rad/s");
  for (const HandGrasp& g : plan_.grasps) {
    require_seen(g.joints_rad);
    for (const HandTouch& c : g.touches) {
      require_in_range("link of a touch", c.link, 0, 3, "");
      light_->require_reached("place of a touch", c.y_m);
      require_in_range("load of a touch", c.load_N, 0.0, hand_.rig.specimen.bears_N(light_->max_load_N()), "N");
    }
  }
}

inline void HandLab::sweep_workspace() {
  // Both fingers alike, to and fro.
  const auto node = [&](int k) {
    return plan_.low_rad + (plan_.high_rad - plan_.low_rad) * k / (plan_.sweep_steps - 1);
  };
  keys_.push_back({0.0, {plan_.low_rad, plan_.low_rad, plan_.low_rad, plan_.low_rad}, -1, 0.0});
  keys_.push_back({first_rest_s, keys_.back().joints, -1, 0.0});
  for (int i = 0; i < plan_.sweep_steps; ++i)
    for (int j = 0; j < plan_.sweep_steps; ++j) {
      const double a = node(i), b = node(i % 2 == 0 ? j : plan_.sweep_steps - 1 - j);
      move_to({a, b, a, b});
    }
  add_segment(0.0, keys_.back().t_s, sense::SegmentKind::free);
}

inline void HandLab::describe_links() {
  for (int l = 0; l < 4; ++l) {
    const bool right = l >= 2;
    sense::SessionLink s;
    s.link.name = std::string(right ? "right" : "left") + (l % 2 == 0 ? " proximal" : " distal");
    s.link.joints = l % 2 == 0 ? std::vector<int>{l} : std::vector<int>{l - 1, l};
    s.link.hole_m.resize(2, 2);
    s.hole_px.resize(2, 2);
    s.link.hole_radius_m = hand_.hole_radius_m;
    s.link.z_clockwise = !right;
    s.link.z_low_m = hand_.side.low_m + hand_.edge_m;
    s.link.z_high_m = hand_.side.high_m - hand_.edge_m;
    for (int k = 0; k < 2; ++k) {
      s.link.hole_m.col(k) << hand_.hole_y_m[std::size_t(k)], hand_.hole_z_m;
      s.hole_px.col(k) =
          map(l, keys_.front().joints).pixel(hand_.hole_y_m[std::size_t(k)], hand_.hole_z_m).array().round();
    }
    session_.links.push_back(std::move(s));
  }
}

inline void HandLab::close_grasps() {
  for (int g = 0; g < int(plan_.grasps.size()); ++g) {
    const HandGrasp& grasp = plan_.grasps[std::size_t(g)];
    move_to(grasp.joints_rad);
    double t = keys_.back().t_s;
    keys_.push_back({t + pause_s, grasp.joints_rad, -1, 0.0});
    t += pause_s;
    keys_.push_back({t, grasp.joints_rad, g, 0.0});
    keys_.push_back({t + plan_.close_s, grasp.joints_rad, g, 1.0});
    keys_.push_back({t + plan_.close_s + plan_.hold_s, grasp.joints_rad, g, 1.0});
    keys_.push_back({t + 2.0 * plan_.close_s + plan_.hold_s, grasp.joints_rad, g, 0.0});
    add_segment(t + plan_.close_s, t + plan_.close_s + plan_.hold_s, sense::SegmentKind::hold);
  }
}

inline void HandLab::record_frames() {
  const CameraRig& c = hand_.rig.camera;
  const LightRig& l = hand_.rig.light;
  LampNoise lamps(l, seed_, 48);
  SlowNoise room(RandomStream(seed_, 49), l.ambient_drift_s);
  RandomStream jitter(seed_, 51);
  for (double t = first_frame_s; t < keys_.back().t_s; t += 1.0 / c.frames_per_s) {
    HandTruth truth = at(t);
    truth.stamp_ns = lab_stamp(t + noise_ * c.stamp_sigma_s * jitter.normal());
    frames_.push_back({truth.stamp_ns, sense::frame_file(frames_.size()), c.exposure_s, c.gain});
    truth_.push_back(std::move(truth));
    lamps_.push_back(hand_.rig.specimen.lamps * (1.0 + noise_ * lamps.at(t)));
    room_DN_.push_back(l.ambient_DN * (1.0 + noise_ * l.ambient_drift * room.at(t)));
  }
}

inline void HandLab::record_joints() {
  RandomStream read(seed_, 52);
  HandJoints before = keys_.front().joints;
  for (double t = 0.0; t < keys_.back().t_s; t += 1.0 / hand_.rig.motor.hz) {
    const HandTruth now = at(t);
    sense::JointSample s{lab_stamp(t), sense::JointVector(4), sense::JointVector(4), sense::JointVector::Zero(4),
        sense::Effort::current_A};
    for (int k = 0; k < 4; ++k) {
      s.position_rad[k] = now.joints_rad[std::size_t(k)] + noise_ * hand_.joint_sigma_rad * read.normal();
      s.velocity_rad_per_s[k] = (now.joints_rad[std::size_t(k)] - before[std::size_t(k)]) * hand_.rig.motor.hz;
    }
    before = now.joints_rad;
    joints_.push_back(std::move(s));
  }
}

inline auto HandLab::at(double t_s) const -> HandTruth {
  std::size_t k = 0;
  while (k + 2 < keys_.size() && keys_[k + 1].t_s <= t_s) ++k;
  const Key &a = keys_[k], &b = keys_[k + 1];
  const double share = b.t_s > a.t_s ? std::clamp((t_s - a.t_s) / (b.t_s - a.t_s), 0.0, 1.0) : 1.0;
  HandTruth truth;
  for (std::size_t j = 0; j < 4; ++j) truth.joints_rad[j] = a.joints[j] + share * (b.joints[j] - a.joints[j]);
  const double load = a.share + share * (b.share - a.share);
  if (a.grasp >= 0 && a.grasp == b.grasp && load > 0.0)
    for (HandTouch c : plan_.grasps[std::size_t(a.grasp)].touches) {
      c.load_N *= load;
      truth.touches.push_back(c);
    }
  return truth;
}

inline sense::Image HandLab::image(std::size_t k) const {
  struct Seen {
    sense::LinkMap map;
    double c, s;  ///< cosine and sine of its turn
    Eigen::VectorXd light;
  };
  const HandTruth& truth = truth_.at(k);
  std::vector<Seen> links;
  for (int l = 0; l < 4; ++l) {
    Eigen::VectorXd light = light_->responses().unloaded;
    for (const HandTouch& c : truth.touches)
      if (c.link == l) light += light_->change(c.y_m, c.load_N / hand_.rig.specimen.stiffness, 0.0);
    const sense::LinkMap m = map(l, truth.joints_rad);
    const double scale = m.px_per_m();
    links.push_back({m, m.along_px_per_m.x() / scale, m.along_px_per_m.y() / scale, per_DN_ * lamps_[k] * light});
  }
  const Eigen::VectorXd& position = light_->responses().position_m;
  const double spacing = position[1] - position[0], blur = hand_.rig.camera.blur_px * hand_.scale_m_per_px,
               room = room_DN_[k];
  const auto edge = [&](double distance) { return std::clamp(0.5 + 0.5 * distance / (1.5 * blur), 0.0, 1.0); };
  sense::Image image = sense::Image::black(hand_.width, hand_.height, sense::PixelFormat::grey);
  RandomStream draws(seed_, 100000 + k), sensitivity(seed_, 53);
  for (int v = 0; v < hand_.height; ++v) {
    std::uint8_t* row = image.row(v);
    const double row_offset = noise_ * hand_.rig.camera.row_DN * draws.normal();
    for (int u = 0; u < hand_.width; ++u) {
      double signal = hand_.ground_DN;
      for (const Seen& l : links) {
        const double du = (u - l.map.origin_px.x()) * hand_.scale_m_per_px,
                     dv = (v - l.map.origin_px.y()) * hand_.scale_m_per_px, side = l.map.z_clockwise ? 1.0 : -1.0;
        const double y = du * l.c + dv * l.s, z = side * (-du * l.s + dv * l.c),
                     end = hand_.side.half_length_m - std::abs(y);
        if (end < -3.0 * blur || z < -hand_.carrier_m - 3.0 * blur || z > hand_.side.high_m + 3.0 * blur) continue;
        const double carrier = edge(end) * edge(hand_.side.low_m - z) * edge(z + hand_.carrier_m),
                     pad = edge(end) * edge(z - hand_.side.low_m) * edge(hand_.side.high_m - z);
        double hole = 0.0;
        for (const double at : hand_.hole_y_m)
          hole = std::max(hole, edge(hand_.hole_radius_m - std::hypot(y - at, z - hand_.hole_z_m)));
        const double behind = std::max(carrier, pad);
        signal =
            (1.0 - behind) * signal + carrier * (hole * hand_.hole_DN + (1.0 - hole) * hand_.carrier_DN) + pad * room;
        if (pad > 0.0) {
          const double place = std::clamp((y - position[0]) / spacing, 0.0, double(position.size() - 1) - 1e-9);
          const auto bin = Eigen::Index(place);
          signal += pad * ((1.0 - (place - double(bin))) * l.light[bin] + (place - double(bin)) * l.light[bin + 1]);
          for (const double at : hand_.side.lamp_m) {
            const double d = std::hypot(y - at, z - hand_.side.lamp_height_m) / hand_.rig.light.spot_sigma_m;
            if (d < 5.0) signal += pad * lamps_[k] * hand_.rig.light.spot_DN * std::exp(-0.5 * d * d);
          }
        }
      }
      signal *= 1.0 + noise_ * hand_.rig.camera.pixel_gain * sensitivity.normal();
      row[u] = sensed(hand_.rig.camera, signal, noise_, draws.normal(), row_offset);
    }
  }
  return image;
}

}  // namespace lumo
