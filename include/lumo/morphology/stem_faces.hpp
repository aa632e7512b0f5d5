#pragma once

#include "lumo/morphology/body.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace lumo {

/// A stretch along y of the top of a stem on which the silicone lies, between two recesses or the stem's ends [m].
struct Ridge {
  double low, high;
};

/// Stretches of the recesses' floors between ridges, low and high end along y [m].
inline std::vector<std::array<double, 2>> recess_floors(const std::vector<Ridge>& ridges) {
  std::vector<std::array<double, 2>> floors;
  for (std::size_t k = 0; k + 1 < ridges.size(); ++k) floors.push_back({ridges[k].high, ridges[k + 1].low});
  return floors;
}

/// A stem on which silicone lies, with edges of one radius [m].
struct FreeStem {
  double half_width, half_length, height;
  double floor;  ///< height of the floors between ridges
  std::vector<Ridge> ridges;
  double edge_radius;
};

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

// A rounded edge between two faces as chords: how far each point is from the sharp edge along the first face, and how
// far behind that face. Chords lie inside the edge: silicone that rests on it does not cross them.
inline std::array<std::array<double, 2>, 3> rounded_edge(double radius) {
  const double middle = (1.0 - std::sqrt(0.5)) * radius;
  return {{{radius, 0.0}, {middle, middle}, {0.0, radius}}};
}

// How far behind its sharp end a ridge meets a floor that lies `depth` below its top.
inline double ridge_foot(double radius, double depth) {
  const auto edge = rounded_edge(radius);
  for (std::size_t k = 0; k + 1 < edge.size(); ++k)
    if (edge[k + 1][1] > depth) {
      const double t = (depth - edge[k][1]) / (edge[k + 1][1] - edge[k][1]);
      return edge[k][0] + t * (edge[k + 1][0] - edge[k][0]);
    }
  return 0.0;
}

// One end of a ridge; `side`: −1 the low one, 1 the high one. An end of the stem goes down to its base, one at a recess
// to the floor.
inline void add_ridge_end(const FaceList& list, const FreeStem& stem, const Ridge& ridge, double side) {
  const double r = stem.edge_radius, w = stem.half_width, inner = w - r, h = stem.height;
  const double end = side < 0.0 ? ridge.low : ridge.high;
  const bool outer = std::abs(end) >= stem.half_length - 1e-9;
  const double bottom = outer ? 0.0 : stem.floor, side_bottom = outer ? 0.0 : stem.floor - r;
  const auto edge = rounded_edge(r);
  // Lit from outside: the order of corners that holds at the high end is turned round at the low one.
  const auto turned = [&](std::vector<Vec3d> corners) {
    if (side < 0.0) std::reverse(corners.begin() + 1, corners.end());
    return corners;
  };
  const auto across = [&](const std::string& name, double y0, double z0, double y1, double z1) {
    list.add(name, turned({{-inner, y0, z0}, {inner, y0, z0}, {inner, y1, z1}, {-inner, y1, z1}}));
  };
  for (std::size_t k = 0; k + 1 < edge.size(); ++k) {
    const double z0 = h - edge[k][1], z1 = std::max(h - edge[k + 1][1], bottom);
    if (z0 <= bottom) break;
    const double y1 = h - edge[k + 1][1] < bottom ? ridge_foot(r, h - bottom) : edge[k + 1][0];
    across(outer ? "stem edge" : "recess wall", end - side * edge[k][0], z0, end - side * y1, z1);
  }
  if (h - r > bottom) across(outer ? "stem end" : "recess wall", end, h - r, end, bottom);

  // The corner: an eighth of a sphere, and the upright edge below it. Towards a recess half of that is in the floor.
  const Vec3d middle(inner, end - side * r, h - r);
  const auto at = [&](double x, double y, double z) { return Vec3d(middle + r * Vec3d(x, side * y, z).normalized()); };
  const Vec3d top = at(0, 0, 1), right = at(1, 0, 0), front = at(0, 1, 0), top_right = at(1, 0, 1),
              top_front = at(0, 1, 1), right_front = at(1, 1, 0);
  const auto triangle = [&](const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    list.add_pair("stem corner", turned({a, b, c}));
  };
  triangle(top, top_right, top_front);
  triangle(top_right, right, right_front);
  triangle(top_right, right_front, top_front);
  triangle(top_front, right_front, front);
  const auto upright = [&](const Vec3d& a, const Vec3d& b) {
    list.add_pair("stem edge", turned({{a.x(), a.y(), side_bottom}, {b.x(), b.y(), side_bottom}, b, a}));
  };
  upright(right, right_front);
  if (outer) upright(right_front, front);
}

// Its ridges, the floors between them, and its sides; rounded edges as chords.
inline void add_free_stem(const FaceList& list, const FreeStem& stem) {
  const double r = stem.edge_radius, w = stem.half_width, inner = w - r, h = stem.height, l = stem.half_length - r;
  const auto edge = rounded_edge(r);
  const auto level = [&](const char* name, double y0, double y1, double z) {
    list.add(name, {{-inner, y0, z}, {inner, y0, z}, {inner, y1, z}, {-inner, y1, z}});
  };
  const auto long_edge = [&](double y0, double y1, double z) {
    for (std::size_t k = 0; k + 1 < edge.size(); ++k) {
      const double x0 = w - edge[k][0], z0 = z - edge[k][1], x1 = w - edge[k + 1][0], z1 = z - edge[k + 1][1];
      list.add_pair("stem edge", {{x1, y0, z1}, {x1, y1, z1}, {x0, y1, z0}, {x0, y0, z0}});
    }
  };
  list.add_pair("stem", {{w, -l, 0}, {w, l, 0}, {w, l, stem.floor - r}, {w, -l, stem.floor - r}});
  for (const Ridge& ridge : stem.ridges) {
    const double y0 = ridge.low + r, y1 = ridge.high - r;
    level("ridge", y0, y1, h);
    long_edge(y0, y1, h);
    list.add_pair("ridge side", {{w, y0, stem.floor - r}, {w, y1, stem.floor - r}, {w, y1, h - r}, {w, y0, h - r}});
    for (const double side : {-1.0, 1.0}) add_ridge_end(list, stem, ridge, side);
  }
  const double foot = ridge_foot(r, h - stem.floor);
  for (const auto& [from, to] : recess_floors(stem.ridges)) {
    level("recess floor", from - foot, to + foot, stem.floor);
    long_edge(from - r, to + r, stem.floor);
  }
}

}  // namespace detail
}  // namespace lumo
