#pragma once

#include "lumo/fabrication/solids.hpp"

#include <array>
#include <vector>

namespace lumo {

/// The rigid carrier: a plate with mounting holes, on it the block between the pad's shoulders, if it has any, and the
/// stem. Without recesses the LED strip lies in a pocket of the stem's top, and its wires leave by a duct through the
/// plate. Recesses are left whole but for windows: the strip comes from below, by a slot, and its LEDs end in the
/// recesses' floors. Stem and block are shorter than the pad by half a clearance at each end that the mould closes. The
/// carrier stands on its plate. Throws InvalidArgument, MeshError.
inline TriangleSurface carrier_solid(const HalfSection& section, const CastingOptions& options = {});

namespace detail {

/// Adds the faces of a carrier.
class CarrierSolid {
 public:
  CarrierSolid(const HalfSection& s, const CastingOptions& o)
      : o_(o),
        at_(s, o),
        led_y_(led_places(o.leds)),
        bottom_(at_.seat - at_.plate),
        holes_below_(holes(bottom_)),
        holes_above_(holes(at_.seat)) {
    if (at_.has_recesses()) ridges_ = stem_ridges(known_of_finger(s, o));
    else ridges_ = {{at_.stem_low, at_.stem_high}};
    ridges_.front().low = at_.stem_low;
    ridges_.back().high = at_.stem_high;
  }

  TriangleSurface surface() {
    for (std::size_t k = 0; k < holes_below_.size(); ++k) solid_.band(holes_below_[k], holes_above_[k]);
    solid_.band(plate(bottom_), plate(at_.seat));
    rail();
    if (at_.has_recesses()) slot();
    else pocket();
    underside();
    std::vector<Loop> openings = holes_above_;
    openings.push_back(reversed(foot()));
    solid_.face(plate(at_.seat), openings);
    if (at_.has_recesses()) recessed_top();
    else flat_top();
    return solid_.surface();
  }

 private:
  using Loop = typename FacetedSolid::Loop;

  Loop plate(double z) const {
    return rectangle(-at_.plate_x, at_.plate_x, at_.middle_y - at_.plate_y, at_.middle_y + at_.plate_y, z);
  }
  /// What stands on the plate.
  Loop foot() const {
    const double x = at_.is_stair() ? at_.block_x : at_.stem_x;
    return rectangle(-x, x, at_.stem_low, at_.stem_high, at_.seat);
  }
  Loop pocket(double z) const { return rectangle(-at_.pocket_x, at_.pocket_x, -at_.pocket_y, at_.pocket_y, z); }
  Loop duct(double z) const {
    const double x = 0.5 * o_.strip_width;
    return rectangle(-x, x, -at_.strip_y, CastingLayout::duct_length - at_.strip_y, z);
  }
  Loop window(double y, double z) const {
    const double half_x = 0.5 * o_.leds.width_x + o_.clearance, half_y = 0.5 * o_.leds.length_y + o_.clearance;
    return rectangle(-half_x, half_x, y - half_y, y + half_y, z);
  }
  /// Mounting holes, clockwise seen from above.
  std::vector<Loop> holes(double z) const {
    std::vector<Loop> loops;
    for (const double x : {-1.0, 1.0})
      for (const double y : {-1.0, 1.0})
        loops.push_back(reversed(ring(Vec3d(x * (at_.half_width - CastingLayout::hole_inset),
                                          at_.middle_y + y * (at_.half_length + 0.5 * o_.tab), z),
            Vec3d::UnitX(), Vec3d::UnitY(), 0.5 * o_.hole_diameter)));
    return loops;
  }

  Loop rail_end(double y, double side) const;
  Loop stem_side(double side) const;
  void rail();
  void pocket();
  void slot();
  void underside();
  void flat_top();
  void recessed_top();

  const CastingOptions& o_;
  CastingLayout at_;
  std::vector<double> led_y_;
  double bottom_;
  std::vector<Loop> holes_below_, holes_above_;
  std::vector<Ridge> ridges_;
  FacetedSolid solid_;
};

/// Of stem and block: seen along +y for `side` 1, from the other end for −1, counter-clockwise.
inline auto CarrierSolid::rail_end(double y, double side) const -> Loop {
  const double w = side * at_.stem_x, b = side * at_.block_x, top = at_.stem_height;
  if (!at_.is_stair()) return {{-w, y, at_.seat}, {w, y, at_.seat}, {w, y, top}, {-w, y, top}};
  return {{-b, y, at_.seat}, {b, y, at_.seat}, {b, y, 0.0}, {w, y, 0.0}, {w, y, top}, {-w, y, top}, {-w, y, 0.0},
      {-b, y, 0.0}};
}

/// At x > 0 for `side` 1, at x < 0 for −1, counter-clockwise from outside, with the recesses' ends.
inline auto CarrierSolid::stem_side(double side) const -> Loop {
  const double x = side * at_.stem_x, from = side > 0.0 ? at_.stem_low : at_.stem_high,
               to = side > 0.0 ? at_.stem_high : at_.stem_low, h = at_.stem_height, floor = at_.recess_floor;
  Loop recesses;  // towards +y
  for (const auto& [low, high] : recess_floors(ridges_))
    recesses.insert(recesses.end(), {{x, low, h}, {x, low, floor}, {x, high, floor}, {x, high, h}});
  if (side > 0.0) recesses = reversed(recesses);
  Loop loop{{x, from, 0.0}, {x, to, 0.0}, {x, to, h}};
  loop.insert(loop.end(), recesses.begin(), recesses.end());
  loop.emplace_back(x, from, h);
  return loop;
}

/// The sides and ends of stem and block, and the block's top.
inline void CarrierSolid::rail() {
  const double w = at_.stem_x, b = at_.block_x, low = at_.stem_low, high = at_.stem_high, seat = at_.seat;
  solid_.face(rail_end(low, 1.0));
  solid_.face(stem_side(1.0));
  solid_.face(rail_end(high, -1.0));
  solid_.face(stem_side(-1.0));
  if (!at_.is_stair()) return;
  solid_.face({{b, low, seat}, {b, high, seat}, {b, high, 0.0}, {b, low, 0.0}});
  solid_.face({{-b, high, seat}, {-b, low, seat}, {-b, low, 0.0}, {-b, high, 0.0}});
  solid_.face(rectangle(w, b, low, high, 0.0));
  solid_.face(rectangle(-b, -w, low, high, 0.0));
}

/// From above; the wires' duct goes on through the plate.
inline void CarrierSolid::pocket() {
  solid_.band(reversed(duct(bottom_)), reversed(duct(at_.pocket_floor)));
  solid_.band(reversed(pocket(at_.pocket_floor)), reversed(pocket(at_.stem_height)));
}

/// From below, with a window for each LED.
inline void CarrierSolid::slot() {
  const double ceiling = at_.slot_ceiling(o_);
  solid_.band(reversed(pocket(bottom_)), reversed(pocket(ceiling)));
  std::vector<Loop> windows;
  for (const double y : led_y_) {
    solid_.band(reversed(window(y, ceiling)), reversed(window(y, at_.recess_floor)));
    windows.push_back(window(y, ceiling));
  }
  solid_.face(reversed(pocket(ceiling)), windows);
}

inline void CarrierSolid::underside() {
  std::vector<Loop> openings;  // seen from below
  for (const Loop& loop : holes_below_) openings.push_back(reversed(loop));
  openings.push_back(at_.has_recesses() ? pocket(bottom_) : duct(bottom_));
  solid_.face(reversed(plate(bottom_)), openings);
}

inline void CarrierSolid::flat_top() {
  solid_.face(pocket(at_.pocket_floor), {reversed(duct(at_.pocket_floor))});
  solid_.face(rectangle(-at_.stem_x, at_.stem_x, at_.stem_low, at_.stem_high, at_.stem_height),
      {reversed(pocket(at_.stem_height))});
}

inline void CarrierSolid::recessed_top() {
  const double w = at_.stem_x, h = at_.stem_height, floor = at_.recess_floor;
  for (const Ridge& r : ridges_) solid_.face(rectangle(-w, w, r.low, r.high, h));
  const auto floors = recess_floors(ridges_);
  for (std::size_t k = 0; k < floors.size(); ++k) {
    const auto [from, to] = floors[k];
    solid_.face(rectangle(-w, w, from, to, floor), {reversed(window(led_y_[k], floor))});
    solid_.face({{w, from, floor}, {-w, from, floor}, {-w, from, h}, {w, from, h}});
    solid_.face({{-w, to, floor}, {w, to, floor}, {w, to, h}, {-w, to, h}});
  }
}

}  // namespace detail

inline TriangleSurface carrier_solid(const HalfSection& s, const CastingOptions& o) {
  validate(o, s);
  return detail::CarrierSolid(s, o).surface();
}

}  // namespace lumo
