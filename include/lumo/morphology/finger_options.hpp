#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/section.hpp"
#include "lumo/morphology/silicone.hpp"

#include <optional>
#include <variant>
#include <vector>

namespace lumo {

/// About which point of the section an approach is tilted.
enum class TiltPivot {
  flat_top,  ///< x = 0, z = h_fp: where the flat sides end
  base       ///< x = 0, z = 0
};

/// What may be chosen about a finger besides θ, where the paper leaves a choice open. Its defaults are the finger that
/// the paper's authors built. Source: as PadDimensions; lengths of LEDs and recesses, albedo and pivot are of the same
/// code. Ours: the mesh, that a side is seen by its normals, and that the film of air over an LED never closes.
struct FingerOptions {
  /// Mesh size [m]; the defaults come from the reference study, benchmarks/reference.
  struct Mesh {
    double contact_edge = 2.5e-3;    ///< on the surface that an indenter can touch, away from where it does
    double coarsest_edge = 8.0e-3;   ///< at depth
    double growth = 0.5;             ///< edge length gained per length of depth
    double stretch_y = 1.0;          ///< edges along y are this much longer
    double max_turn_rad = 0.6;       ///< largest turning of the profile along one edge
    double shortest_chord = 0.4e-3;  ///< of the profile; turning does not ask for shorter ones
    double support_edge = 2.5e-3;    ///< on the surface that lies free on the carrier
    double seam_edge = 1.0e-3;       ///< at the edges of a bonded stem, below a tool
    double stem_edge = 0.4e-3;       ///< at the rounded edges of a stem on which silicone lies free, below a tool

    /// All edges `factor` times as long; the stretch stays.
    constexpr Mesh scaled(double factor) const {
      return {factor * contact_edge, factor * coarsest_edge, factor * growth, stretch_y, factor * max_turn_rad,
          factor * shortest_chord, factor * support_edge, factor * seam_edge, factor * stem_edge};
    }
    static constexpr double quick_edges = 1.8;  ///< for a look in a fifth of the time
    /// The same, but for a stem's rounded edges: elements that are longer than the rounding lose equilibria there.
    constexpr Mesh coarser(double factor) const {
      Mesh longer = scaled(factor);
      longer.shortest_chord = shortest_chord;
      longer.stem_edge = stem_edge;
      return longer;
    }
    bool operator==(const Mesh&) const = default;
  };
  /// The five LEDs, lengths in m. On the sides there are as many on each, at half the stem's height, with half the
  /// power; beside a void they shine into its air.
  struct Leds {
    enum class Place { top, sides };
    Place place = Place::top;
    int count = 5;
    double pitch = 11.0e-3;
    double length_y = 1.6e-3;
    double width_x = 1.8e-3;  ///< on the sides, their height
    double power_W = 1.0;     ///< of all together

    bool operator==(const Leds&) const = default;
  };
  /// Hollows in the top of a stem on which the silicone lies free, one for each LED on the top, across the stem's whole
  /// width: the LED lies on the floor and shines into the film of air above it.
  struct Recess {
    double depth = 0.19e-3;  ///< 0: there are none, and LEDs touch the silicone
    double length_y = 5.1e-3;
    std::optional<double> film_closes;  ///< Body::film_closes_m

    bool operator==(const Recess&) const = default;
  };
  /// Readout regions on the outer surface.
  struct Readout {
    int bins = 11;
    double half_range = 27.5e-3;  ///< |y| beyond it is not seen [m]
    double min_abs_nx = 0.5;      ///< the undeformed normal must point this much sideways
    bool one_side = true;         ///< only x > 0 is seen
    /// Light is seen by its direction, wherever it leaves, and `min_abs_nx` says nothing.
    bool by_direction = false;
    bool in_space = false;  ///< bins stay where they are; otherwise they move with the material

    bool operator==(const Readout&) const = default;
  };

  Twin twin = Twin::none;
  PadDimensions pad = {};
  Mesh mesh = {};
  Leds leds = {};
  Recess recess = {};
  Readout readout = {};
  TiltPivot pivot = TiltPivot::base;
  /// Of the edges of a stem on which silicone lies free, its ridges' too; 0: sharp [m]. Ours: the drawings have sharp
  /// edges, over which no equilibrium is certain.
  double stem_edge_radius = 0.4e-3;
  double carrier_albedo = 0.7;
  bool bonded_ends = false;              ///< the end faces are held, by something clear: light passes them as before
  SurfaceOptics touched = Dielectric{};  ///< Body::touched

  bool operator==(const FingerOptions&) const = default;
};

/// The default, by name.
inline FingerOptions built_finger(const FingerOptions::Mesh& mesh = {}) {
  FingerOptions o;
  o.mesh = mesh;
  return o;
}

/// A pad on a flat carrier, bonded to the stem, with free ends and LEDs in the silicone: lumo's reading of the paper
/// before the built one was known.
inline FingerOptions plain_finger(const FingerOptions::Mesh& mesh = {}) {
  FingerOptions o = built_finger(mesh);
  o.pad = plain_pad();
  o.leds.width_x = 0.8e-3;
  o.recess.depth = 0.0;
  o.recess.film_closes = 0.0;
  o.readout.one_side = false;
  o.pivot = TiltPivot::flat_top;
  o.carrier_albedo = 0.8;
  return o;
}

/// Another finger by one choice. By its key, a word without blanks, it is asked for.
struct FingerVariant {
  const char *key, *quantity, *value;
  void (*apply)(FingerOptions&);
};

/// What distinguishes the plain finger's pad from the built one's, and may be chosen by itself.
inline std::vector<FingerVariant> finger_variants() {
  return {{"bonded_stem", "stem", "bonded, as on a primed one", [](FingerOptions& o) { o.pad.stem = Stem::bonded; }},
      {"tilt_about_flat_top", "tilt", "about z = h_fp", [](FingerOptions& o) { o.pivot = TiltPivot::flat_top; }},
      {"thickness_along_axes", "t_min", "along the axes",
          [](FingerOptions& o) { o.pad.thickness = Thickness::along_axes; }}};
}

/// Throws InvalidArgument for an option that is out of range.
inline void validate(const FingerOptions& options);

inline void validate(const FingerOptions& o) {
  require_in_range("mesh edge at the contact surface", o.mesh.contact_edge * 1e3, 0.2, 10.0, "mm");
  require_in_range("coarsest mesh edge", o.mesh.coarsest_edge * 1e3, o.mesh.contact_edge * 1e3, 30.0, "mm");
  require_in_range("mesh growth with depth", o.mesh.growth, 0.0, 100.0, "");
  require_in_range("mesh stretch along y", o.mesh.stretch_y, 0.5, 4.0, "");
  require_in_range("largest turning along an edge", o.mesh.max_turn_rad, 0.01, 1.6, "rad");
  require_in_range("shortest chord", o.mesh.shortest_chord * 1e3, 0.0, 10.0, "mm");
  require_in_range("pad width", o.pad.width, 1.0, 200.0, "mm");
  require_in_range("pad length", o.pad.length, 1.0, 1000.0, "mm");
  require_in_range("smallest silicone thickness", o.pad.t_min, 0.0, 100.0, "mm");
  if ((o.pad.shoulder_width > 0.0) != (o.pad.shoulder_height > 0.0))
    throw InvalidArgument(message("shoulders are ", o.pad.shoulder_width, " mm wide and ", o.pad.shoulder_height,
        " mm high, must be 0 both or neither"));
  require_in_range("length of the pad's cap", o.pad.cap_length, 0.0, 1000.0, "mm");
  require_in_range("width of the shoulders", o.pad.shoulder_width, 0.0, 0.5 * o.pad.width - 1e-3, "mm");
  require_in_range("height of the shoulders", o.pad.shoulder_height, 0.0, 100.0, "mm");
  require_in_range(
      "height of the carrier below the base", o.pad.carrier_height, o.pad.shoulder_height + 1e-3, 200.0, "mm");
  require_in_range("depth of the LEDs' recesses", o.recess.depth * 1e3, 0.0, 1.0, "mm");
  if (o.recess.film_closes)
    require_in_range("height at which the film over an LED closes", *o.recess.film_closes * 1e3, 0.0, 1.0, "mm");
  if (o.recess.depth > 0.0)  // walls are left between them
    require_in_range(
        "length of the LEDs' recesses", o.recess.length_y * 1e3, o.leds.length_y * 1e3, o.leds.pitch * 1e3 - 1.0, "mm");
  require_in_range("mesh edge on the carrier", o.mesh.support_edge * 1e3, 0.1, 30.0, "mm");
  require_in_range("mesh edge at a bonded stem's edges", o.mesh.seam_edge * 1e3, 0.05, 30.0, "mm");
  require_in_range("mesh edge at a free stem's edges", o.mesh.stem_edge * 1e3, 0.05, 30.0, "mm");
  require_in_range("radius of a free stem's edges", o.stem_edge_radius * 1e3, 0.0, 1.0, "mm");
  require_in_range("number of LEDs", o.leds.count, 0, 1000, "");
  require_in_range("LED pitch", o.leds.pitch * 1e3, 0.0, 1000.0, "mm");
  require_in_range("LED length", o.leds.length_y * 1e3, 1e-3, 100.0, "mm");
  require_in_range("LED width", o.leds.width_x * 1e3, 1e-3, 100.0, "mm");
  require_positive("LED power", o.leds.power_W, "W");
  require_in_range("readout bins", o.readout.bins, 0, 10000, "");
  require_in_range("readout half range", o.readout.half_range * 1e3, 1e-3, 1000.0, "mm");
  require_in_range("least sideways part of a visible normal", o.readout.min_abs_nx, 0.0, 1.0, "");
  require_in_range("carrier albedo", o.carrier_albedo, 0.0, 1.0, "");
  if (const auto* white = std::get_if<Lambertian>(&o.touched))
    require_in_range("albedo of a tool that wets the pad", white->albedo, 0.0, 1.0, "");
  if (const auto* mirror = std::get_if<Mirror>(&o.touched))
    require_in_range("reflectance of a tool that wets the pad", mirror->reflectance, 0.0, 1.0, "");
}

}  // namespace lumo
