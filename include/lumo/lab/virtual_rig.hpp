#pragma once

#include "lumo/lab/pad_responses.hpp"
#include "lumo/lab/protocol.hpp"
#include "lumo/lab/random_stream.hpp"
#include "lumo/lab/rig.hpp"
#include "lumo/lab/side_camera.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/recording/csv.hpp"
#include "lumo/sense/recording/session.hpp"
#include "lumo/sense/recording/tables.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace lumo {

/// What was really so at a frame: for comparisons with estimates, never for their making.
struct TruthSample {
  std::int64_t stamp_ns = 0;
  int contact = -1;  ///< number in the plan; −1: none
  double y_m = 0.0, force_N = 0.0, tilt_rad = 0.0;
  double equivalent_N = 0.0;  ///< load that in equilibrium gives the deformation there is
  double depth_m = 0.0;
};

/// truth.csv: stamp_ns, contact, y_mm, force_N, tilt_deg, equivalent_N, depth_mm.
inline std::string truth_text(const std::vector<TruthSample>& truth) {
  std::string t = "stamp_ns,contact,y_mm,force_N,tilt_deg,equivalent_N,depth_mm\n";
  for (const TruthSample& s : truth) {
    t += std::to_string(s.stamp_ns) + ',' + std::to_string(s.contact);
    for (const double v : {1e3 * s.y_m, s.force_N, s.tilt_rad * 180.0 / pi, s.equivalent_N, 1e3 * s.depth_m})
      t += ',' + sense::csv_number(v);
    t += '\n';
  }
  return t;
}

/// A pad, a camera, a motor and an indenter that go through a plan and leave a log as a real rig would. All light comes
/// from computed responses. A pure function of responses, plan, seed and `noise`, which multiplies every σ of the
/// rig.
class VirtualRig {
 public:
  /// `light` stays the caller's. Throws InvalidArgument for numbers out of range, or loads and places beyond
  /// those computed.
  VirtualRig(const PadLight& light, LabPlan plan, std::uint64_t seed = 1, double noise = 1.0, Rig rig = {},
      SideGeometry side = {});

  const sense::Session& session() const { return session_; }
  const std::vector<sense::FrameRecord>& frames() const { return frames_; }
  const std::vector<sense::JointSample>& joints() const { return joints_; }
  const std::vector<sense::WrenchSample>& wrenches() const { return wrenches_; }
  const std::vector<sense::MarkerSample>& markers() const { return markers_; }
  const std::vector<TruthSample>& truth() const { return truth_; }
  const Rig& rig() const { return rig_; }
  const LabPlan& plan() const { return plan_; }
  /// Picture k; the same whenever it is asked for.
  sense::Image image(std::size_t k) const;

 private:
  // Times of every plan; assumed.
  static constexpr double settle_s = 0.5, margin_s = 0.02;  ///< cut from an unloaded stretch's start (at most) and end
  static constexpr double settling_share = 0.2;             ///< of a hold, cut from its start: the pad creeps
  static constexpr double release_s = 0.2, last_rest_s = 1.0, first_frame_s = 0.01;
  static constexpr int most_trials = 1000;  ///< to place the camera so that it shows the side

  struct Contact {
    double y_m, tilt_rad, stick_Nm;
    std::vector<double> load_N;       ///< of each step, as it came out
    double from_s = 0.0, to_s = 1.0;  ///< first touch and leaving
  };
  /// Load over a stretch of time, linear.
  struct Phase {
    double from_s, to_s, from_N, to_N;
    int contact;
  };
  struct Sampled {
    double load_N, equivalent_N;
    int contact;
  };

  void draw_contacts();
  void lay_out_time();
  void add_segment(double from_s, double to_s, sense::SegmentKind kind) {
    session_.segments.push_back({lab_stamp(from_s), lab_stamp(to_s), kind});
  }
  void add_segment(double reached_s, const LabContact& c, std::size_t step);
  void deform();
  void record_joints();
  void record_forces();
  void place_cameras(RandomStream& once);
  void record_frames();
  Sampled at(double t_s) const;
  /// Where the finger is touched at a time.
  double place_m(int contact, double t_s) const;
  Eigen::VectorXd side_light(const TruthSample& s, const Eigen::VectorXd& lamps) const;
  Eigen::VectorXd one_by_one(const Eigen::VectorXd& light, const Eigen::VectorXd& lamps) const;

  const PadLight* light_;
  LabPlan plan_;
  std::uint64_t seed_;
  double noise_;
  Rig rig_;
  SideGeometry side_;
  sense::Session session_;
  std::vector<Contact> contacts_;
  std::vector<Phase> phases_;
  std::vector<Sampled> sampled_;  ///< at the joint's rate
  std::vector<SidePainter> painters_;
  std::vector<sense::FrameRecord> frames_;
  std::vector<TruthSample> truth_;
  std::vector<int> view_;                     ///< of each frame
  std::vector<double> lamps_, room_DN_;       ///< at each frame
  std::vector<Eigen::VectorXd> lamp_change_;  ///< at each frame, of each LED by itself, relative; empty: none
  double pad_off_m_ = 0.0, strip_off_m_ = 0.0;
  std::vector<sense::JointSample> joints_;
  std::vector<sense::WrenchSample> wrenches_;
  std::vector<sense::MarkerSample> markers_;
  double end_s_ = 0.0, per_DN_ = 1.0;
};

/// The rig's camera as frames come from it. The rig stays the caller's.
class VirtualCamera {
 public:
  explicit VirtualCamera(const VirtualRig& rig) : rig_(&rig) {}

  std::optional<sense::Frame> next() {
    if (next_ == rig_->frames().size()) return std::nullopt;
    image_ = rig_->image(next_);
    const sense::FrameRecord& f = rig_->frames()[next_];
    return sense::Frame{image_.view(), f.stamp_ns, f.exposure_s, f.gain, std::int64_t(next_++)};
  }
  sense::StreamState state() const {
    return next_ == rig_->frames().size() ? sense::StreamState::ended : sense::StreamState::open;
  }

 private:
  const VirtualRig* rig_;
  sense::Image image_;
  std::size_t next_ = 0;
};

static_assert(sense::Camera<VirtualCamera>);

inline VirtualRig::VirtualRig(
    const PadLight& light, LabPlan plan, std::uint64_t seed, double noise, Rig rig, SideGeometry side)
    : light_(&light), plan_(std::move(plan)), seed_(seed), noise_(noise), rig_(rig), side_(std::move(side)) {
  validate(rig_);
  require_in_range("noise of the virtual lab", noise_, 0.0, 100.0, "");
  require_in_range("frames of a plan", plan_.frames_per_s, 0.0, 1000.0, "1/s");
  for (const LabContact& c : plan_.contacts) {
    light.require_reached("place of a contact", c.y_m);
    require_in_range("view of a contact", c.view, 0, double(plan_.views.size()) - 1.0, "");
    require_in_range("place's number", c.place, 0, 1000, "");
    for (const LoadStep& s : c.steps) {
      require_in_range("load of a contact", s.load_N, 0.0, rig_.specimen.bears_N(light.max_load_N()), "N");
      require_positive("time to reach a load", s.ramp_s, "s");
    }
  }
  const PadResponses& r = light.responses();
  per_DN_ = light.exposure(rig_.camera);

  session_.title = plan_.title;
  session_.clock = "virtual";
  session_.material = r.material;
  session_.theta_mm = r.theta_mm;
  session_.joint_to_origin_m = rig_.motor.joint_to_origin_m;
  session_.led_depth_m = side_.half_width_m;
  session_.camera_distance_m = rig_.camera.distance_m;
  session_.torque_constant_Nm_per_A.assign(std::size_t(rig_.motor.joints), rig_.motor.torque_constant_Nm_per_A);
  if (rig_.motor.joints == 2) session_.joint_to_joint_m = {rig_.motor.joint_to_joint_m};
  draw_contacts();
  lay_out_time();
  deform();
  record_joints();
  record_forces();
  record_frames();
}

inline void VirtualRig::draw_contacts() {
  RandomStream draws(seed_, 1);
  const auto [from, to] = light_->reach_m();
  for (const LabContact& c : plan_.contacts) {
    const double y = c.y_m + noise_ * rig_.contact.place_sigma_m * draws.normal(),
                 tilt = c.angle_rad + noise_ * rig_.contact.tilt_sigma_rad * draws.normal();
    contacts_.push_back({std::clamp(y, from, to), tilt, noise_ * rig_.motor.stiction_Nm * draws.normal(), {}});
    for (const LoadStep& s : c.steps)
      contacts_.back().load_N.push_back(std::min(rig_.specimen.bears_N(light_->max_load_N()),
          s.load_N * (1.0 + noise_ * rig_.contact.load_sigma * draws.normal())));
  }
}

inline void VirtualRig::lay_out_time() {
  double t = plan_.free_run_s;
  if (t > 0.0) add_segment(0.0, t, sense::SegmentKind::free);
  for (std::size_t i = 0; i < plan_.contacts.size(); ++i) {
    const LabContact& c = plan_.contacts[i];
    phases_.push_back({t, t + c.rest_s, 0.0, 0.0, -1});
    const double from = t + std::min(settle_s, 0.5 * c.rest_s), to = t + c.rest_s - margin_s;
    add_segment(from, to, sense::SegmentKind::unloaded);
    if (plan_.views[std::size_t(c.view)].lamps == 0.0) add_segment(from, to, sense::SegmentKind::dark);
    t += c.rest_s;
    contacts_[i].from_s = t;
    double load = 0.0;
    for (std::size_t k = 0; k < c.steps.size(); ++k) {
      const LoadStep& s = c.steps[k];
      phases_.push_back({t, t + s.ramp_s, load, contacts_[i].load_N[k], int(i)});
      t += s.ramp_s;
      load = contacts_[i].load_N[k];
      phases_.push_back({t, t + s.hold_s, load, load, int(i)});
      add_segment(t, c, k);
      t += s.hold_s;
    }
    phases_.push_back({t, t + release_s, load, 0.0, int(i)});
    t += release_s;
    contacts_[i].to_s = t;
  }
  phases_.push_back({t, t + last_rest_s, 0.0, 0.0, -1});
  end_s_ = t + last_rest_s;
}

/// Of a step whose load is reached at that time.
inline void VirtualRig::add_segment(double reached_s, const LabContact& c, std::size_t step) {
  const LoadStep& s = c.steps[step];
  const bool cycle = s.kind == sense::SegmentKind::cycle;
  const std::int64_t to_ns = lab_stamp(reached_s + s.hold_s);
  if (cycle && step > 0 && c.steps[step - 1].kind == s.kind && c.steps[step - 1].cycle == s.cycle) {
    sense::Segment& begun = session_.segments.back();
    begun.to_ns = to_ns;
    begun.load_N = std::max(begun.load_N, s.load_N);
    return;
  }
  const double from_s = cycle ? reached_s - s.ramp_s : reached_s + settling_share * s.hold_s;
  session_.segments.push_back({lab_stamp(from_s), to_ns, s.kind, c.place, 1e3 * c.y_m, c.repetition, s.cycle, s.load_N,
      c.angle_rad * 180.0 / pi, 1e3 * light_->responses().diameter_m});
}

inline void VirtualRig::deform() {
  int places = 1;
  for (const LabContact& c : plan_.contacts) places = std::max(places, c.place + 1);
  std::vector<Relaxation> pad(std::size_t(places), Relaxation(rig_.silicone));  // a place remembers its own contacts
  const double dt = 1.0 / rig_.motor.hz;
  std::size_t phase = 0;
  for (double t = 0.0; t < end_s_; t += dt) {
    while (phase + 1 < phases_.size() && t >= phases_[phase].to_s) ++phase;
    Sampled s{0.0, 0.0, -1};
    if (const Phase& p = phases_[phase]; p.contact >= 0 && t >= p.from_s)
      s = {p.from_N + (p.to_N - p.from_N) * std::clamp((t - p.from_s) / (p.to_s - p.from_s), 0.0, 1.0), 0.0, p.contact};
    const int place = s.contact < 0 ? -1 : plan_.contacts[std::size_t(s.contact)].place;
    for (int k = 0; k < places; ++k) {
      const double equivalent = pad[std::size_t(k)].step(k == place ? s.load_N / rig_.specimen.stiffness : 0.0, dt);
      if (k == place) s.equivalent_N = equivalent;
    }
    sampled_.push_back(s);
  }
}

inline auto VirtualRig::at(double t_s) const -> Sampled {
  const double index = std::clamp(t_s * rig_.motor.hz, 0.0, double(sampled_.size() - 1));
  const auto i = std::size_t(index), j = std::min(i + 1, sampled_.size() - 1);
  const Sampled &a = sampled_[i], &b = sampled_[j];
  const double share = index - double(i);
  if (a.contact != b.contact) return share < 0.5 ? a : b;
  return {
      a.load_N + share * (b.load_N - a.load_N), a.equivalent_N + share * (b.equivalent_N - a.equivalent_N), a.contact};
}

inline double VirtualRig::place_m(int contact, double t_s) const {
  const Contact& c = contacts_[std::size_t(contact)];
  if (rig_.contact.slide_m == 0.0) return c.y_m;
  const auto [from, to] = light_->reach_m();
  return std::clamp(c.y_m + rig_.contact.slide_m * (t_s - c.from_s) / (c.to_s - c.from_s), from, to);
}

/// Joint by joint: what sticks and errs is each one's own.
inline void VirtualRig::record_joints() {
  const MotorRig& m = rig_.motor;
  const double dt = 1.0 / m.hz;
  for (std::size_t i = 0; i < sampled_.size(); ++i)
    joints_.push_back({lab_stamp(double(i) * dt + m.clock_offset_s), sense::JointVector(m.joints),
        sense::JointVector(m.joints), sense::JointVector(m.joints), sense::Effort::current_A});
  for (int joint = 0; joint < m.joints; ++joint) {
    const bool last_joint = joint + 1 == m.joints;
    const std::uint64_t stream = last_joint ? 2 : 60;
    RandomStream once(seed_, stream), draws(seed_, stream + 1), stick(seed_, stream + 2), own(seed_, stream + 3);
    const double constant = m.torque_constant_Nm_per_A * (1.0 + noise_ * m.constant_sigma * once.normal()),
                 bias = noise_ * m.bias_Nm * once.normal();
    // Both hold the same angle, so that the pad's link is turned against the one before it.
    const double before = last_joint ? 0.0 : m.joint_to_joint_m * std::cos(m.hold_rad);
    std::vector<double> sticks;  // under each contact
    for (const Contact& c : contacts_)
      sticks.push_back(last_joint ? c.stick_Nm : noise_ * m.stiction_Nm * own.normal());
    const double cogging_phase = 2.0 * pi * RandomStream(seed_, stream + 200).uniform();
    double rest_stick = 0.0, last_load = 0.0;
    int last = -1;
    bool moving = false;
    for (std::size_t i = 0; i < sampled_.size(); ++i) {
      const double t = double(i) * dt;
      const Sampled& s = sampled_[i];
      if (s.contact < 0 && (last >= 0 || i == 0)) rest_stick = noise_ * m.stiction_Nm * stick.normal();
      last = s.contact;
      const double arm = s.contact < 0 ? 0.0 : before + m.joint_to_origin_m + place_m(s.contact, t),
                   load = s.load_N * arm;
      double q = m.hold_rad - load / m.stiffness_Nm_per_rad, v = -(load - last_load) / m.stiffness_Nm_per_rad / dt,
             friction = s.contact < 0 ? rest_stick : sticks[std::size_t(s.contact)];
      if (i == 0) v = 0.0;
      last_load = load;
      if (t < plan_.free_run_s) {
        const auto& [beat, sweep, swing, rest_velocity] = m.free_run;
        const double k = std::floor(t / beat), phase = std::min((t - k * beat) / sweep, 1.0),
                     way = std::fmod(k, 2.0) == 0.0 ? 1.0 : -1.0;
        q = m.hold_rad - way * swing * std::cos(pi * phase);
        v = phase < 1.0 ? way * swing * pi / sweep * std::sin(pi * phase) : 0.0;
        if (phase >= 1.0 && moving) rest_stick = noise_ * m.stiction_Nm * stick.normal();
        moving = phase < 1.0;
        friction = moving ? m.coulomb_Nm * std::tanh(v / rest_velocity) + m.viscous_Nm_s_per_rad * v : rest_stick;
      }
      if (m.backlash_rad > 0.0) q -= (s.contact < 0 ? 0.0 : 0.5) * m.backlash_rad;  // pressed against the other flank
      double torque = load + m.weight_Nm * std::sin(q) + friction + bias + noise_ * m.white_Nm * draws.normal();
      if (m.cogging_Nm > 0.0) torque += m.cogging_Nm * std::sin(m.cogging_periods * q + cogging_phase);
      sense::JointSample& sample = joints_[i];
      sample.position_rad[joint] = q;
      sample.velocity_rad_per_s[joint] = v + noise_ * m.velocity_sigma_rad_per_s * draws.normal();
      sample.effort[joint] = torque / constant;
    }
  }
}

inline void VirtualRig::record_forces() {
  const ContactRig& c = rig_.contact;
  RandomStream draws(seed_, 5);
  const double bias = noise_ * c.sensor_bias_N * draws.normal();
  for (double t = 0.0; t < end_s_; t += 1.0 / c.sensor_hz) {
    const Sampled s = at(t);
    const double y = s.contact < 0 ? 0.0 : place_m(s.contact, t);
    const auto jitter = [&] { return noise_ * c.sensor_sigma_N * draws.normal(); };
    const double fx = jitter(), fy = jitter(), fz = -s.load_N + bias + jitter();
    wrenches_.push_back({lab_stamp(t), Vec3d(fx, fy, fz), Vec3d(-y * s.load_N, 0.0, 0.0)});
    const double sunk = s.contact < 0 ? 0.0 : light_->depth_m(y, s.equivalent_N);
    markers_.push_back({lab_stamp(t), sunk + noise_ * c.marker_sigma_m * draws.normal()});
  }
}

/// Cameras for all views, and the finger as it was put together before them.
inline void VirtualRig::place_cameras(RandomStream& once) {
  const CameraRig& c = rig_.camera;
  // Placed by hand: where the picture does not show the whole pad, the camera is placed again.
  std::vector<SideCamera> cameras;
  for (int trial = 0;
       trial == 0 || (trial < most_trials && !std::all_of(cameras.begin(), cameras.end(),
                                                 [](const SideCamera& view) { return view.shows_side(); }));
       ++trial) {
    const CameraPlace set{noise_ * c.aim_sigma_rad * once.normal(), noise_ * c.aim_sigma_rad * once.normal(),
        noise_ * c.aim_sigma_rad * once.normal(), noise_ * c.aim_sigma_m * once.normal(),
        noise_ * c.aim_sigma_m * once.normal()};
    cameras.clear();
    for (const LabView& v : plan_.views)
      cameras.emplace_back(c, side_,
          CameraPlace{set.yaw_rad + v.place.yaw_rad, set.pitch_rad + v.place.pitch_rad, set.roll_rad + v.place.roll_rad,
              set.along_m + v.place.along_m, set.height_m + v.place.height_m});
  }
  // Assembly: what is painted is off, what was aimed at is not.
  RandomStream built(seed_, 120);
  const AssemblyRig& a = rig_.assembly;
  pad_off_m_ = a.pad_sigma_m * built.normal();
  strip_off_m_ = a.strip_sigma_m * built.normal();
  CameraRig placed = c;
  placed.distance_m *= 1.0 + a.distance_sigma * built.normal();
  const double distortion = a.distortion_sigma * built.normal();
  SideGeometry lit = side_;
  for (double& y : lit.lamp_m) y += strip_off_m_;
  const bool as_drawn = placed.distance_m == c.distance_m && distortion == 0.0 && strip_off_m_ == 0.0;
  for (const SideCamera& view : cameras)
    painters_.emplace_back(as_drawn ? view : SideCamera(placed, lit, view.place(), distortion), rig_.light,
        light_->responses().position_m, seed_);
}

inline void VirtualRig::record_frames() {
  const CameraRig& c = rig_.camera;
  const LightRig& l = rig_.light;
  RandomStream once(seed_, 6), jitter(seed_, 7);
  place_cameras(once);
  std::vector<SlowNoise> one_lamp;
  for (std::size_t k = 0; k < side_.lamp_m.size() && l.one_lamp_sigma > 0.0; ++k)
    one_lamp.emplace_back(RandomStream(seed_, 130 + k), l.one_lamp_drift_s);
  LampNoise lamps(l, seed_, 8);
  SlowNoise room(RandomStream(seed_, 9), l.ambient_drift_s);
  const double phase = 2.0 * pi * once.uniform(), half = pi * l.flicker_hz * c.exposure_s,
               averaged = half > 0.0 ? std::sin(half) / half : 1.0;
  int view = plan_.contacts.empty() ? 0 : plan_.contacts.front().view;
  const double per_s = plan_.frames_per_s > 0.0 ? std::min(plan_.frames_per_s, c.frames_per_s) : c.frames_per_s;
  for (double t = first_frame_s; t < end_s_; t += 1.0 / per_s) {
    const Sampled s = at(t);
    // The next contact's view is set while nothing touches.
    for (const Phase& p : phases_)
      if (p.contact >= 0 && p.to_s > t) {
        view = plan_.contacts[std::size_t(p.contact)].view;
        break;
      }
    TruthSample truth{lab_stamp(t + noise_ * c.stamp_sigma_s * jitter.normal()), s.contact};
    if (s.contact >= 0) {
      const Contact& now = contacts_[std::size_t(s.contact)];
      const double y = place_m(s.contact, t);
      truth = {
          truth.stamp_ns, s.contact, y, s.load_N, now.tilt_rad, s.equivalent_N, light_->depth_m(y, s.equivalent_N)};
    }
    frames_.push_back({truth.stamp_ns, sense::frame_file(frames_.size()), c.exposure_s, c.gain});
    truth_.push_back(truth);
    view_.push_back(view);
    lamp_change_.emplace_back(Eigen::Index(one_lamp.size()));
    for (std::size_t k = 0; k < one_lamp.size(); ++k)
      lamp_change_.back()[Eigen::Index(k)] = l.one_lamp_sigma * one_lamp[k].at(t);
    lamps_.push_back(rig_.specimen.lamps * plan_.views[std::size_t(view)].lamps * (1.0 + noise_ * lamps.at(t)));
    room_DN_.push_back(plan_.views[std::size_t(view)].room * l.ambient_DN *
                       (1.0 + noise_ * (l.ambient_drift * room.at(t) +
                                           l.flicker * averaged * std::sin(2.0 * pi * l.flicker_hz * t + phase))));
  }
}

/// Light that each bin has, shared out between the LEDs by their distance.
inline Eigen::VectorXd VirtualRig::one_by_one(const Eigen::VectorXd& light, const Eigen::VectorXd& lamps) const {
  const Eigen::VectorXd& x = light_->responses().position_m;
  Eigen::VectorXd changed = light;
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    double all = 0.0, change = 0.0;
    for (Eigen::Index k = 0; k < lamps.size(); ++k) {
      const double share = std::exp(-std::abs(x[i] - side_.lamp_m[std::size_t(k)]) / rig_.light.one_lamp_reach_m);
      all += share;
      change += share * lamps[k];
    }
    changed[i] *= 1.0 + change / all;
  }
  return changed;
}

/// What leaves the side. LEDs that are off along the finger take all light with them; silicone that is off takes the
/// light of its ends.
inline Eigen::VectorXd VirtualRig::side_light(const TruthSample& s, const Eigen::VectorXd& lamps) const {
  Eigen::VectorXd light = light_->responses().unloaded;
  const bool touched = s.contact >= 0;
  if (pad_off_m_ == 0.0 && strip_off_m_ == 0.0) {
    if (touched) light += light_->change(s.y_m, s.equivalent_N, s.tilt_rad);
  } else {
    light = light_->moved(light, strip_off_m_ + pad_off_m_);
    if (touched) {
      const AssemblyRig& a = rig_.assembly;
      const double to_end = side_.half_length_m - std::abs(s.y_m),
                   share = std::clamp((a.end_far_m - to_end) / (a.end_far_m - a.end_near_m), 0.0, 1.0),
                   off = strip_off_m_ + share * pad_off_m_;
      light += light_->moved(light_->change(s.y_m - off, s.equivalent_N, s.tilt_rad), off);
    }
  }
  return lamps.size() > 0 ? one_by_one(light, lamps) : light;
}

inline sense::Image VirtualRig::image(std::size_t k) const {
  const TruthSample& s = truth_.at(k);
  Eigen::VectorXd light = side_light(s, lamp_change_[k]);
  light *= per_DN_ * lamps_[k];
  Shadow shadow;
  if (s.contact >= 0) shadow = {rig_.light.shadow, s.y_m, rig_.light.shadow_sigma_m};
  return painters_[std::size_t(view_[k])].paint(
      light, lamps_[k], room_DN_[k], noise_, RandomStream(seed_, 1000 + k), shadow);
}

}  // namespace lumo
