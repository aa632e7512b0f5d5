#pragma once

#include "lumo/drawing/svg.hpp"
#include "lumo/fabrication/carrier_solid.hpp"
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
  bool stays = false;        ///< in the finger
  double volume_m3 = 0.0;    ///< of one
  Vec3d box{0.0, 0.0, 0.0};  ///< edges of the printed one's bounding box [m]
};

/// Silicone that a cast takes [m³].
struct CastVolume {
  double pad = 0.0;       ///< the design's, exact
  double fits = 0.0;      ///< clearance about a strip in the stem's top and at the carrier's ends, which fills up too
  double openings = 0.0;  ///< gate and vents up to the mould's outer face: cut off
  double total() const { return pad + fits + openings; }
};

/// All that one pad is made with: carrier, mould halves a and b, for a pad with voids the cores, and for a stem with
/// recesses the bar below its LED strip. Throws InvalidArgument, MeshError.
inline std::vector<CastingPart> casting_kit(const HalfSection& section, const CastingOptions& options = {});

inline CastVolume cast_volume(const HalfSection& section, const CastingOptions& options = {});

/// What a printer or a caster has to know about this finger beside docs/fabrication.md, a sentence each. Throws
/// InvalidArgument.
inline std::vector<std::string> casting_notes(const HalfSection& section, const CastingOptions& options = {});

/// Smallest angle [rad] between the opening direction and the faces of a mould half that touch the pad; negative: an
/// undercut. Faces of the half that lie within the pad's box are such.
inline double least_draft(const TriangleSurface& half, const HalfSection& section, const Vec3d& direction);

/// Along which mould half A comes off; half B goes the other way. Ten degrees out of the parting's normal are the draft
/// of the pad's ends.
inline Vec3d opening_direction(double angle = 10.0_deg) { return {std::cos(angle), std::sin(angle), 0.0}; }

namespace detail {

/// Turned by a rotation and moved to the corner of the printer's bed.
inline CastingPart print_part(std::string name, TriangleSurface surface, const Mat3d& turn) {
  CastingPart part{std::move(name), surface, std::move(surface)};
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
  kit.back().stays = true;
  kit.push_back(detail::print_part("mould_a", mould_half_a(s, o), on_far_end));
  kit.push_back(detail::print_part("mould_b", mould_half_b(s, o), on_near_end));
  if (s.design.w_v > 0.0) {
    kit.push_back(detail::print_part("core", core_solid(s, o), on_side));
    kit.back().copies = 2;
  }
  if (CastingLayout(s, o).has_recesses()) {
    kit.push_back(detail::print_part("led_bar", led_bar_solid(s, o), on_side));
    kit.back().stays = true;
  }
  return kit;
}

inline CastVolume cast_volume(const HalfSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  CastVolume v{2.0 * s.exact_area_m2() * (1e-3 * s.pad.length), 0.0, 0.0};
  if (CastingLayout::has_cap(s)) v.pad += 2.0 * casting_cap_section(s).exact_area_m2() * (1e-3 * s.pad.cap_length);
  if (!at.has_recesses())
    v.fits = 4.0 * (at.pocket_x * at.pocket_y - 0.5 * o.strip_width * at.strip_y) * o.strip_height;
  const double ends = CastingLayout::has_cap(s) ? 0.5 * o.clearance : o.clearance;  // that the mould closes
  v.fits += (2.0 * at.stem_x * at.stem_height - 2.0 * at.block_x * at.seat) * ends;
  for (const Opening& opening : pour_openings(s, o)) v.openings += opening.volume_m3(at.mould_y - at.half_length);
  return v;
}

inline std::vector<std::string> casting_notes(const HalfSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  const auto mm = [](double length_m) { return short_number(1e3 * length_m); };
  std::vector<std::string> list;
  if (at.void_width > 0.0 && at.void_width < CastingOptions::thinnest_wall)
    list.push_back("the cores are " + mm(at.void_width) +
                   " mm thick, less than two lines of a 0.4 mm nozzle: cut them from sheet, by core.dxf");
  const double beside = at.stem_x - 0.5 * o.strip_width - o.clearance;
  if (beside < CastingOptions::thinnest_wall - 1e-9)
    list.push_back(
        "the carrier is " + mm(beside) + " mm thick beside the LED strip, less than two lines of a 0.4 mm nozzle");
  if (s.lies_on_stem())
    list.push_back("the silicone lies free on the stem: coat the stem's top" +
                   std::string(at.void_width > 0.0 ? "" : " and sides") +
                   (CastingLayout::has_cap(s) ? " and the carrier's end under the cap" : "") +
                   " with a release agent, and prime the other faces of the carrier that silicone touches");
  if (at.has_recesses())
    list.push_back("the recesses must stay full of air: before the stem is coated, cover each of the " +
                   std::to_string(o.leds.count) + ", " + mm(o.recess.length_y) + " mm long, with thin clear film");
  if (at.pour < 0.0)
    list.push_back(
        "the proximal end is poured: lean the mould with its plate down until silicone covers the stem's other "
        "end, below which air would stay");
  return list;
}

inline double least_draft(const TriangleSurface& half, const HalfSection& s, const Vec3d& direction) {
  constexpr double rounding = 1e-9;  // [m]
  const double width = s.half_width_m() + rounding, top = s.height_m() + rounding,
               length = 0.5 * s.length_m() + rounding, middle_y = 0.5e-3 * s.pad.cap_length,
               low = pad_outline(s).front()[1];
  double least = 0.5 * pi;
  for (const auto& t : half.triangles) {
    const Vec3d &a = half.vertices[std::size_t(t[0])], &b = half.vertices[std::size_t(t[1])],
                &c = half.vertices[std::size_t(t[2])];
    const Vec3d middle = (a + b + c) / 3.0;
    if (std::abs(middle.x()) > width || std::abs(middle.y() - middle_y) > length || middle.z() < low ||
        middle.z() > top)
      continue;
    const Vec3d normal = (b - a).cross(c - a).normalized();
    least = std::min(least, std::asin(std::clamp(-normal.dot(direction.normalized()), -1.0, 1.0)));
  }
  return least;
}

}  // namespace lumo
