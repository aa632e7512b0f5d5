#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace lumo {

// Every number of the virtual rig, with its source or the word "assumed" (docs/virtual_lab.md explains each). They were
// fixed before any decoder, localiser or force estimator ran on a log of the lab. The lab's `noise` multiplies all that
// is marked σ.

/// The camera, about an Intel RealSense D435's colour sensor at 640 × 480, of which a window about the finger is
/// recorded. The picture is its green plane.
struct CameraRig {
  int width = 192, height = 80;    ///< of the window [px]
  double focal_px = 616.0;         ///< 1386 px at 1920 × 1080 (FOV 69.4°, FRAMOS D435e manual), 1080 rows made 480
  double distance_m = 0.25;        ///< from the facing side; assumed, 0.41 mm/px
  double aim_sigma_rad = 1.5_deg;  ///< σ of yaw, pitch and roll of one placing by hand; assumed
  double aim_sigma_m = 1.0_mm;     ///< σ of the place along y and z; assumed
  double frames_per_s = 30.0;
  double exposure_s = 1.0e-3;   ///< device setting 10 (paper), 100 µs each (librealsense #8243)
  double gain = 64.0;           ///< device setting (paper)
  double level_DN = 70.0;       ///< of the unloaded side, mean over |y| ≤ 25 mm; assumed
  double brightest_DN = 220.0;  ///< of a loaded side: where it would be more, the exposure is shorter; assumed
  /// Light of a bin [DN] per emitted power: one exposure for all pads (paper). 0: each pad is exposed by itself, for
  /// `level_DN`.
  double exposure_DN = 0.0;
  double gamma = 1.0;     ///< DN = 255 (linear/255)^(1/gamma); 1: linear, assumed
  double black_DN = 2.0;  ///< assumed
  double full_DN = 255.0;
  double shot_DN = 0.03;  ///< σ² per DN of signal: SNR 36 dB at 128 DN (EMVA 1288 model; level from memory: assumed), σ
  double read_DN = 0.6;           ///< σ, assumed
  double row_DN = 0.35;           ///< σ of a row's offset, one frame; 0.3–0.5 (memory: assumed)
  double pixel_gain = 0.01;       ///< σ of fixed sensitivities, PRNU about 1 % (memory: assumed)
  double blur_px = 0.8;           ///< standard deviation of the lens's point spread; assumed
  double stamp_sigma_s = 0.2e-3;  ///< σ of a stamp; assumed
};

/// The finger's lamps and the room's.
struct LightRig {
  double lamp_drift = 3.0e-3;  ///< σ of the lamps' slow common change; LED drift 0.2 % between contacts, 1–2 % warm-up
                               ///< (memory: assumed)
  double lamp_drift_s = 20.0;   ///< its time
  double lamp_white = 1.0e-3;   ///< σ frame by frame; assumed
  double ambient_DN = 5.0;      ///< mean; assumed
  double ambient_slope = 0.2;   ///< relative, from end to end of the window; assumed
  double ambient_drift = 0.02;  ///< σ relative; assumed
  double ambient_drift_s = 5.0;
  double flicker = 0.1;  ///< σ-like amplitude of 100 Hz (mains) relative to ambient; assumed
  double flicker_hz = 100.0;
  double spot_DN = 80.0;  ///< a LED's package seen through the side, on top of the side's light; assumed (the paper
                          ///< detects five LEDs)
  double spot_sigma_m = 0.7_mm;  ///< half of the package's 1.6 mm, blurred; assumed
  // Off unless asked for.
  double one_lamp_sigma = 0.0;       ///< σ of each LED's slow change by itself, relative
  double one_lamp_drift_s = 60.0;    ///< its time; assumed
  double one_lamp_reach_m = 6.0_mm;  ///< along the finger, over which an LED's share of the light falls to 1/e; assumed
  double shadow = 0.0;               ///< share of the room's light that the tool takes away before it
  double shadow_sigma_m = 12.0_mm;   ///< half width of its shadow; assumed
};

/// The indenter and how well it comes back.
struct ContactRig {
  double place_sigma_m = 0.25_mm;  ///< σ of a re-contact along y; indexed jig 0.2–0.3 mm (memory: assumed)
  /// σ: angle 0.4° and 0.2 mm sideways on a dome of 36 mm radius, 0.3° (memory: assumed)
  double tilt_sigma_rad = 0.5_deg;
  double load_sigma = 0.005;     ///< σ of a hold's load, relative; assumed
  double sensor_sigma_N = 0.05;  ///< σ of one sample of the force sensor (Bota Rokubi, memory: assumed)
  double sensor_bias_N = 0.05;   ///< σ after tare; vendor's test accepts 0.2 N (bota_driver)
  double sensor_hz = 100.0;
  double marker_sigma_m = 0.02_mm;  ///< σ of the followed marker on the indenter; assumed
  double slide_m = 0.0;             ///< way along the finger from the first touch to leaving; a contact slides or rolls
};

/// Linear viscoelasticity: shear relaxation in parts of the instantaneous modulus. Solaris: half of what field notes
/// suggest for Dragon Skin; assumed.
struct SiliconeRig {
  std::array<double, 3> part{0.02, 0.015, 0.015};
  std::array<double, 3> time_s{0.1, 1.0, 10.0};
};

/// How a joint moves without contact: to and fro as a cosine, with a rest after each sweep. Moving shows friction,
/// resting what sticks. Assumed.
struct FreeRunRig {
  double beat_s = 0.75;  ///< of a sweep and its rest
  double sweep_s = 0.5;
  double swing_rad = 0.35;                ///< to both sides
  double rest_velocity_rad_per_s = 0.02;  ///< Coulomb friction turns within about it
};

/// The joints under local position control, with current for torque: one, or a second one alike before it.
struct MotorRig {
  int joints = 1;
  double joint_to_joint_m = 45.0_mm;       ///< from the first of two to the second; assumed
  double joint_to_origin_m = 65.0_mm;      ///< assumed; sets what a fixed arm errs by (paper: 2.72 N)
  double torque_constant_Nm_per_A = 0.35;  ///< gear included; assumed
  /// σ of the constant's relative error, one for each log; 3–5 % uncalibrated (memory: assumed)
  double constant_sigma = 0.02;
  /// σ of what sticks; new when a contact begins or ends, constant in between: set for 1.29 N
  double stiction_Nm = 0.079;
  double white_Nm = 0.0685;  ///< σ of one sample; current noise and ripple: set for 1.29 N
  double coulomb_Nm = 0.02, viscous_Nm_s_per_rad = 0.01;  ///< while it turns; 5–25 mN·m (memory: assumed)
  double weight_Nm = 0.06;                                ///< of the finger, times sin q; assumed
  double bias_Nm = 0.01;                    ///< σ of the current sensor's offset, one for each log; assumed
  double velocity_sigma_rad_per_s = 0.003;  ///< σ; assumed
  double hold_rad = 0.15;                   ///< where it holds; assumed
  double stiffness_Nm_per_rad = 200.0;      ///< of the position control; assumed
  double hz = 250.0;
  FreeRunRig free_run;
  // Off unless asked for.
  double cogging_Nm = 0.0;        ///< amplitude; 2–10 mN·m (memory: assumed)
  double cogging_periods = 10.0;  ///< per turn; 6–14 (memory: assumed)
  double backlash_rad = 0.0;      ///< the encoder turns by this before the finger does; 0.11° (PULSE115-60)
  double clock_offset_s = 0.0;    ///< of the joints' stamps, which the session does not state
};

/// How the pad at hand differs from the computed one.
struct SpecimenRig {
  double stiffness = 1.0;  ///< of its silicone, relative: it deforms as the computed pad does under the load over this
  double lamps = 1.0;      ///< power of its LEDs, relative

  /// Largest load that it can be given where the computed pad knows loads up to `computed_N`: a softer one deforms
  /// more.
  double bears_N(double computed_N) const { return std::min(1.0, stiffness) * computed_N; }
};

/// How far a finger is from its drawing, drawn once for a log; its session states the drawing. All 0: as drawn.
struct AssemblyRig {
  double pad_sigma_m = 0.0;       ///< σ: silicone glued off along the finger, by which its ends move
  double strip_sigma_m = 0.0;     ///< σ: LEDs off along the finger
  double distance_sigma = 0.0;    ///< σ of the camera's distance, relative
  double distortion_sigma = 0.0;  ///< σ of the lens's radial distortion, of a ray at 45°: tan becomes tan (1 + k tan²)
  double end_near_m = 5.0_mm, end_far_m = 15.0_mm;  ///< from an end: a contact's light moves with it wholly, not at all
};

/// All of it.
struct Rig {
  SpecimenRig specimen;
  AssemblyRig assembly;
  CameraRig camera;
  LightRig light;
  ContactRig contact;
  SiliconeRig silicone;
  MotorRig motor;
};

/// What a pixel gives for the light on it [DN before gamma]: shot and read noise (`normal`, a standard normal number,
/// times `noise`), the row's offset, black level, full well, gamma, 8 bits (EMVA 1288's linear model).
inline std::uint8_t sensed(const CameraRig& camera, double signal, double noise, double normal, double row_offset) {
  signal = std::max(signal, 0.0);
  signal += noise * std::sqrt(camera.shot_DN * signal + camera.read_DN * camera.read_DN) * normal + row_offset;
  double value = std::clamp(signal + camera.black_DN, 0.0, camera.full_DN);
  const double inverse_gamma = 1.0 / camera.gamma;
  if (inverse_gamma != 1.0) value = camera.full_DN * std::pow(value / camera.full_DN, inverse_gamma);
  return std::uint8_t(std::lround(value));
}

/// The lab's clock.
inline std::int64_t lab_stamp(double t_s) { return std::llround(1e9 * t_s); }

/// Throws InvalidArgument for numbers out of range.
inline void validate(const Rig& r) {
  require_in_range("stiffness of the specimen", r.specimen.stiffness, 0.5, 2.0, "times the computed pad's");
  require_in_range("power of the specimen's LEDs", r.specimen.lamps, 0.1, 3.0, "times the computed pad's");
  require_in_range("width of the camera's window", r.camera.width, 32, 4096, "px");
  require_in_range("height of the camera's window", r.camera.height, 32, 4096, "px");
  require_positive("focal length", r.camera.focal_px, "px");
  require_in_range("distance of the camera", r.camera.distance_m, 0.05, 10.0, "m");
  require_in_range("frame rate", r.camera.frames_per_s, 1.0, 1000.0, "1/s");
  require_in_range("gamma", r.camera.gamma, 0.2, 5.0, "");
  require_in_range("level of the unloaded side", r.camera.level_DN, 1.0, 250.0, "DN");
  require_in_range("level of the brightest side", r.camera.brightest_DN, 1.0, 1e6, "DN");
  require_in_range("exposure for all pads", r.camera.exposure_DN, 0.0, 1e12, "DN per emitted power");
  require_in_range("glue of the pad", 1e3 * r.assembly.pad_sigma_m, 0.0, 10.0, "mm");
  require_in_range("glue of the LED strip", 1e3 * r.assembly.strip_sigma_m, 0.0, 10.0, "mm");
  require_in_range("error of the camera's distance", r.assembly.distance_sigma, 0.0, 0.1, "");
  require_in_range("distortion of the lens", r.assembly.distortion_sigma, 0.0, 1.0, "");
  require_in_range("change of one LED", r.light.one_lamp_sigma, 0.0, 0.3, "");
  require_in_range("shadow of the tool", r.light.shadow, 0.0, 1.0, "of the room's light");
  require_in_range("way that a contact slides", 1e3 * r.contact.slide_m, -20.0, 20.0, "mm");
  require_in_range("cogging", 1e3 * r.motor.cogging_Nm, 0.0, 1000.0, "mN·m");
  require_in_range("backlash", r.motor.backlash_rad, 0.0, 0.2, "rad");
  require_in_range("offset of the joints' clock", r.motor.clock_offset_s, -1.0, 1.0, "s");
  require_in_range("number of the rig's joints", r.motor.joints, 1, 2, "");
  require_in_range("way from joint to joint", 1e3 * r.motor.joint_to_joint_m, 1.0, 1000.0, "mm");
  require_in_range("rate of the joint samples", r.motor.hz, 10.0, 10000.0, "1/s");
  require_in_range("rate of the force sensor", r.contact.sensor_hz, 1.0, 10000.0, "1/s");
  require_positive("torque constant", r.motor.torque_constant_Nm_per_A, "N·m/A");
  require_positive("stiffness of the position control", r.motor.stiffness_Nm_per_rad, "N·m/rad");
  double sum = 0.0;
  for (std::size_t k = 0; k < r.silicone.part.size(); ++k) {
    require_in_range("part of the relaxation", r.silicone.part[k], 0.0, 0.9, "");
    require_positive("relaxation time", r.silicone.time_s[k], "s");
    sum += r.silicone.part[k];
  }
  require_in_range("sum of the relaxing parts", sum, 0.0, 0.9, "");
}

/// What load would, in equilibrium, give the deformation that a pad has now: it lags behind the load on it (Prony
/// series; generalised Maxwell body). With the equilibrium modulus for unit, load = e + Σ w_k h_k, where h_k' = e' −
/// h_k/τ_k and w_k = part_k/(1 − Σ part).
class Relaxation {
 public:
  explicit Relaxation(const SiliconeRig& rig) : time_s_(rig.time_s) {
    double rest = 1.0;
    for (const double g : rig.part) rest -= g;
    for (std::size_t k = 0; k < weight_.size(); ++k) weight_[k] = rig.part[k] / rest;
  }

  /// Goes on by `dt_s` to the load [N] that is then there; e changes linearly within the step, for which the branches
  /// are exact. Returns e, never below 0.
  double step(double load_N, double dt_s) {
    double lag = 0.0, whole = 1.0;
    std::array<double, 3> keep{}, gain{};
    for (std::size_t k = 0; k < weight_.size(); ++k) {
      keep[k] = std::exp(-dt_s / time_s_[k]);
      gain[k] = (1.0 - keep[k]) * time_s_[k] / dt_s;
      lag += weight_[k] * (keep[k] * branch_[k] - gain[k] * equivalent_N_);
      whole += weight_[k] * gain[k];
    }
    const double next = std::max(0.0, (load_N - lag) / whole);
    for (std::size_t k = 0; k < weight_.size(); ++k)
      branch_[k] = keep[k] * branch_[k] + gain[k] * (next - equivalent_N_);
    return equivalent_N_ = next;
  }
  double equivalent_N() const { return equivalent_N_; }

 private:
  std::array<double, 3> time_s_, weight_{}, branch_{};
  double equivalent_N_ = 0.0;
};

}  // namespace lumo
