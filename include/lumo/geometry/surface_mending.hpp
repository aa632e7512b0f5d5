#pragma once

#include "lumo/geometry/triangle_surface.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <map>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

namespace lumo {

/// What was mended of a surface so that it is closed.
struct SurfaceMending {
  int joined = 0;           ///< corners moved to their twins
  double farthest_m = 0.0;  ///< the longest of those moves [m]
  int dropped = 0;          ///< facets without area
  int split = 0;            ///< edges split at corners that lie on them

  bool any() const { return joined + dropped + split > 0; }
};

/// A side of a triangle, in its direction.
struct TriangleSide {
  int from = 0, to = 0;
  int triangle = 0;
};

/// Sides without a partner, of edges that have no other, in order of their vertex numbers.
inline std::vector<TriangleSide> open_sides(const TriangleSurface& surface) {
  std::vector<TriangleSide> sides, open;
  for (std::size_t i = 0; i < surface.triangles.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k)
      sides.push_back({surface.triangles[i][k], surface.triangles[i][(k + 1) % 3], int(i)});
  const auto edge = [](const TriangleSide& s) { return std::pair(std::min(s.from, s.to), std::max(s.from, s.to)); };
  std::sort(sides.begin(), sides.end(), [&](const TriangleSide& a, const TriangleSide& b) {
    return std::tuple(edge(a), a.triangle) < std::tuple(edge(b), b.triangle);
  });
  for (std::size_t i = 0; i < sides.size();) {
    std::size_t end = i + 1;
    while (end < sides.size() && edge(sides[end]) == edge(sides[i])) ++end;
    if (end - i == 1) open.push_back(sides[i]);
    i = end;
  }
  return open;
}

/// Mends what rounding does to a closed surface: corners that left their twins, facets without area. Nothing moves
/// farther than `precision`, in the surface's unit, but to be joined with a third by twice that. Holes stay.
class SurfaceMender {
 public:
  SurfaceMender(TriangleSurface& surface, double precision) : surface_(surface), precision_(precision) {}

  /// `farthest_m` is in the surface's unit. Vertices that no triangle has are dropped, and not counted.
  SurfaceMending mend() {
    drop_repeated();
    join_twins();
    close_slits();
    drop_slivers();
    drop_unused_vertices(surface_);
    return mending_;
  }

 private:
  using Triangle = std::array<int, 3>;
  using Cell = std::array<std::int64_t, 3>;
  static constexpr double sharpest_fold = 0.999;  // cosine of the 2.6° below which two facets lie on each other

  const Vec3d& at(int vertex) const { return surface_.vertices[std::size_t(vertex)]; }
  Triangle& triangle(int t) { return surface_.triangles[std::size_t(t)]; }
  static bool has(const Triangle& t, int vertex) { return t[0] == vertex || t[1] == vertex || t[2] == vertex; }
  double apart(int a, int b) const { return (at(a) - at(b)).cwiseAbs().maxCoeff(); }
  Cell cell(int vertex) const {
    Cell c;
    for (std::size_t a = 0; a < 3; ++a)
      c[a] = std::int64_t(std::floor(at(vertex)[Eigen::Index(a)] / (2.0 * precision_)));
    return c;
  }

  void drop_repeated();
  void join_twins();
  void close_slits();
  void drop_slivers();

  struct Twins {
    double distance;
    std::size_t one, other;
  };
  std::vector<Twins> twins(const std::vector<TriangleSide>& open) const;
  bool folds(const TriangleSide& one, const TriangleSide& other);
  bool join(int a, int b);
  bool turns_back(int from, int to, int next) const;

  enum class Sliver { none, needle, cap };  // two corners at one place; or one on the edge between the others
  struct Form {
    int a, b, m;  // corners: of the longest edge, and the third
    int nearer;   // of a and b, to m
    Sliver sliver;
  };
  Form form(const Triangle& t) const;
  void flip(int t, const Form& sliver);
  void collapse(int kept, int gone);
  void enter(int t);
  void leave(int t);

  TriangleSurface& surface_;
  double precision_;
  SurfaceMending mending_;
  int caps_ = 0;  // added to fill slits
  Groups places_{0};
  std::vector<std::vector<int>> about_;      // triangles at a vertex, and some that were
  std::map<std::pair<int, int>, int> side_;  // triangle of a side
  std::vector<int> doubtful_;
};

inline void SurfaceMender::drop_repeated() {
  const std::size_t before = surface_.triangles.size();
  std::erase_if(surface_.triangles, [](const Triangle& t) { return t[0] == t[1] || t[1] == t[2] || t[2] == t[0]; });
  mending_.dropped += int(before - surface_.triangles.size());
}

/// Pairs of open sides that run along each other in opposite directions, nearest first.
inline std::vector<SurfaceMender::Twins> SurfaceMender::twins(const std::vector<TriangleSide>& open) const {
  std::map<Cell, std::vector<std::size_t>> begins;
  for (std::size_t i = 0; i < open.size(); ++i) begins[cell(open[i].from)].push_back(i);
  std::vector<Twins> found;
  for (std::size_t i = 0; i < open.size(); ++i) {
    const Cell middle = cell(open[i].to);
    for (int n = 0; n < 27; ++n) {
      const auto there = begins.find({middle[0] + n % 3 - 1, middle[1] + n / 3 % 3 - 1, middle[2] + n / 9 - 1});
      if (there == begins.end()) continue;
      for (const std::size_t j : there->second) {
        const double distance = std::max(apart(open[i].to, open[j].from), apart(open[i].from, open[j].to));
        if (i < j && distance <= precision_) found.push_back({distance, i, j});
      }
    }
  }
  std::sort(found.begin(), found.end(), [](const Twins& a, const Twins& b) {
    return std::tie(a.distance, a.one, a.other) < std::tie(b.distance, b.one, b.other);
  });
  return found;
}

/// Do the facets of two sides lie on each other, as the two sides of a thin wall do where its rim is missing?
inline bool SurfaceMender::folds(const TriangleSide& one, const TriangleSide& other) {
  const auto across = [&](const TriangleSide& s) {
    const Triangle& t = triangle(s.triangle);
    const int apex = t[0] + t[1] + t[2] - s.from - s.to;
    const Vec3d along = (at(one.to) - at(one.from)).normalized(), way = at(apex) - at(s.from);
    return Vec3d(way - way.dot(along) * along);
  };
  const Vec3d u = across(one), v = across(other);
  if (!(u.norm() > 4.0 * precision_) || !(v.norm() > 4.0 * precision_)) return false;
  return u.dot(v) > sharpest_fold * u.norm() * v.norm();
}

/// Two places become one, unless an edge would vanish.
inline bool SurfaceMender::join(int a, int b) {
  const int p = places_.find(std::min(a, b)), q = places_.find(std::max(a, b)), kept = std::min(p, q),
            gone = std::max(p, q);
  if (p == q) return true;
  if (apart(p, q) > 2.0 * precision_) return false;
  for (const int t : about_[std::size_t(gone)])
    for (const int v : triangle(t))
      if (places_.find(v) == kept) return false;
  places_.join(gone, kept);
  auto& all = about_[std::size_t(kept)];
  all.insert(all.end(), about_[std::size_t(gone)].begin(), about_[std::size_t(gone)].end());
  return true;
}

/// Corners are joined only where open sides meet by it: what is closed is not touched.
inline void SurfaceMender::join_twins() {
  if (!(precision_ > 0.0)) return;
  const std::vector<TriangleSide> open = open_sides(surface_);
  if (open.empty()) return;
  places_ = Groups(surface_.vertices.size());
  about_.assign(surface_.vertices.size(), {});
  for (std::size_t t = 0; t < surface_.triangles.size(); ++t)
    for (const int v : surface_.triangles[t]) about_[std::size_t(v)].push_back(int(t));
  std::vector<char> met(open.size(), 0);
  for (const Twins& pair : twins(open)) {
    const TriangleSide &one = open[pair.one], &other = open[pair.other];
    if (met[pair.one] || met[pair.other] || folds(one, other)) continue;
    met[pair.one] = met[pair.other] = join(one.from, other.to) && join(one.to, other.from);
  }
  for (int v = 0; v < int(surface_.vertices.size()); ++v) {
    const int place = places_.find(v);
    if (place == v) continue;
    ++mending_.joined;
    mending_.farthest_m = std::max(mending_.farthest_m, (at(v) - at(place)).norm());
  }
  for (Triangle& t : surface_.triangles)
    for (int& v : t) v = places_.find(v);
}

/// Does an open side turn back on itself at `to`, and run on to `next`, no wider than rounding?
inline bool SurfaceMender::turns_back(int from, int to, int next) const {
  Vec3d way = at(from) - at(to), other = at(next) - at(to);
  if (other.squaredNorm() > way.squaredNorm()) std::swap(way, other);
  const double t = other.dot(way) / way.squaredNorm();
  return t > 0.0 && t < 1.0 && (other - t * way).norm() <= precision_;
}

/// A slit without width, whose two sides have corners of their own: facets of no width are added from its ends on, and
/// go with the slivers, which splits the edges on both sides.
inline void SurfaceMender::close_slits() {
  std::set<std::pair<int, int>> open;
  for (const TriangleSide& s : open_sides(surface_)) open.emplace(s.from, s.to);
  const std::vector<std::pair<int, int>> all(open.begin(), open.end());
  for (std::pair<int, int> side : all)
    while (open.contains(side)) {
      const int from = side.first, to = side.second;
      auto next = open.lower_bound({to, -1});
      while (next != open.end() && next->first == to && !turns_back(from, to, next->second)) ++next;
      if (next == open.end() || next->first != to) break;
      const int end = next->second;
      surface_.triangles.push_back({to, from, end});
      ++caps_;
      open.erase(next);
      open.erase(side);
      side = {from, end};
      if (open.erase({end, from}) == 0) open.insert(side);
    }
  mending_.split = caps_;
}

inline void SurfaceMender::enter(int t) {
  for (std::size_t k = 0; k < 3; ++k) {
    side_[{triangle(t)[k], triangle(t)[(k + 1) % 3]}] = t;
    about_[std::size_t(triangle(t)[k])].push_back(t);
  }
}
inline void SurfaceMender::leave(int t) {
  for (std::size_t k = 0; k < 3; ++k) side_.erase({triangle(t)[k], triangle(t)[(k + 1) % 3]});
}

inline void SurfaceMender::drop_slivers() {
  // First whether there are any: most files have none, and need no tables.
  for (std::size_t t = 0; t < surface_.triangles.size(); ++t)
    if (form(surface_.triangles[t]).sliver != Sliver::none) doubtful_.push_back(int(t));
  if (doubtful_.empty()) return;
  mending_.dropped += int(doubtful_.size()) - caps_;
  about_.assign(surface_.vertices.size(), {});
  for (std::size_t t = 0; t < surface_.triangles.size(); ++t) enter(int(t));
  for (std::size_t tries = 100 + 20 * doubtful_.size(); !doubtful_.empty() && tries > 0; --tries) {
    const int t = doubtful_.back();
    doubtful_.pop_back();
    if (triangle(t)[0] < 0) continue;
    const Form f = form(triangle(t));
    if (f.sliver == Sliver::cap) flip(t, f);
    if (f.sliver == Sliver::needle) collapse(std::min(f.m, f.nearer), std::max(f.m, f.nearer));
  }
  std::erase_if(surface_.triangles, [](const Triangle& t) { return t[0] < 0; });
}

inline SurfaceMender::Form SurfaceMender::form(const Triangle& t) const {
  const auto length = [&](std::size_t k) { return (at(t[k]) - at(t[(k + 1) % 3])).norm(); };
  std::size_t longest = 0;
  for (std::size_t k = 1; k < 3; ++k)
    if (length(k) > length(longest)) longest = k;
  Form f{t[longest], t[(longest + 1) % 3], t[(longest + 2) % 3], 0, Sliver::none};
  const double edge = length(longest), width = (at(f.b) - at(f.a)).cross(at(f.m) - at(f.a)).norm() / edge,
               least = 2.02 * detail::flatness * edge;
  f.nearer = length((longest + 1) % 3) < length((longest + 2) % 3) ? f.b : f.a;
  if ((at(f.m) - at(f.nearer)).norm() > precision_)
    f.sliver = width > std::max(precision_, least) ? f.sliver : Sliver::cap;
  else if (width <= least) f.sliver = Sliver::needle;
  return f;
}

/// The sliver's long edge ab becomes one between its third corner m and the neighbour's, c.
inline void SurfaceMender::flip(int t, const Form& sliver) {
  const int a = sliver.a, b = sliver.b, m = sliver.m;
  const auto there = side_.find({b, a});
  if (there == side_.end()) return;
  const int n = there->second, c = triangle(n)[0] + triangle(n)[1] + triangle(n)[2] - a - b;
  if (c == m || side_.contains({m, c}) || side_.contains({c, m})) return;
  leave(t);
  leave(n);
  triangle(t) = {m, a, c};
  triangle(n) = {m, c, b};
  for (const int changed : {t, n}) {
    enter(changed);
    doubtful_.push_back(changed);
  }
}

/// One corner takes the other's place, and the two facets at the edge between them go, if that pinches nothing.
inline void SurfaceMender::collapse(int kept, int gone) {
  const auto around = [&](int vertex) {
    std::vector<int> now = about_[std::size_t(vertex)];
    std::sort(now.begin(), now.end());
    now.erase(std::unique(now.begin(), now.end()), now.end());
    std::erase_if(now, [&](int t) { return !has(triangle(t), vertex); });
    return now;
  };
  const auto neighbours = [&](const std::vector<int>& triangles) {
    std::vector<int> all;
    for (const int t : triangles) all.insert(all.end(), triangle(t).begin(), triangle(t).end());
    std::sort(all.begin(), all.end());
    all.erase(std::unique(all.begin(), all.end()), all.end());
    return all;
  };
  const std::vector<int> moved = around(gone), here = neighbours(around(kept)), there = neighbours(moved);
  std::vector<int> common;
  std::set_intersection(here.begin(), here.end(), there.begin(), there.end(), std::back_inserter(common));
  if (common.size() != 4) return;  // the two themselves, and one on each side of the edge
  for (const int t : moved) leave(t);
  for (const int t : moved) {
    if (has(triangle(t), kept)) {
      triangle(t) = {-1, -1, -1};
      continue;
    }
    std::replace(triangle(t).begin(), triangle(t).end(), gone, kept);
    enter(t);
    doubtful_.push_back(t);
  }
}

}  // namespace lumo
