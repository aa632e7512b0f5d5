#pragma once

#include "configuration/mechanics.hpp"

#include "lumo/fabrication/casting_options.hpp"
#include "lumo/mesh/size_field.hpp"
#include "lumo/morphology/design.hpp"
#include "lumo/morphology/finger_options.hpp"
#include "lumo/morphology/silicone.hpp"
#include "lumo/optimize/problem.hpp"
#include "lumo/pipeline/ensemble.hpp"

#include <array>
#include <string>
#include <string_view>
#include <vector>

/// All that can be asked of a computation, in one value. Each member of it has a setting: configuration/settings.hpp.
namespace lumo::program {

/// A finger: its design, its silicone, and what is assumed of it.
struct Pad {
  std::array<double, 5> theta_mm = built_baseline().values();
  Silicone silicone = dragon_skin();
  FingerOptions finger = built_finger();

  const std::string& material() const { return silicone.name; }
  FingerDesign design() const { return FingerDesign::from(theta_mm); }
  bool operator==(const Pad&) const = default;
};

/// "built", "plain", or "own" for another, whatever their meshes.
inline std::string name(const FingerOptions& finger) {
  return finger == built_finger(finger.mesh) ? "built" : finger == plain_finger(finger.mesh) ? "plain" : "own";
}

/// A sphere that is pressed on the pad.
struct Touch {
  double diameter_mm = 10.0;
  double angle_deg = 0.0;  ///< from the pad's normal
  double x_mm = 0.0;       ///< across the finger
  double y_mm = 0.0;       ///< along it
  std::vector<double> loads_N = {1.0, 2.0, 5.0, 10.0, 15.0};
  TiltPlane tilt = TiltPlane::xz;

  bool operator==(const Touch&) const = default;
};

/// Rays, and how exact J_obs is to be by them.
struct LightEffort {
  double ray_error_percent = 2.0;  ///< wanted standard error of J_obs by rays
  int rounds = 8;                  ///< of refinement, at most
  int rays_per_emitter = 1 << 16, carrier_rays = 1 << 15, exit_rays = 1 << 18;  ///< of one trace

  bool operator==(const LightEffort&) const = default;
};

enum class References { built, plain };

/// The search for the best design.
struct Search {
  int evaluations = 160, seed = 1;
  int pending = 1;                            ///< designs under way at once
  std::string source = "default";             ///< of candidates: "default" or "paper"
  References references = References::built;  ///< the designs that it starts with
  Noise noise = Noise::estimated;             ///< are the objectives' errors taken into account?

  bool operator==(const Search&) const = default;
};

/// A virtual rig and the specimen in it.
struct LabSettings {
  int seed = 1, joints = 1;
  double noise = 1.0;                   ///< times the rig's
  double stiffness = 1.0, lamps = 1.0;  ///< of the specimen, times the computed pad's
  std::string exposure = "one";         ///< for all pads "one", or for each "pad" its own
  double diameter_mm = 10.0;            ///< of the sphere
  double angle_deg = 0.0, slide_mm = 0.0;
  double creep = 1.0, room = 1.0;  ///< times the rig's relaxing parts, and its ambient light
  double assembly = 0.0;           ///< times what is assumed of it (assumed_assembly)
  double one_lamp_percent = 0.0, shadow = 0.0;
  double cogging_mNm = 0.0, backlash_deg = 0.0, clock_offset_ms = 0.0;

  bool operator==(const LabSettings&) const = default;
};

/// A camera before the side x > 0 of a pad, aimed at the middle of it; as the virtual lab's, where that has the number
/// (lumo/lab/rig.hpp).
struct CameraSettings {
  double distance_mm = 250.0;              ///< from the facing side
  double yaw_deg = 0.0, pitch_deg = 0.0;   ///< of where it stands: towards +y, and above the base plane
  double roll_deg = 0.0;                   ///< about the line of sight
  double along_mm = 0.0, height_mm = 0.0;  ///< of what it is aimed at, beside the middle of the side
  double focal_px = 616.0;                 ///< focal length
  int columns = 192, rows = 80;            ///< of the picture
  double aperture_mm = 0.48;               ///< radius of the lens' opening
  double exposure_ms = 1.0, gain = 64.0;   ///< of lumo::program::digital_number()
  int samples = 16;                        ///< lines of sight a pixel

  bool operator==(const CameraSettings&) const = default;
};

/// By what J_obs is observed.
struct Observation {
  enum class By { side, camera, photodiodes };
  By by = By::side;
  double diode_gap_mm = 5.0, diode_mm = 2.0;  ///< photodiodes: from the facing side, and their edge

  bool operator==(const Observation&) const = default;
};

struct Configuration {
  Pad pad;
  Touch touch;
  Ensemble ensemble;
  Mechanics mechanics;
  Focus focus;  ///< of meshes about contacts
  LightEffort light;
  Search search;
  LabSettings lab;
  CameraSettings camera;
  Observation observation;
  CastingOptions casting;  ///< without what the finger decides

  bool operator==(const Configuration&) const = default;
};

/// The designs that a search with these references starts with, and the one that others are compared with.
inline std::vector<FingerDesign> designs_of(References references) {
  return references == References::built ? built_references() : plain_references();
}
inline FingerDesign baseline_of(References references) {
  return references == References::built ? built_baseline() : plain_baseline();
}

/// Ensembles that have a name.
struct NamedEnsemble {
  std::string_view name;
  Ensemble ensemble;
};
inline std::vector<NamedEnsemble> named_ensembles() {
  return {{"flat", flat_ensemble()}, {"curved", curved_ensemble()}, {"flat-authors", authors_flat_ensemble()},
      {"curved-authors", authors_curved_ensemble()}};
}
/// "own" for one that has none.
inline std::string name(const Ensemble& ensemble) {
  for (const NamedEnsemble& known : named_ensembles())
    if (known.ensemble == ensemble) return std::string(known.name);
  return "own";
}

}  // namespace lumo::program
