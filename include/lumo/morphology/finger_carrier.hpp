#pragma once

#include "lumo/morphology/body.hpp"
#include "lumo/morphology/finger_options.hpp"
#include "lumo/morphology/section.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <vector>

namespace lumo {

/// Where the LEDs lie along the finger [m].
inline std::vector<double> led_places(const FingerOptions::Leds& leds) {
  std::vector<double> y;
  for (int k = 0; k < leds.count; ++k) y.push_back((k - 0.5 * (leds.count - 1)) * leds.pitch);
  return y;
}

/// A stretch along y of the top of a stem on which the silicone lies, between two recesses or the stem's ends [m].
struct Ridge {
  double low, high;
};

/// Ridges of a stem; one if it has no recesses.
inline std::vector<Ridge> stem_ridges(const FingerOptions& o) {
  const double half = 0.5e-3 * o.pad.length;
  std::vector<Ridge> ridges{{-half, half}};
  if (o.recess.depth > 0.0)
    for (const double y : led_places(o.leds)) {
      ridges.back().high = y - 0.5 * o.recess.length_y;
      ridges.push_back({y + 0.5 * o.recess.length_y, half});
    }
  return ridges;
}

/// Lengths of a finger's carrier [m].
struct StemLengths {
  double stem, outer, lip, height, half_length;
  double floor;  ///< height of the recesses' floors

  StemLengths(const HalfSection& s, const FingerOptions& o)
      : stem(0.5e-3 * s.design.w_s),
        outer(stem + 1e-3 * s.design.w_v),
        lip(1e-3 * s.pad.lip_end()),
        height(1e-3 * s.design.h_s),
        half_length(0.5e-3 * s.pad.length),
        floor(height - o.recess.depth) {}
};

/// The carrier's boxes.
inline std::vector<RigidBox> carrier_boxes(const HalfSection& s, const FingerOptions& o) {
  if (s.twin == Twin::unsupported_base || s.twin == Twin::held_top) return {};
  const StemLengths at(s, o);
  const double back = -1e-3 * s.pad.carrier_height;
  const auto box = [&](double x, double y0, double y1, double z0, double z1) {
    return RigidBox{{0, 0.5 * (y0 + y1), 0.5 * (z0 + z1)}, {x, 0.5 * (y1 - y0), 0.5 * (z1 - z0)}};
  };
  std::vector<RigidBox> boxes{box(at.lip, -at.half_length, at.half_length, back, 0.0)};
  if (s.twin == Twin::bonded_base) return boxes;
  const double low = s.pad.stem == Stem::bonded ? 0.5 * back : back;  // inside the block
  if (s.pad.stem == Stem::bonded || o.recess.depth == 0.0) {
    boxes.push_back(box(at.stem, -at.half_length, at.half_length, low, at.height));
    return boxes;
  }
  boxes.push_back(box(at.stem, -at.half_length, at.half_length, low, at.floor));
  for (const Ridge& ridge : stem_ridges(o)) boxes.push_back(box(at.stem, ridge.low, ridge.high, low, at.height));
  return boxes;
}

/// Stretches of the recesses' floors between ridges, low and high end along y [m].
inline std::vector<std::array<double, 2>> recess_floors(const std::vector<Ridge>& ridges) {
  std::vector<std::array<double, 2>> floors;
  for (std::size_t k = 0; k + 1 < ridges.size(); ++k) floors.push_back({ridges[k].high, ridges[k + 1].low});
  return floors;
}

/// What the patches of a finger on a free stem rest on: the cavity's roof on the stem's top, its walls on the stem's
/// sides, both on the block between them, and the cap's wall on the stem's end.
inline std::vector<Support> carrier_supports(const HalfSection& s, const FingerOptions& o) {
  if (!s.lies_on_stem()) return {};
  const StemLengths at(s, o);
  const double l = at.half_length, h = at.height;
  std::vector<Support> supports;
  const auto add = [&](const char* patch, const Vec3d& center, const Vec3d& half_u, const Vec3d& half_v) {
    supports.push_back({patch, center, half_u, half_v});
  };
  const auto add_top = [&](double from, double to, double z) {
    add("void_roof", {0, 0.5 * (from + to), z}, {at.stem, 0, 0}, {0, 0.5 * (to - from), 0});
  };
  const std::vector<Ridge> ridges = stem_ridges(o);
  for (const Ridge& r : ridges) add_top(r.low, r.high, h);
  for (const auto& [from, to] : recess_floors(ridges)) add_top(from, to, at.floor);
  for (const double side : {1.0, -1.0}) {
    add("void_wall", {side * at.stem, 0, 0.5 * h}, {0, side * l, 0}, {0, 0, 0.5 * h});
    if (at.outer <= at.stem) continue;
    for (const char* patch : {"void_roof", "void_wall"})
      add(patch, {0.5 * side * (at.stem + at.outer), 0, 0}, {0.5 * (at.outer - at.stem), 0, 0}, {0, l, 0});
  }
  if (s.pad.cap_length > 0.0) add("cap_wall", {0, l, 0.5 * h}, {0, 0, 0.5 * h}, {at.stem, 0, 0});
  return supports;
}

namespace detail {

/// Collects carrier faces; those without area are left out.
struct FaceList {
  std::vector<RigidFace>& faces;
  SurfaceOptics optics;

  void add(std::string name, std::vector<Vec3d> corners) const {
    Vec3d area = Vec3d::Zero();
    for (std::size_t k = 1; k + 1 < corners.size(); ++k)
      area += (corners[k] - corners[0]).cross(corners[k + 1] - corners[0]);
    if (area.norm() > 1e-12) faces.push_back({std::move(name), std::move(corners), optics});  // [m²]
  }
  /// The face and its image at negative x.
  void add_pair(const std::string& name, std::vector<Vec3d> corners) const {
    std::vector<Vec3d> image(corners);
    std::reverse(image.begin() + 1, image.end());
    for (Vec3d& p : image) p.x() = -p.x();
    add(name + " +x", std::move(corners));
    add(name + " -x", std::move(image));
  }
};

// Faces of a stem on which silicone lies: its ridges, and the floors between them.
inline void add_free_stem(const FaceList& list, const StemLengths& at, const FingerOptions& o) {
  const double w = at.stem, h = at.height, l = at.half_length, floor = at.floor;
  const std::vector<Ridge> ridges = stem_ridges(o);
  list.add_pair("stem", {{w, -l, 0}, {w, l, 0}, {w, l, floor}, {w, -l, floor}});
  for (const Ridge& r : ridges) {
    list.add("ridge", {{-w, r.low, h}, {w, r.low, h}, {w, r.high, h}, {-w, r.high, h}});
    list.add_pair("ridge side", {{w, r.low, floor}, {w, r.high, floor}, {w, r.high, h}, {w, r.low, h}});
  }
  for (const auto& [from, to] : recess_floors(ridges)) {
    list.add("recess floor", {{-w, from, floor}, {w, from, floor}, {w, to, floor}, {-w, to, floor}});
    list.add("recess wall", {{w, from, floor}, {-w, from, floor}, {-w, from, h}, {w, from, h}});
    list.add("recess wall", {{-w, to, floor}, {w, to, floor}, {w, to, h}, {-w, to, h}});
  }
}

// Faces that a solid cap looks at: the ends of stem and block.
inline void add_carrier_end(const FaceList& list, const StemLengths& at, double shoulder) {
  const double w = at.stem, y = at.half_length, h = at.height;
  list.add("stem end", {{w, y, 0}, {-w, y, 0}, {-w, y, h}, {w, y, h}});
  list.add("block end", {{at.lip, y, shoulder}, {-at.lip, y, shoulder}, {-at.lip, y, 0}, {at.lip, y, 0}});
}

}  // namespace detail

/// Faces of the carrier that light meets through air.
inline std::vector<RigidFace> carrier_faces(const HalfSection& s, const FingerOptions& o) {
  const StemLengths at(s, o);
  std::vector<RigidFace> faces;
  const detail::FaceList list{faces, Lambertian{o.carrier_albedo}};
  const double l = at.half_length;
  if (!has_stem(s.twin) || (!s.lies_on_stem() && s.design.w_v <= 0.0)) return faces;
  if (s.lies_on_stem()) detail::add_free_stem(list, at, o);
  else list.add_pair("stem", {{at.stem, -l, 0}, {at.stem, l, 0}, {at.stem, l, at.height}, {at.stem, -l, at.height}});
  list.add_pair("base", {{at.stem, -l, 0}, {at.outer, -l, 0}, {at.outer, l, 0}, {at.stem, l, 0}});
  if (s.pad.cap_length > 0.0) detail::add_carrier_end(list, at, -1e-3 * s.pad.shoulder_height);
  return faces;
}

}  // namespace lumo
