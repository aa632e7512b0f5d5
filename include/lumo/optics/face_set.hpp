#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/sobol.hpp"
#include "lumo/core/types.hpp"
#include "lumo/optics/optical_scene.hpp"
#include "lumo/optics/ray_pattern.hpp"
#include "lumo/optics/surface_optics.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <vector>

namespace lumo::detail {

/// Some faces of a scene, those larger than `largest_m` (edge of a square of twice their area) cut into their sub-facets, each with a block
/// of a low-discrepancy sequence: points and directions on it that do not depend on the state, and are mirror images on faces that are
/// mirror images. In a plane of `symmetry` mirror images are one face.
class FaceSet {
 public:
  struct Face {
    int face;                         ///< of the scene
    int sub;                          ///< its sub-facet; −1: all of it
    Vec3 mirror;                      ///< (±1, ±1, 1): from the image with x ≥ 0, y ≥ 0 to this face
    std::array<int, 3> corner_order;  ///< corners in an order that mirror images share
    std::uint32_t block = 0;          ///< place in the sequence of rays; the same for mirror images
  };

  template <class Predicate>
  FaceSet(const OpticalScene& scene, Symmetry symmetry, double largest_m, Predicate&& wanted);

  std::size_t size() const { return faces_.size(); }
  const Face& operator[](std::size_t k) const { return faces_[k]; }
  /// Index of the face that a point lies on, or −1.
  int index(const ScenePoint& p) const { return p.face >= 0 ? index_[std::size_t(p.face * per_face_ + p.sub)] : -1; }
  /// Deformed area [m²].
  double area(std::size_t k, const OpticalScene& scene) const {
    return faces_[k].sub < 0 ? scene.area(faces_[k].face) : scene.triangle_area(faces_[k].face * per_face_ + faces_[k].sub);
  }

  /// A point on a face.
  struct Sample {
    ScenePoint at;
    PrimaryRay ray;           ///< starts there; its direction is left open
    Vec3 normal;              ///< unit outward normal of the flat triangle
    double area = 0.0;        ///< that it stands for, if it were the only one [m²]
    std::uint32_t index = 0;  ///< in the sequence
  };
  /// Sample `i` of `count` of face `k`. Takes dimensions 2 and 3 of the sequence; 0 and 1 are for its direction.
  Sample sample(std::size_t k, const OpticalScene& scene, const OwenSobol& sequence, std::uint32_t i, std::uint32_t count) const;
  /// Power of two that comes nearest below `total` samples in all, counting mirror images that are not traced.
  std::uint32_t per_face(double total, double images) const {
    return std::bit_floor(std::max(2u, std::uint32_t(total / std::max(1.0, images * double(size())))));
  }

 private:
  using Key = std::array<long long, 3>;
  // Places to about a nanometre. The odd unit keeps round coordinates off the borders of its cells.
  static Key key(const Vec3& p) {
    constexpr double unit = 1.0471975512e-9;
    return {std::llround(p.x() / unit), std::llround(p.y() / unit), std::llround(p.z() / unit)};
  }
  // Place along Morton's curve, 10 bits an axis; cells do not line up with regular grids.
  static std::uint64_t morton(const Vec3& unit_cube);

  int per_face_;  ///< sub-facets of a face
  std::vector<Face> faces_;
  std::vector<int> index_;  ///< per triangle of the scene
};

inline std::uint64_t FaceSet::morton(const Vec3& p) {
  std::uint64_t code = 0;
  for (int bit = 9; bit >= 0; --bit)
    for (Eigen::Index a = 0; a < 3; ++a) code = (code << 1) | ((std::uint64_t(std::clamp(p[a], 0.0, 1.0) * 1013.37 + 0.318) >> bit) & 1u);
  return code;
}

template <class Predicate>
FaceSet::FaceSet(const OpticalScene& scene, Symmetry symmetry, double largest_m, Predicate&& wanted)
    : per_face_(scene.triangles_per_face()), index_(scene.face_count() * std::size_t(per_face_), -1) {
  std::map<Key, int> known;   // folded by the symmetry → index
  std::vector<Vec3> centers;  // with x ≥ 0, y ≥ 0
  std::vector<int> images;    // faces folded onto each
  std::vector<bool> in_plane;
  const auto add = [&](int f, int sub) {
    const std::array<Vec3, 3> corner = scene.reference_corners(f, sub);
    const Vec3 center = (corner[0] + corner[1] + corner[2]) / 3.0;
    Vec3 mirror = Vec3::Ones();
    for (Eigen::Index a = 0; a < 2; ++a)
      if (center[a] < -1e-9) mirror[a] = -1.0;
    Vec3 folded = center;
    if (symmetry.x) folded.x() = std::abs(folded.x());
    if (symmetry.y) folded.y() = std::abs(folded.y());
    const bool fundamental = !(symmetry.x && mirror.x() < 0.0) && !(symmetry.y && mirror.y() < 0.0);
    Face face{f, sub, mirror, {0, 1, 2}, 0};
    std::sort(face.corner_order.begin(), face.corner_order.end(), [&](int a, int b) {
      return key(mirror.cwiseProduct(corner[std::size_t(a)])) < key(mirror.cwiseProduct(corner[std::size_t(b)]));
    });
    const auto [it, fresh] = known.try_emplace(key(folded), int(faces_.size()));
    const std::size_t k = std::size_t(it->second);
    if (fresh) {
      faces_.push_back(face);
      centers.push_back(mirror.cwiseProduct(center));
      images.push_back(0);
      in_plane.push_back(std::abs(center.x()) < 1e-9 || std::abs(center.y()) < 1e-9);
    } else if (fundamental) {
      faces_[k] = face;
    }
    ++images[k];
    const auto first = index_.begin() + f * per_face_ + std::max(sub, 0);
    std::fill(first, first + (sub < 0 ? per_face_ : 1), it->second);
  };
  for (int f = 0; f < int(scene.face_count()); ++f) {
    if (!wanted(f)) continue;
    const auto [a, b, c] = scene.reference_corners(f, -1);
    if ((b - a).cross(c - a).norm() <= largest_m * largest_m)
      add(f, -1);
    else
      for (int sub = 0; sub < per_face_; ++sub) add(f, sub);
  }
  const int expected = (symmetry.x ? 2 : 1) * (symmetry.y ? 2 : 1);
  for (std::size_t k = 0; k < faces_.size(); ++k)
    if (images[k] != expected && !in_plane[k])
      throw InvalidArgument("optical scene: a symmetric state is claimed, but the surface mesh is not symmetric");

  // Neighbours take neighbouring blocks of the sequence: together they are stratified more finely than each alone.
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (const Vec3& c : centers) low = low.cwiseMin(c), high = high.cwiseMax(c);
  const double scale = faces_.empty() ? 1.0 : 1.0 / std::max(1e-12, (high - low).maxCoeff());
  std::map<Key, std::uint64_t> codes;  // the code of one of two mirror images serves both: rounding could part them
  for (const Vec3& c : centers) codes.try_emplace(key(c), morton(scale * (c - low)));
  std::map<std::pair<std::uint64_t, Key>, std::uint32_t> order;
  for (const auto& [k, code] : codes) order[{code, k}] = 0;
  std::uint32_t next = 0;
  for (auto& [place, block] : order) block = next++;
  for (std::size_t k = 0; k < faces_.size(); ++k) faces_[k].block = order[{codes[key(centers[k])], key(centers[k])}];
}

inline FaceSet::Sample FaceSet::sample(std::size_t k, const OpticalScene& scene, const OwenSobol& sequence, std::uint32_t i,
                                       std::uint32_t count) const {
  const Face& f = faces_[k];
  Sample x;
  x.index = f.block * count + i;
  const double s = std::sqrt(sequence(x.index, 2)), v = sequence(x.index, 3);
  std::array<double, 3> b{};
  b[std::size_t(f.corner_order[0])] = 1.0 - s;
  b[std::size_t(f.corner_order[1])] = s * (1.0 - v);
  b[std::size_t(f.corner_order[2])] = s * v;
  if (f.sub < 0) {
    x.ray.triangle = scene.triangle_at(f.face, b[1], b[2], x.ray.origin);
  } else {
    x.ray.triangle = f.face * per_face_ + f.sub;
    const auto& [p, q, r] = scene.triangles()[std::size_t(x.ray.triangle)].corners;
    x.ray.origin = b[0] * p + b[1] * q + b[2] * r;
  }
  x.ray.key = combine(sequence.seed, x.index);
  x.at = scene.locate(x.ray.triangle, x.ray.origin);
  const auto& [p, q, r] = scene.triangles()[std::size_t(x.ray.triangle)].corners;
  const Vec3 normal = (q - p).cross(r - p);
  x.normal = normal.normalized();
  x.area = 0.5 * normal.norm() * (f.sub < 0 ? per_face_ : 1);
  return x;
}

}  // namespace lumo::detail
