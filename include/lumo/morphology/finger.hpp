#pragma once

#include "lumo/morphology/body.hpp"
#include "lumo/morphology/section.hpp"
#include "lumo/morphology/silicone.hpp"

#include <variant>

namespace lumo {

/// What may be chosen about a finger besides θ. Defaults are our assumptions where the paper leaves a choice open.
struct FingerOptions {
  /// Mesh size [m]; the defaults come from the refinement study, benchmarks/refinement/results.md.
  struct Mesh {
    double contact_edge = 2.0e-3;    ///< on the surface that an indenter can touch, away from where it does
    double coarsest_edge = 5.0e-3;   ///< at depth
    double growth = 0.35;            ///< edge length gained per length of depth
    double stretch_y = 1.0;          ///< edges along y are this much longer
    double max_turn_rad = 0.6;       ///< largest turning of the profile along one edge
    double shortest_chord = 0.4e-3;  ///< of the profile; turning does not ask for shorter ones

    /// All edges `factor` times as long; the stretch stays.
    constexpr Mesh scaled(double factor) const {
      return {factor * contact_edge, factor * coarsest_edge, factor * growth, stretch_y, factor * max_turn_rad,
          factor * shortest_chord};
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
    double width_x = 0.8e-3;  ///< on the sides, their height
    double power_W = 1.0;     ///< of all together

    bool operator==(const Leds&) const = default;
  };
  /// Readout regions on the outer surface.
  struct Readout {
    int bins = 11;
    double half_range = 27.5e-3;  ///< |y| beyond it is not seen [m]
    double min_abs_nx = 0.5;      ///< the undeformed normal must point this much sideways
    bool one_side = false;        ///< only x > 0 is seen
    bool in_space = false;        ///< bins stay where they are; otherwise they move with the material

    bool operator==(const Readout&) const = default;
  };

  Twin twin = Twin::none;
  PadDimensions pad = {};
  Mesh mesh = {};
  Leds leds = {};
  Readout readout = {};
  double carrier_albedo = 0.8;
  bool bonded_ends = false;              ///< the end faces are held, by something clear: light passes them as before
  SurfaceOptics touched = Dielectric{};  ///< Body::touched

  bool operator==(const FingerOptions&) const = default;
};

/// Throws InvalidArgument for an option that is out of range.
inline void validate(const FingerOptions& options);

/// The whole finger of a feasible design as a body; its quarter x ≥ 0, y ≥ 0 is described, the rest is mirrored.
/// Throws InfeasibleDesign or InvalidArgument. Source: paper §III-A and Table I.
inline Body finger(const FingerDesign& design, const Silicone& silicone, const FingerOptions& options = {});

namespace detail {

inline Patch finger_patch(SectionTag tag, const HalfSection& s, const FingerOptions& o) {
  const bool supported = s.twin != Twin::unsupported_base;
  const double w = 0.5e-3 * s.pad.width, hs = 1e-3 * s.design.h_s, stem = 0.5e-3 * s.design.w_s;
  const SurfaceOptics wall = Lambertian{o.carrier_albedo};
  switch (tag) {
    case SectionTag::stem_top: return {"stem_top", Plane{{0, 0, hs}, -Vec3d::UnitZ()}, true, false, false, wall};
    case SectionTag::stem_side: return {"stem_side", Plane{{stem, 0, 0}, -Vec3d::UnitX()}, true, false, false, wall};
    case SectionTag::base: return {"base", Plane{Vec3d::Zero(), -Vec3d::UnitZ()}, supported, false, false, wall};
    case SectionTag::void_inner:
      return {"void_inner", Plane{{stem, 0, 0}, Vec3d::UnitX()}, false, false, false, Dielectric{}, false};
    case SectionTag::void_roof:
      return {"void_roof", Plane{{0, 0, hs}, -Vec3d::UnitZ()}, false, false, supported, Dielectric{}, false};
    case SectionTag::void_wall:
      return {"void_wall", Plane{{stem + 1e-3 * s.design.w_v, 0, 0}, -Vec3d::UnitX()}, false, false, supported,
          Dielectric{}, false};
    case SectionTag::side: return {"side", Plane{{w, 0, 0}, Vec3d::UnitX()}, false, true, false, Dielectric{}};
    default:
      return {"dome", EllipticCylinder{{0, 0, 1e-3 * s.design.h_fp}, w, 1e-3 * s.design.h_ep}, false, true, false,
          Dielectric{}};
  }
}

inline void add_carrier(Body& body, const HalfSection& s, const FingerOptions& o) {
  const double half_length = 0.5e-3 * s.pad.length, w = 0.5e-3 * s.pad.width;
  const double hs = 1e-3 * s.design.h_s, stem = 0.5e-3 * s.design.w_s, outer = stem + 1e-3 * s.design.w_v, thick = 5e-3;
  if (s.twin == Twin::unsupported_base) return;
  body.carrier.push_back({{0, 0, -thick}, {w, half_length, thick}});
  if (s.twin == Twin::bonded_base) return;
  body.carrier.push_back({{0, 0, 0.5 * (hs - thick)}, {stem, half_length, 0.5 * (hs + thick)}});
  if (s.design.w_v <= 0.0) return;
  const SurfaceOptics wall = Lambertian{o.carrier_albedo};
  const auto face = [&](std::string name, Vec3d a, Vec3d b, Vec3d c, Vec3d d) {
    body.rigid_faces.push_back({std::move(name), {a, b, c, d}, wall});
  };
  const double l = half_length;
  face("stem +x", {stem, -l, 0}, {stem, l, 0}, {stem, l, hs}, {stem, -l, hs});
  face("stem -x", {-stem, -l, 0}, {-stem, -l, hs}, {-stem, l, hs}, {-stem, l, 0});
  face("base +x", {stem, -l, 0}, {outer, -l, 0}, {outer, l, 0}, {stem, l, 0});
  face("base -x", {-stem, -l, 0}, {-stem, l, 0}, {-outer, l, 0}, {-outer, -l, 0});
}

inline void add_light(Body& body, const HalfSection& s, const Silicone& silicone, const FingerOptions& o) {
  body.medium = silicone.medium();
  if (s.twin == Twin::bonded_base || s.twin == Twin::unsupported_base) return;
  const auto& led = o.leds;
  const double stem = 0.5e-3 * s.design.w_s, height = 1e-3 * s.design.h_s;
  const Vec3d along(0, 0.5 * led.length_y, 0);
  for (int k = 0; k < led.count; ++k) {
    const double y = (k - 0.5 * (led.count - 1)) * led.pitch;
    if (led.place == FingerOptions::Leds::Place::top) {
      body.emitters.push_back(
          RectangleEmitter{{0, y, height}, {0.5 * led.width_x, 0, 0}, along, led.power_W / led.count, 0});
      continue;
    }
    const bool air = s.design.w_v > 0.0;
    require_in_range("height of the LEDs on the stem's sides", led.width_x * 1e3, 1e-3, s.design.h_s, "mm");
    for (const double side : {1.0,
             -1.0})  // in air, with the face that stands back (OpticalScene::Config::carrier_gap_m), but in front of it
      body.emitters.push_back(RectangleEmitter{{side * (stem - (air ? 10e-6 : 0.0)), y, 0.5 * height}, along,
          {0, 0, side * 0.5 * led.width_x}, 0.5 * led.power_W / led.count, 0, air});
  }
  const auto r = o.readout;
  body.touched = o.touched;
  body.regions = r.bins;
  body.regions_in_space = r.in_space;
  std::vector<int> other_end;
  for (int b = 0; b < r.bins; ++b) other_end.push_back(r.bins - 1 - b);
  body.region_image_y = other_end;
  if (r.one_side) body.region_image_x.reset();
  body.region = [r](const Vec3d& p, const Vec3d& n) {
    if ((r.one_side ? n.x() : std::abs(n.x())) < r.min_abs_nx || std::abs(p.y()) > r.half_range) return -1;
    const double bin = (p.y() + r.half_range) / (2.0 * r.half_range) * r.bins;
    return std::clamp(int(bin), 0, r.bins - 1);
  };
}

}  // namespace detail

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

inline Body finger(const FingerDesign& design, const Silicone& silicone, const FingerOptions& o) {
  validate(o);
  require_in_range("scattering albedo", silicone.scattering_albedo, 0.0, 1.0, "");
  require_in_range("anisotropy of scattering", silicone.anisotropy, -0.999, 0.999, "");
  const HalfSection s =
      half_section(design, o.twin, {o.mesh.contact_edge, o.mesh.max_turn_rad, o.mesh.shortest_chord}, o.pad);
  const double half_length = 0.5e-3 * o.pad.length;
  Body body;
  body.name = "finger";
  body.symmetry = {true, true};
  body.exact_volume_m3 = 4.0 * s.exact_area_m2() * half_length;
  body.pivot = {0, 0, 1e-3 * s.design.h_fp};
  detail::add_carrier(body, s, o);
  detail::add_light(body, s, silicone, o);

  const int n = int(s.x.size());
  for (int k = 0; k < n; ++k) {
    body.vertices.emplace_back(s.x[std::size_t(k)], 0.0, s.z[std::size_t(k)]);
    body.vertices.emplace_back(s.x[std::size_t(k)], half_length, s.z[std::size_t(k)]);
  }
  std::vector<int> patch_of(std::size_t(SectionTag::dome) + 1, -2);
  for (int k = 0; k < n; ++k) {
    const SectionTag tag = s.tag[std::size_t(k)];
    int& patch = patch_of[std::size_t(tag)];
    if (tag == SectionTag::mirror) patch = Body::mirror_patch;
    if (patch == -2) {
      patch = int(body.patches.size());
      body.patches.push_back(detail::finger_patch(tag, s, o));
    }
    const int next = (k + 1) % n;
    body.facets.push_back({{2 * k, 2 * k + 1, 2 * next + 1, 2 * next}, patch});
  }
  Facet middle{{}, Body::mirror_patch}, end{{}, int(body.patches.size())};
  body.patches.push_back({"end", Plane{{0, half_length, 0}, Vec3d::UnitY()},
      o.bonded_ends || o.twin == Twin::unsupported_base, false, false, Dielectric{}});
  for (int k = 0; k < n; ++k) {
    middle.loop.push_back(2 * k);
    end.loop.push_back(2 * (n - 1 - k) + 1);
  }
  body.facets.push_back(middle);
  body.facets.push_back(end);

  const auto mesh = o.mesh;
  std::vector<Shape> touchable;
  for (const Patch& p : body.patches)
    if (p.contactable && p.name == "dome") touchable.push_back(p.shape);
  body.sizing.stretch_y = mesh.stretch_y;
  body.sizing.edge = [mesh, touchable](const Vec3d& p) {
    double depth = std::numeric_limits<double>::infinity();
    for (const Shape& shape : touchable) depth = std::min(depth, (closest_point(shape, p) - p).norm());
    return std::min(mesh.contact_edge + mesh.growth * depth, mesh.coarsest_edge);
  };
  return body;
}

}  // namespace lumo
