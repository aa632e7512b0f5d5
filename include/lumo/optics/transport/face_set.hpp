#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/sobol.hpp"
#include "lumo/core/types.hpp"
#include "lumo/optics/optical_scene.hpp"
#include "lumo/optics/surface_optics.hpp"
#include "lumo/optics/transport/ray_pattern.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <vector>

namespace lumo {

/// A place to about a nanometre, for look-ups.
using PlaceKey = std::array<long long, 3>;

// The odd unit keeps round coordinates off the borders of its cells.
inline PlaceKey place_key(const Vec3d& p) {
  constexpr double unit = 1.0471975512e-9;
  return {std::llround(p.x() / unit), std::llround(p.y() / unit), std::llround(p.z() / unit)};
}

/// The mirror image of `p` with x ≥ 0 and y ≥ 0, as far as there is `symmetry`.
inline Vec3d folded(Vec3d p, Symmetry symmetry) {
  if (symmetry.x) p.x() = std::abs(p.x());
  if (symmetry.y) p.y() = std::abs(p.y());
  return p;
}

/// Some faces of the body, or triangles of the scene, each with a block of a low-discrepancy sequence as large as its
/// area asks for: points and directions on it that do not depend on the state, and are mirror images on faces that are
/// mirror images. Mirror images in a plane of `symmetry` are one face.
class FaceSet {
 public:
  struct Face {
    int face;                         ///< of the body; −1: a single triangle
    int triangle;                     ///< of the scene
    Vec3d mirror;                     ///< (±1, ±1, 1): from the image with x ≥ 0, y ≥ 0 to this face
    std::array<int, 3> corner_order;  ///< corners in an order that mirror images share
    std::uint32_t first = 0;          ///< place in the sequence of rays; the same for mirror images
    std::uint32_t count = 0;          ///< samples of this face, a power of two
  };

  /// How samples are spread over the faces.
  struct Sampling {
    bool whole = false;       ///< only faces of the body, each asked for with its first triangle; else all triangles
    double total = 0.0;       ///< about so many samples in all, counting mirror images that are not traced
    std::uint32_t least = 1;  ///< on each face
    RayFocus focus = {};      ///< more of them are here; must have the symmetry
    std::vector<double> density = {};  ///< per triangle, of samples, on average 1; empty: even
  };
  /// `wanted(triangle)` says which belong to the set.
  template <class Predicate>
  FaceSet(const OpticalScene& scene, Symmetry symmetry, const Sampling& sampling, Predicate&& wanted)
      : per_face_(scene.triangles_per_face()), member_(scene.face_count(), 0) {
    std::map<PlaceKey, int> known;  // folded by the symmetry → index
    // With x ≥ 0, and y ≥ 0 where mirror images have equally many samples; else y from the focus' side on, so that the
    // samples about mirrored foci are mirror images.
    std::vector<Vec3d> centers;
    std::vector<double> shares;  // undeformed area [m²] × density
    std::vector<int> images;     // faces folded onto each
    std::vector<bool> in_plane;
    const auto include = [&](int f, int triangle, const std::array<Vec3d, 3>& corner) {
      const Vec3d center = (corner[0] + corner[1] + corner[2]) / 3.0;
      Vec3d mirror = Vec3d::Ones();
      for (Eigen::Index a = 0; a < 2; ++a)
        if (center[a] < -1e-9) mirror[a] = -1.0;
      const bool fundamental = !(symmetry.x && mirror.x() < 0.0) && !(symmetry.y && mirror.y() < 0.0);
      Face face{f, triangle, mirror, {0, 1, 2}};
      std::sort(face.corner_order.begin(), face.corner_order.end(), [&](int a, int b) {
        return place_key(mirror.cwiseProduct(corner[std::size_t(a)])) <
               place_key(mirror.cwiseProduct(corner[std::size_t(b)]));
      });
      const auto [it, fresh] = known.try_emplace(place_key(folded(center, symmetry)), int(faces_.size()));
      const std::size_t k = std::size_t(it->second);
      if (fresh) {
        faces_.push_back(face);
        centers.push_back(folded(center, {true, sampling.focus.is_symmetric()}));
        if (sampling.focus.y_m < 0.0 && !sampling.focus.is_symmetric()) centers.back().y() *= -1.0;
        const double density = sampling.density.empty() ? 1.0 : sampling.density[std::size_t(triangle)];
        shares.push_back(0.5 * (corner[1] - corner[0]).cross(corner[2] - corner[0]).norm() *
                         sampling.focus.density(center.y()) * density);
        images.push_back(0);
        in_plane.push_back(std::abs(center.x()) < 1e-9 || std::abs(center.y()) < 1e-9);
      } else if (fundamental) {
        faces_[k] = face;
      }
      ++images[k];
    };
    for (int f = 0; sampling.whole && f < int(scene.face_count()); ++f)
      if (wanted(f * per_face_)) {
        include(f, -1, scene.reference_corners(f, -1));
        member_[std::size_t(f)] = 1;
      }
    for (int t = 0; !sampling.whole && t < int(scene.triangles().size()); ++t)
      if (wanted(t)) include(-1, t, scene.reference_corners(t));
    const int expected = (symmetry.x ? 2 : 1) * (symmetry.y ? 2 : 1);
    for (std::size_t k = 0; k < faces_.size(); ++k)
      if (images[k] != expected && !in_plane[k])
        throw InvalidArgument("optical scene: a symmetric state is claimed, but the surface mesh is not symmetric");
    number(centers, shares, images, sampling);
  }

  std::size_t size() const { return faces_.size(); }
  const Face& operator[](std::size_t k) const { return faces_[k]; }
  /// Does a point on the body lie on one of the faces?
  bool has(const ScenePoint& p) const { return p.face >= 0 && member_[std::size_t(p.face)]; }

  /// A point on a face.
  struct Sample {
    ScenePoint at;
    PrimaryRay ray;           ///< starts there; its direction is left open
    Vec3d normal;             ///< unit outward normal of the flat triangle
    double area = 0.0;        ///< that it stands for [m²]
    std::uint32_t index = 0;  ///< in the sequence
  };
  /// Sample `i` of face `k`. Takes dimensions 2 and 3 of the sequence; 0 and 1 are for its direction.
  Sample sample(std::size_t k, const OpticalScene& scene, const OwenSobol& sequence, std::uint32_t i) const {
    const Face& f = faces_[k];
    Sample x;
    x.index = f.first + i;
    const double s = std::sqrt(sequence(x.index, 2)), v = sequence(x.index, 3);
    std::array<double, 3> b{};
    b[std::size_t(f.corner_order[0])] = 1.0 - s;
    b[std::size_t(f.corner_order[1])] = s * (1.0 - v);
    b[std::size_t(f.corner_order[2])] = s * v;
    if (f.face >= 0) {
      x.ray.triangle = scene.triangle_at(f.face, b[1], b[2], x.ray.origin);
    } else {
      x.ray.triangle = f.triangle;
      const std::array<Vec3d, 3>& corners = scene.triangles()[std::size_t(x.ray.triangle)].corners;
      const auto& [p, q, r] = corners;
      x.ray.origin = b[0] * p + b[1] * q + b[2] * r;
    }
    x.ray.key = combine(sequence.seed, x.index);
    x.at = scene.locate(x.ray.triangle, x.ray.origin);
    const std::array<Vec3d, 3>& corners = scene.triangles()[std::size_t(x.ray.triangle)].corners;
    const auto& [p, q, r] = corners;
    const Vec3d normal = (q - p).cross(r - p);
    x.normal = normal.normalized();
    x.area = 0.5 * normal.norm() * (f.face >= 0 ? per_face_ : 1) / f.count;
    return x;
  }

 private:
  // Place along Morton's curve, 10 bits an axis; cells do not line up with regular grids.
  static std::uint64_t morton(const Vec3d& p) {
    std::uint64_t code = 0;
    for (int bit = 9; bit >= 0; --bit)
      for (Eigen::Index a = 0; a < 3; ++a)
        code = (code << 1) | ((std::uint64_t(std::clamp(p[a], 0.0, 1.0) * 1013.37 + 0.318) >> bit) & 1u);
    return code;
  }
  // Neighbours take neighbouring blocks of the sequence: together they are stratified more finely than each alone.
  void number(const std::vector<Vec3d>& centers, const std::vector<double>& shares, const std::vector<int>& images,
      const Sampling& sampling) {
    struct Block {
      std::uint64_t code = 0;
      std::uint32_t first = 0, count = 0;
    };
    Vec3d low = Vec3d::Constant(std::numeric_limits<double>::infinity()), high = -low;
    double all = 0.0;
    for (std::size_t k = 0; k < faces_.size(); ++k) {
      low = elementwise_min(low, centers[k]);
      high = elementwise_max(high, centers[k]);
      all += shares[k] * images[k];
    }
    const double scale = faces_.empty() ? 1.0 : 1.0 / std::max(1e-12, (high - low).maxCoeff());
    std::map<PlaceKey, Block>
        blocks;  // what is found for one of two mirror images serves both: rounding could part them
    for (std::size_t k = 0; k < faces_.size(); ++k) {
      const std::uint32_t count = std::max(sampling.least, nearest_power_of_two(sampling.total * shares[k] / all));
      blocks.try_emplace(place_key(centers[k]), Block{morton(scale * (centers[k] - low)), 0, count});
    }
    std::map<std::pair<std::uint64_t, PlaceKey>, Block*> order;
    for (auto& [place, block] : blocks) order[{block.code, place}] = &block;
    std::uint32_t next = 0;
    for (auto& [place, block] : order) {  // blocks of 2^m numbers start at multiples of 2^m: each is a net
      block->first = (next + block->count - 1) / block->count * block->count;
      next = block->first + block->count;
    }
    for (std::size_t k = 0; k < faces_.size(); ++k) {
      const Block& block = blocks[place_key(centers[k])];
      faces_[k].first = block.first;
      faces_[k].count = block.count;
    }
  }

  int per_face_;  ///< sub-facets of a face
  std::vector<Face> faces_;
  std::vector<char> member_;  ///< per face of the body
};

}  // namespace lumo
