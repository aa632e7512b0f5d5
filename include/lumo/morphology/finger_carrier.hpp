#pragma once

#include "lumo/morphology/body.hpp"
#include "lumo/morphology/finger_options.hpp"
#include "lumo/morphology/section.hpp"
#include "lumo/morphology/stem_faces.hpp"

#include <cstddef>
#include <vector>

namespace lumo {

/// Where the LEDs lie along the finger [m].
inline std::vector<double> led_places(const FingerOptions::Leds& leds) {
  std::vector<double> y;
  for (int k = 0; k < leds.count; ++k) y.push_back((k - 0.5 * (leds.count - 1)) * leds.pitch);
  return y;
}

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

/// The carrier's boxes. Throws InvalidArgument where a stem's edges cannot be as round as asked for.
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
  } else {
    boxes.push_back(box(at.stem, -at.half_length, at.half_length, low, at.floor));
    for (const Ridge& ridge : stem_ridges(o)) boxes.push_back(box(at.stem, ridge.low, ridge.high, low, at.height));
  }
  if (s.lies_on_stem())
    for (std::size_t k = 1; k < boxes.size(); ++k) {
      boxes[k].edge_radius = o.stem_edge_radius;
      require_in_range(
          "radius of a free stem's edges", o.stem_edge_radius * 1e3, 0.0, boxes[k].half.minCoeff() * 1e3, "mm");
    }
  return boxes;
}

namespace detail {

// Faces of a bonded stem beside voids.
inline void add_bonded_stem(const FaceList& list, const StemLengths& at, bool capped) {
  const double w = at.stem, l = at.half_length, h = at.height;
  list.add_pair("stem", {{w, -l, 0}, {w, l, 0}, {w, l, h}, {w, -l, h}});
  if (capped) list.add("stem end", {{w, l, 0}, {-w, l, 0}, {-w, l, h}, {w, l, h}});
}

// The end of the block, at which a solid cap looks.
inline void add_block_end(const FaceList& list, const StemLengths& at, double shoulder) {
  const double y = at.half_length;
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
  const bool capped = s.pad.cap_length > 0.0;
  if (s.lies_on_stem())
    detail::add_free_stem(list, {at.stem, l, at.height, at.floor, stem_ridges(o), o.stem_edge_radius});
  else detail::add_bonded_stem(list, at, capped);
  list.add_pair("base", {{at.stem, -l, 0}, {at.outer, -l, 0}, {at.outer, l, 0}, {at.stem, l, 0}});
  if (capped) detail::add_block_end(list, at, -1e-3 * s.pad.shoulder_height);
  return faces;
}

}  // namespace lumo
