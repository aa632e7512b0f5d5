#pragma once

#include "lumo/fabrication/solids.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

namespace lumo {

/// An opening through the mould's wall at the end at which the pad is poured: the frustum of a cone along y; lengths in
/// m, places in (x, z).
struct Opening {
  std::array<double, 2> at_pad, outside;  ///< centres at the pad's end and at the mould's outer face
  double radius, outer_radius;

  /// Volume of the opening, which is cut as a frustum over a regular polygon [m³].
  double volume_m3(double length, int corners = 32) const {
    const double unit = 0.5 * corners * std::sin(2.0 * pi / corners);
    return unit * length / 3.0 * (radius * radius + radius * outer_radius + outer_radius * outer_radius);
  }
};

/// A gate near the dome's middle, and a vent in each lower corner, where air would stay: poured with this end up, the
/// end face is the highest place of the cavity.
inline std::vector<Opening> pour_openings(const HalfSection& section, const CastingOptions& options = {});

/// Mould half A: the pad's side at x > 0 and its whole distal end. Half B is the other side and the other end. The end
/// that is poured has gate, vents and openings for the cores: the distal one, or the proximal one of a pad with a cap.
/// The parting runs along the crown (x = 0) and round the ends, so that no face of the pad needs draft of its own:
/// opened along (cos β, sin β, 0) the ends draw at β and the crown at its own slope. A cone and a socket on the parting
/// face centre the halves; the rim below takes in the carrier's plate. Throws InvalidArgument, MeshError.
inline TriangleSurface mould_half_a(const HalfSection& section, const CastingOptions& options = {});
inline TriangleSurface mould_half_b(const HalfSection& section, const CastingOptions& options = {});

inline std::vector<Opening> pour_openings(const HalfSection& s, const CastingOptions& o) {
  // Own choices: a funnel of 15° half angle that widens upwards only, as far as the mould allows, high up in a thick
  // dome; vents in the corners that open outwards, at most to the mould's wall there.
  constexpr double gate_depth = 4.5e-3, above_funnel = 2.0e-3, widest_vent = 1.9e-3;
  const CastingLayout at(s, o);
  const double length = at.mould_y - at.half_length, gate = 0.5 * o.gate_diameter, vent = 0.5 * o.vent_diameter;
  const double z = std::max(0.5 * (at.stem_height + at.top), at.top - gate_depth);
  const double funnel =
      std::max(gate, std::min(gate + length * std::tan(15.0_deg), 0.5 * (at.mould_top - above_funnel - (z - gate))));
  const double corner_x = at.half_width - CastingLayout::vent_inset, corner_z = at.seat + CastingLayout::vent_inset;
  std::vector<Opening> list{{{0.0, z}, {0.0, z - gate + funnel}, gate, funnel}};
  for (const double side : {-1.0, 1.0})
    list.push_back({{side * corner_x, corner_z}, {side * corner_x, corner_z}, vent,
        std::min(vent + length * std::tan(3.0_deg), widest_vent)});
  return list;
}

namespace detail {

/// Adds the faces of one half, as of half A with the pad's middle at y = 0; `poured` is that with the openings, and
/// with notches for the cores, which are closed below by the mould where the plate lies lower than they.
class MouldHalf {
 public:
  MouldHalf(const HalfSection& s, const CastingOptions& o, bool poured)
      : o_(o),
        at_(s, o),
        outline_(pad_outline(s)),
        near_(-at_.half_length),
        end_(at_.half_length),
        rim_(at_.seat - at_.rim) {
    if (!poured) return;
    for (const Opening& opening : pour_openings(s, o))
      passages_.push_back(
          {round(opening.at_pad, end_, opening.radius), round(opening.outside, at_.mould_y, opening.outer_radius)});
    if (at_.void_width <= 0.0) return;
    const std::vector<Notch> cores{{-at_.notch_outer, -at_.notch_inner}, {at_.notch_inner, at_.notch_outer}};
    if (!at_.is_stair()) notches_ = cores;
    else
      for (const Notch& core : cores) passages_.push_back({window(core, end_), window(core, at_.mould_y)});
  }

  TriangleSurface surface() {
    cavity();
    parting();
    underside();
    outside();
    notches();
    for (const Passage& p : passages_) solid_.band(reversed(p.outside), reversed(p.at_pad));
    return solid_.surface();
  }

 private:
  using Loop = typename FacetedSolid::Loop;
  using Corners = std::vector<std::array<double, 2>>;

  struct Notch {
    double from, to;  ///< along x
  };
  /// Through the end wall; counter-clockwise seen along +y.
  struct Passage {
    Loop at_pad, outside;
  };

  static Loop round(const std::array<double, 2>& center, double y, double radius) {
    return ring(Vec3d(center[0], y, center[1]), Vec3d::UnitX(), Vec3d::UnitZ(), radius);
  }
  /// Of a core's opening where it is closed below.
  Loop window(const Notch& n, double y) const {
    const double low = -o_.clearance, roof = at_.notch_roof;
    return upright({{n.from, low}, {n.to, low}, {n.to, roof}, {n.from, roof}}, y);
  }

  /// Of corners (x, z), in a plane of constant y.
  static Loop upright(const Corners& corners, double y) {
    Loop loop;
    for (const auto& c : corners) loop.emplace_back(c[0], y, c[1]);
    return loop;
  }
  /// Of corners (y, z), in a plane of constant x.
  static Loop lengthwise(const Corners& corners, double x) {
    Loop loop;
    for (const auto& c : corners) loop.emplace_back(x, c[0], c[1]);
    return loop;
  }
  /// Of corners (x, y), in a plane of constant z.
  static Loop level(const Corners& corners, double z) {
    Loop loop;
    for (const auto& c : corners) loop.emplace_back(c[0], c[1], z);
    return loop;
  }

  /// A line at height z from the mould's left side, with a step up to `up` over each core.
  Corners stepped(double z, double up) const {
    Corners line{{-at_.mould_x, z}};
    for (const auto& [a, b] : notches_) line.insert(line.end(), {{a, z}, {a, up}, {b, up}, {b, z}});
    return line;
  }

  void cavity();
  void parting();
  void underside();
  void outside();
  void notches();

  const CastingOptions& o_;
  CastingLayout at_;
  Corners outline_;
  std::vector<Passage> passages_;
  std::vector<Notch> notches_;  ///< open towards the plate
  double near_, end_, rim_;     ///< y of the cavity's ends, z of the rim's foot
  FacetedSolid solid_;
};

/// The pad's side, the end that closes it, and the flat face at which the other half's end closes it.
inline void MouldHalf::cavity() {
  solid_.band(upright(outline_, near_), upright(outline_, end_), false);
  const Corners crown(outline_.rbegin(), outline_.rend());
  Corners face{{at_.half_width, at_.seat}, {at_.rim_x, at_.seat}, {at_.rim_x, rim_}, {at_.mould_x, rim_},
      {at_.mould_x, at_.mould_top}, {0.0, at_.mould_top}};
  face.insert(face.end(), crown.begin(), crown.end() - 1);
  solid_.face(upright(face, near_));

  Corners wall = stepped(at_.seat, at_.notch_roof);
  wall.insert(wall.end(), outline_.begin(), outline_.end());
  wall.insert(wall.end(), {{0.0, at_.mould_top}, {-at_.mould_x, at_.mould_top}});
  std::vector<Loop> holes;
  for (const Passage& p : passages_) holes.push_back(reversed(p.at_pad));
  solid_.face(upright(wall, end_), holes);
}

/// The face on the crown with a cone towards +y and a socket for the other half's towards −y. Their 20° let them go
/// along any opening direction up to that.
inline void MouldHalf::parting() {
  constexpr double radius = 2.5e-3, height = 3.0e-3;
  const double tip = radius - height * std::tan(20.0_deg), c = o_.clearance, z = at_.top + 0.5 * o_.wall,
               y = 0.67 * at_.half_length;
  const auto around = [&](double x, double place, double r) {
    return ring(Vec3d(x, place, z), Vec3d::UnitZ(), Vec3d::UnitY(), r);
  };  // seen from −x
  solid_.face(lengthwise({{near_, at_.top}, {near_, at_.mould_top}, {end_, at_.mould_top}, {end_, at_.top}}, 0.0),
      {reversed(around(0.0, y, radius)), reversed(around(0.0, -y, radius + c))});
  solid_.band(around(0.0, y, radius), around(-height, y, tip));
  solid_.face(around(-height, y, tip));
  solid_.band(reversed(around(height + c, -y, tip + c)), reversed(around(0.0, -y, radius + c)));
  solid_.face(around(height + c, -y, tip + c));
}

/// The ledge that lies on the carrier's plate, and the rim round it.
inline void MouldHalf::underside() {
  const double left = -at_.mould_x, seat = at_.seat, from = notches_.empty() ? left : at_.notch_outer;
  solid_.face(reversed(level({{at_.half_width, near_}, {at_.rim_x, near_}, {at_.rim_x, at_.rim_y}, {from, at_.rim_y},
                                 {from, end_}, {at_.half_width, end_}},
      seat)));
  if (!notches_.empty())
    for (const auto& [a, b] : {std::pair{left, -at_.notch_outer}, std::pair{-at_.notch_inner, at_.notch_inner}})
      solid_.face(reversed(rectangle(a, b, end_, at_.rim_y, seat)));
  solid_.face(reversed(level({{at_.rim_x, near_}, {at_.mould_x, near_}, {at_.mould_x, at_.mould_y}, {left, at_.mould_y},
                                 {left, at_.rim_y}, {at_.rim_x, at_.rim_y}},
      rim_)));
  solid_.face(reversed(lengthwise({{near_, rim_}, {at_.rim_y, rim_}, {at_.rim_y, seat}, {near_, seat}}, at_.rim_x)));
  Corners inner = stepped(seat, -o_.clearance);  // along its top
  std::reverse(inner.begin(), inner.end());
  inner.insert(inner.end(), {{left, rim_}, {at_.rim_x, rim_}, {at_.rim_x, seat}});
  solid_.face(upright(inner, at_.rim_y));
}

inline void MouldHalf::outside() {
  const double right = at_.mould_x, top = at_.mould_top, far = at_.mould_y;
  solid_.face(level({{0.0, near_}, {right, near_}, {right, far}, {-right, far}, {-right, end_}, {0.0, end_}}, top));
  solid_.face(lengthwise({{near_, rim_}, {far, rim_}, {far, top}, {near_, top}}, right));
  solid_.face(reversed(lengthwise(
      {{end_, at_.seat}, {at_.rim_y, at_.seat}, {at_.rim_y, rim_}, {far, rim_}, {far, top}, {end_, top}}, -right)));
  std::vector<Loop> holes;
  for (const Notch& n : notches_) holes.push_back(window(n, far));
  for (const Passage& p : passages_) holes.push_back(p.outside);
  solid_.face(reversed(upright({{-right, rim_}, {right, rim_}, {right, top}, {-right, top}}, far)), holes);
}

/// Through the end wall, open to the plate; the rim below it is a clearance lower, so that the core lies on the plate.
inline void MouldHalf::notches() {
  const double low = -o_.clearance, roof = at_.notch_roof, far = at_.mould_y;
  const Corners cheek{{end_, 0.0}, {at_.rim_y, 0.0}, {at_.rim_y, low}, {far, low}, {far, roof}, {end_, roof}};
  for (const auto& [a, b] : notches_) {
    solid_.face(lengthwise(cheek, a));
    solid_.face(reversed(lengthwise(cheek, b)));
    solid_.face(reversed(rectangle(a, b, end_, far, roof)));
    solid_.face(rectangle(a, b, at_.rim_y, far, low));
  }
}

}  // namespace detail

inline TriangleSurface mould_half_a(const HalfSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  TriangleSurface half = detail::MouldHalf(s, o, at.pour > 0.0).surface();
  for (Vec3d& v : half.vertices) v.y() += at.middle_y;
  return half;
}

inline TriangleSurface mould_half_b(const HalfSection& s, const CastingOptions& o) {
  validate(o, s);
  const CastingLayout at(s, o);
  TriangleSurface half = detail::MouldHalf(s, o, at.pour < 0.0).surface();
  for (Vec3d& v : half.vertices) v = Vec3d(-v.x(), at.middle_y - v.y(), v.z());
  return half;
}

}  // namespace lumo
