#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/optics/intersector.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <vector>

namespace lumo {

/// Ray scene on a tree of boxes, four children a node: triangles in double precision, boxes in float, rounded outwards.
class BvhScene {
 public:
  /// Throws InvalidArgument for a corner that is not finite.
  BvhScene(const std::vector<SceneTriangle>& triangles, int leaf_size) : leaf_size_(std::max(1, leaf_size)) {
    Box all;
    for (const SceneTriangle& t : triangles)
      for (const Vec3d& p : t.corners) {
        if (!p.allFinite()) throw InvalidArgument("optical scene: a corner is not finite");
        all.extend(p);
      }
    if (triangles.empty()) return;
    center_ = all.center();
    const double extent = all.diagonal().norm(), pad = box_margin * extent;
    slack_ = behind * extent;
    for (const SceneTriangle& t : triangles) {
      Box box;
      for (const Vec3d& p : t.corners) box.extend(Vec3d(p - center_));
      boxes_.emplace_back(Vec3d(box.min().array() - pad), Vec3d(box.max().array() + pad));
    }
    order_.resize(triangles.size());
    std::iota(order_.begin(), order_.end(), 0);
    build(bounds(0, int(triangles.size())));
    for (int i : order_) {
      const auto& [a, b, c] = triangles[std::size_t(i)].corners;
      triangles_.push_back({a - center_, b - a, c - a, i, triangles[std::size_t(i)].in_air_only});
    }
    boxes_ = {};
    order_ = {};
  }

  /// First triangle on the ray from `origin` [m] along the unit vector `direction`; `inside`: the ray runs in the body.
  RayHit first_hit(const Vec3d& origin, const Vec3d& direction, bool inside) const {
    RayHit best;
    if (nodes_.empty()) return best;
    const Vec3d o = origin - center_;
    std::array<float, 3> of, inverse;
    for (std::size_t a = 0; a < 3; ++a) {
      const double d = direction[Eigen::Index(a)];
      of[a] = float(o[Eigen::Index(a)]);
      inverse[a] = float(1.0 / (std::abs(d) < parallel ? std::copysign(parallel, d) : d));
    }
    struct Todo {
      int child, count;
      float t;
    };
    std::array<Todo, 256> stack;  // three a level at most; trees stay far below 80 levels
    std::size_t top = 0;
    stack[top++] = {0, 0, 0.0f};
    while (top > 0) {
      const Todo now = stack[--top];
      if (double(now.t) > best.t) continue;
      for (int i = now.child; i < now.child + now.count; ++i) {
        const Triangle& t = triangles_[std::size_t(i)];
        const Vec3d p = direction.cross(t.edge2);
        const double det = t.edge1.dot(p);  // > 0: against the normal, so from outside
        if (inside ? t.in_air_only || !(det < 0.0) : !(det > 0.0)) continue;
        const double f = 1.0 / det;
        const Vec3d s = o - t.corner;
        const double u = f * s.dot(p);
        if (!(u >= -edge && u <= 1.0 + edge)) continue;
        const Vec3d q = s.cross(t.edge1);
        const double v = f * direction.dot(q);
        if (!(v >= -edge && u + v <= 1.0 + edge)) continue;
        const double d = f * t.edge2.dot(q);
        if (d >= -slack_ && d < best.t) best = {d, t.id};
      }
      if (now.count > 0) continue;
      const Node& node = nodes_[std::size_t(now.child)];
      Eigen::Array4f enter = Eigen::Array4f::Zero(), leave = Eigen::Array4f::Constant(float(best.t));
      for (std::size_t a = 0; a < 3; ++a) {
        const Eigen::Array4f &near = inverse[a] < 0.0f ? node.high[a] : node.low[a],
                             &far = inverse[a] < 0.0f ? node.low[a] : node.high[a];
        enter = enter.max((near - of[a]) * inverse[a]);
        leave = leave.min((far - of[a]) * inverse[a]);
      }
      const std::size_t base = top;
      for (std::size_t k = 0; k < 4; ++k) {
        if (node.count[k] < 0 || !(enter[Eigen::Index(k)] <= leave[Eigen::Index(k)] * rounding) || top == stack.size())
          continue;
        std::size_t at = top++;  // keep the nearest on top
        for (; at > base && stack[at - 1].t < enter[Eigen::Index(k)]; --at) stack[at] = stack[at - 1];
        stack[at] = {node.child[k], node.count[k], enter[Eigen::Index(k)]};
      }
    }
    return best;
  }

 private:
  // Shares of the scene's diagonal: by how much boxes exceed their triangles, which covers float's rounding, and how
  // far behind its origin a ray still hits, which covers double's.
  static constexpr double box_margin = 1e-6, behind = 1e-11;
  static constexpr double parallel = 1e-12;     ///< components of a direction below it count as this
  static constexpr double edge = 1e-10;         ///< of barycentric coordinates: neighbours leave no gap between them
  static constexpr float rounding = 1.000001f;  ///< of the float that leaves a box: some units in the last place
  static constexpr std::size_t bins = 16;       ///< of the surface-area heuristic
  using Box = Eigen::AlignedBox<double, 3>;
  struct Triangle {
    Vec3d corner, edge1, edge2;
    int id;
    bool in_air_only;
  };
  struct Node {
    std::array<Eigen::Array4f, 3> low, high;
    std::array<int, 4> child{};  ///< node, or first triangle of a leaf
    std::array<int, 4> count{};  ///< triangles of a leaf, 0 for a node, −1 if unused
  };
  struct Range {
    int first, last;
    Box box;
  };

  Range bounds(int first, int last) const {
    Range r{first, last, {}};
    for (int i = first; i < last; ++i) r.box.extend(boxes_[std::size_t(order_[std::size_t(i)])]);
    return r;
  }
  // Cuts the range where the expected cost of a ray is least; false if it is small, or cannot be cut.
  bool split(const Range& range, std::array<Range, 2>& halves) {
    const int n = range.last - range.first;
    if (n <= leaf_size_) return false;
    Box centers;
    for (int i = range.first; i < range.last; ++i) centers.extend(boxes_[std::size_t(order_[std::size_t(i)])].center());
    int axis = 0;
    const double width = centers.diagonal().maxCoeff(&axis);
    if (!(width > 0.0)) return false;
    const auto bin = [&](int i) {
      const double x = (boxes_[std::size_t(i)].center()[axis] - centers.min()[axis]) / width;
      return std::min(bins - 1, std::size_t(x * double(bins)));
    };
    const auto area = [](const Box& b) {
      const Vec3d d = b.diagonal();
      return d.x() * d.y() + d.y() * d.z() + d.z() * d.x();
    };
    std::array<Box, bins> box;
    std::array<int, bins> count{};
    for (int i = range.first; i < range.last; ++i) {
      const int id = order_[std::size_t(i)];
      box[bin(id)].extend(boxes_[std::size_t(id)]);
      ++count[bin(id)];
    }
    std::array<double, bins> right{};
    Box sweep;
    for (std::size_t b = bins; b-- > 1;) {
      sweep.extend(box[b]);
      right[b] = sweep.isEmpty() ? 0.0 : area(sweep);
    }
    sweep.setEmpty();
    double best = std::numeric_limits<double>::infinity();
    std::size_t cut = 0;
    for (std::size_t b = 1, below = 0; b < bins; ++b) {
      sweep.extend(box[b - 1]);
      below += std::size_t(count[b - 1]);
      if (below == 0 || below == std::size_t(n)) continue;
      const double cost = area(sweep) * double(below) + right[b] * double(std::size_t(n) - below);
      if (cost < best) {
        best = cost;
        cut = b;
      }
    }
    const auto begin = order_.begin();
    const auto middle = std::partition(begin + range.first, begin + range.last, [&](int id) { return bin(id) < cut; });
    halves = {bounds(range.first, int(middle - begin)), bounds(int(middle - begin), range.last)};
    return true;
  }
  int build(const Range& range) {
    std::vector<Range> parts{range};
    for (std::size_t tried = 0; parts.size() < 4 && tried < parts.size();) {
      std::sort(parts.begin(), parts.end(),
          [](const Range& a, const Range& b) { return a.last - a.first > b.last - b.first; });
      std::array<Range, 2> halves;
      if (!split(parts[tried], halves)) {
        ++tried;
        continue;
      }
      parts[tried] = halves[0];
      parts.push_back(halves[1]);
      tried = 0;
    }
    const std::size_t me = nodes_.size();
    nodes_.emplace_back();
    for (std::size_t k = 0; k < 4; ++k) {
      for (std::size_t a = 0; a < 3; ++a) {
        const bool used = k < parts.size();
        nodes_[me].low[a][Eigen::Index(k)] =
            used ? float(parts[k].box.min()[Eigen::Index(a)]) : std::numeric_limits<float>::infinity();
        nodes_[me].high[a][Eigen::Index(k)] =
            used ? float(parts[k].box.max()[Eigen::Index(a)]) : -std::numeric_limits<float>::infinity();
      }
      if (k >= parts.size()) {
        nodes_[me].count[k] = -1;
        continue;
      }
      const bool leaf = parts.size() == 1 || parts[k].last - parts[k].first <= leaf_size_;
      nodes_[me].count[k] = leaf ? parts[k].last - parts[k].first : 0;
      const int child = leaf ? parts[k].first : build(parts[k]);
      nodes_[me].child[k] = child;
    }
    return int(me);
  }

  std::vector<Triangle> triangles_;
  std::vector<Node> nodes_;
  std::vector<Box> boxes_;        ///< per input triangle, while building
  std::vector<int> order_;        ///< likewise
  Vec3d center_ = Vec3d::Zero();  ///< corners are stored relative to it
  double slack_ = 0.0;            ///< rays may start this far behind a face [m]
  int leaf_size_;
};

/// The library's own Intersector; needs Eigen only. Law: independent of the place of the scene (it is centred).
/// Source: binned surface area heuristic, Wald 2007; ray–triangle test, Möller & Trumbore 1997.
struct Bvh {
  struct Config {
    int leaf_size = 4;  ///< triangles up to which a range is not split
  };
  Config config{};

  BvhScene build(const std::vector<SceneTriangle>& triangles) const { return {triangles, config.leaf_size}; }
};

static_assert(RayScene<BvhScene> && Intersector<Bvh>);

}  // namespace lumo
