#pragma once

#include "lumo/fabrication/mould_half.hpp"
#include "lumo/fabrication/solids.hpp"
#include "lumo/fabrication/three_mf.hpp"

#include <string>
#include <utility>
#include <vector>

namespace lumo {

/// A part to be printed.
struct CastingPart {
  std::string name;
  TriangleSurface assembled;  ///< where it is in the closed mould, the pad's frame [m]
  TriangleSurface printed;    ///< as it prints best: on z = 0, without supports, its corner at the origin [m]
  int copies = 1;
  double volume_m3 = 0.0;    ///< of one
  Vec3d box{0.0, 0.0, 0.0};  ///< edges of the printed one's bounding box [m]
};

/// Silicone that a cast takes [m³].
struct CastVolume {
  double pad = 0.0;       ///< the design's, exact
  double fits = 0.0;      ///< clearance about the LED strip and at the stem's ends, which fills up too
  double openings = 0.0;  ///< gate and vents up to the mould's outer face: cut off
  double total() const { return pad + fits + openings; }
};

/// All that one pad is made with: carrier, mould halves a and b, and for a pad with voids the cores. Throws
/// InvalidArgument, MeshError.
inline std::vector<CastingPart> casting_kit(const HalfSection& section, const CastingOptions& options = {});

inline CastVolume cast_volume(const HalfSection& section, const CastingOptions& options = {});

/// Smallest angle [rad] between the opening direction and the faces of a mould half that touch the pad; negative: an
/// undercut. Faces of the half that lie within the pad's box are such.
inline double least_draft(const TriangleSurface& half, const HalfSection& section, const Vec3d& direction);

/// Along which mould half A comes off; half B goes the other way. Ten degrees out of the parting's normal are the draft
/// of the pad's ends.
inline Vec3d opening_direction(double angle = 10.0_deg) { return {std::cos(angle), std::sin(angle), 0.0}; }

namespace detail {

/// Turned by a rotation and moved to the corner of the printer's bed.
inline CastingPart print_part(std::string name, TriangleSurface surface, const Mat3d& turn, int copies = 1) {
  CastingPart part{std::move(name), surface, std::move(surface), copies};
  for (Vec3d& v : part.printed.vertices) v = turn * v;
  const SurfaceReport report = validate_surface(part.printed);
  for (Vec3d& v : part.printed.vertices) v -= report.low;
  part.volume_m3 = report.volume;
  part.box = report.high - report.low;
  return part;
}

}  // namespace detail

inline std::vector<CastingPart> casting_kit(const HalfSection& s, const CastingOptions& o) {
  // A mould half stands on its end wall: the dome's curve is then drawn by the printer's axes and not stepped by its
  // layers.
  const Mat3d flat = Mat3d::Identity(), on_far_end = (Mat3d() << 1, 0, 0, 0, 0, 1, 0, -1, 0).finished(),
              on_near_end = (Mat3d() << 1, 0, 0, 0, 0, -1, 0, 1, 0).finished(),
              on_side = (Mat3d() << 0, 1, 0, 0, 0, 1, 1, 0, 0).finished();
  std::vector<CastingPart> kit;
  kit.push_back(detail::print_part("carrier", carrier_solid(s, o), flat));
  kit.push_back(detail::print_part("mould_a", mould_half_a(s, o), on_far_end));
  kit.push_back(detail::print_part("mould_b", mould_half_b(s, o), on_near_end));
  if (s.design.w_v > 0.0) kit.push_back(detail::print_part("core", core_solid(s, o), on_side, 2));
  return kit;
}

inline CastVolume cast_volume(const HalfSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  CastVolume v{2.0 * s.exact_area_m2() * s.length_m(),
      4.0 * (at.pocket_x * at.pocket_y - 0.5 * o.strip_width * at.strip_y) * o.strip_height +
          2.0 * at.stem_x * at.stem_height * o.clearance,
      0.0};
  for (const Opening& opening : pour_openings(s, o)) v.openings += opening.volume_m3(at.mould_y - at.half_length);
  return v;
}

inline double least_draft(const TriangleSurface& half, const HalfSection& s, const Vec3d& direction) {
  constexpr double rounding = 1e-9;  // [m]
  const double width = s.half_width_m() + rounding, top = s.height_m() + rounding,
               length = 0.5 * s.length_m() + rounding;
  double least = 0.5 * pi;
  for (const auto& t : half.triangles) {
    const Vec3d &a = half.vertices[std::size_t(t[0])], &b = half.vertices[std::size_t(t[1])],
                &c = half.vertices[std::size_t(t[2])];
    const Vec3d middle = (a + b + c) / 3.0;
    if (std::abs(middle.x()) > width || std::abs(middle.y()) > length || middle.z() < 0.0 || middle.z() > top) continue;
    const Vec3d normal = (b - a).cross(c - a).normalized();
    least = std::min(least, std::asin(std::clamp(-normal.dot(direction.normalized()), -1.0, 1.0)));
  }
  return least;
}

}  // namespace lumo
