#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/body.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace lumo {

/// A corner of a flat profile, and the patch of the edge from it to the next corner (of the last one: to the first).
struct ProfileCorner {
  double across_m = 0.0;  ///< x, or the distance from the axis
  double z_m = 0.0;
  int patch = Body::mirror_patch;  ///< index into Body::patches
};

/// Corners on the arc of `radius_m` about (across_m, z_m) of `about`, from one angle to another, both ends included;
/// angles are from x to z. All edges of the arc and the one after it are of the patch of `about`.
inline std::vector<ProfileCorner> arc_profile(
    const ProfileCorner& about, double radius_m, double from_rad, double to_rad, int edges);

/// Where a section ends along y, and the patches there; at y = 0 of a body that is symmetric in y: mirror_patch.
struct SectionEnds {
  double low_m = 0.0, high_m = 0.0;
  int low_patch = Body::mirror_patch, high_patch = Body::mirror_patch;
};

/// Adds to the body the closed boundary of what a section in (x, z), swept along y, fills. The section is a simple
/// polygon, counter-clockwise with x to the right and z up. One facet for each edge, and one for each end, as
/// SweptMesher wants it. Throws InvalidArgument for a section that is none, and for patches that the body does not
/// have.
inline void add_extruded(Body& body, const std::vector<ProfileCorner>& section, const SectionEnds& ends);

/// Adds to the body the closed boundary of what a profile in (distance from the z axis, z), turned about that axis,
/// fills; of the sector that Body::symmetry leaves. Counter-clockwise with the distance to the right and z up: either
/// from the axis to the axis (the patch of the last corner means nothing), or, for a ring, clear of it. Each edge
/// becomes `edges_per_quarter` flat facets a quarter turn; one that is level and starts or ends on the axis becomes one
/// facet. Vertices lie on the surfaces of revolution, and exactly in the planes of symmetry. Throws InvalidArgument as
/// above.
inline void add_revolved(Body& body, const std::vector<ProfileCorner>& profile, int edges_per_quarter = 8);

namespace detail {

inline void require_profile(const Body& body, const std::vector<ProfileCorner>& corners) {
  if (corners.size() < 3)
    throw InvalidArgument(message("profile: ", corners.size(), " corners, at least 3 are needed"));
  double area = 0.0;
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const ProfileCorner &a = corners[k], &b = corners[(k + 1) % corners.size()];
    if (!std::isfinite(a.across_m) || !std::isfinite(a.z_m))
      throw InvalidArgument(message("profile: corner ", k, " is not finite"));
    if (a.patch != Body::mirror_patch && (a.patch < 0 || std::size_t(a.patch) >= body.patches.size()))
      throw InvalidArgument(message("profile: corner ", k, " names patch ", a.patch, ", the body has patches 0 to ",
          int(body.patches.size()) - 1));
    area += 0.5 * (a.across_m * b.z_m - b.across_m * a.z_m);
  }
  if (!(area > 0.0))
    throw InvalidArgument(message("profile: its area is ", area * 1e6,
        " mm2, must be > 0 mm2: corners run counter-clockwise, with x or the distance to the right and z up"));
}

inline int add_vertex(Body& body, const Vec3d& at) {
  body.vertices.push_back(at);
  return int(body.vertices.size()) - 1;
}

// Directions about the z axis of the sector that a symmetry leaves, from its first plane to its last; exact where they
// lie in a plane.
inline std::vector<std::array<double, 2>> sector_directions(Symmetry symmetry, int per_quarter) {
  const int first = symmetry.x && !symmetry.y ? -1 : 0;  // quarter turn at which the sector starts
  const int quarters = symmetry.x && symmetry.y ? 1 : symmetry.x || symmetry.y ? 2 : 4;
  std::vector<std::array<double, 2>> directions;
  for (int i = 0; i <= quarters * per_quarter; ++i) {
    const int quarter = first + i / per_quarter, part = i % per_quarter;
    const double angle = 0.5 * pi * part / per_quarter, c = part == 0 ? 1.0 : std::cos(angle),
                 s = part == 0 ? 0.0 : std::sin(angle);
    const std::array<std::array<double, 2>, 4> turned{{{c, s}, {-s, c}, {-c, -s}, {s, -c}}};
    directions.push_back(turned[std::size_t(quarter + 4) % 4]);
  }
  if (quarters == 4) directions.pop_back();
  return directions;
}

// The boundary of a solid of revolution.
class Revolution {
 public:
  Revolution(Body& body, const std::vector<ProfileCorner>& profile, int per_quarter)
      : body_(body), profile_(profile), directions_(sector_directions(body.symmetry, per_quarter)) {
    closed_ = !body.symmetry.x && !body.symmetry.y;
    double largest = 0.0;
    for (const ProfileCorner& c : profile) largest = std::max(largest, c.across_m);
    for (const ProfileCorner& c : profile) on_axis_.push_back(std::abs(c.across_m) <= 1e-12 * largest);
    require_axis();
    for (std::size_t k = 0; k < profile.size(); ++k) {
      std::vector<int> ring;
      for (const auto& [x, y] : directions_) {
        if (!on_axis_[k]) ring.push_back(add_vertex(body, Vec3d(x * at(k), y * at(k), profile[k].z_m)));
        else if (ring.empty() && !(closed_ && ends_disc(k)))
          ring.push_back(add_vertex(body, Vec3d(0.0, 0.0, profile[k].z_m)));
      }
      rings_.push_back(std::move(ring));
    }
  }

  void add() {
    const std::size_t edges = profile_.size() - (on_axis_[0] ? 1 : 0);
    for (std::size_t k = 0; k < edges; ++k) {
      const std::size_t next = (k + 1) % profile_.size();
      if (is_disc(k, next)) add_disc(k, next);
      else add_band(k, next);
    }
    if (closed_) return;
    std::vector<int> start, end;  // the profile in both planes of the sector
    for (const std::vector<int>& ring : rings_) {
      start.push_back(ring.front());
      end.insert(end.begin(), ring.back());
    }
    body_.facets.push_back({start, Body::mirror_patch});
    body_.facets.push_back({end, Body::mirror_patch});
  }

 private:
  double at(std::size_t k) const { return profile_[k].across_m; }
  bool is_disc(std::size_t k, std::size_t next) const {
    return (on_axis_[k] || on_axis_[next]) && profile_[k].z_m == profile_[next].z_m;
  }
  // The middle of a whole disc is no vertex: no facet would have it.
  bool ends_disc(std::size_t k) const { return k == 0 ? is_disc(0, 1) : is_disc(k - 1, k); }
  void require_axis() const {
    const std::size_t last = profile_.size() - 1;
    for (std::size_t k = 0; k <= last; ++k) {
      if (!on_axis_[k] && !(at(k) > 0.0))
        throw InvalidArgument(
            message("profile: corner ", k, " is ", at(k) * 1e3, " mm from the axis, must be >= 0 mm"));
      const bool end = k == 0 || k == last;
      if (on_axis_[k] != (end && on_axis_[0]))
        throw InvalidArgument(message("profile: corner ", k, " lies ", on_axis_[k] ? "on" : "off",
            " the axis; the first and the last do, or none"));
    }
    for (std::size_t k = 0; k <= last; ++k)
      if (profile_[k].patch == Body::mirror_patch && !(k == last && on_axis_[0]))
        throw InvalidArgument(message("profile: corner ", k, " names no patch of the body"));
  }
  int vertex(std::size_t k, std::size_t direction) const {
    return on_axis_[k] ? rings_[k][0] : rings_[k][direction % directions_.size()];
  }
  void add_band(std::size_t k, std::size_t next) {
    const std::size_t steps = directions_.size() - (closed_ ? 0 : 1);
    for (std::size_t i = 0; i < steps; ++i) {
      std::vector<int> loop{vertex(k, i)};
      if (!on_axis_[k]) loop.push_back(vertex(k, i + 1));
      if (!on_axis_[next]) loop.push_back(vertex(next, i + 1));
      loop.push_back(vertex(next, i));
      body_.facets.push_back({loop, profile_[k].patch});
    }
  }
  void add_disc(std::size_t k, std::size_t next) {
    std::vector<int> loop = rings_[on_axis_[k] ? next : k];
    if (on_axis_[k]) std::reverse(loop.begin(), loop.end());
    if (!closed_) loop.push_back(rings_[on_axis_[k] ? k : next][0]);
    body_.facets.push_back({loop, profile_[k].patch});
  }

  Body& body_;
  const std::vector<ProfileCorner>& profile_;
  std::vector<std::array<double, 2>> directions_;
  bool closed_ = false;  ///< all the way round
  std::vector<bool> on_axis_;
  std::vector<std::vector<int>> rings_;  ///< vertices of each corner, one for each direction; on the axis one
};

}  // namespace detail

inline std::vector<ProfileCorner> arc_profile(
    const ProfileCorner& about, double radius_m, double from_rad, double to_rad, int edges) {
  require_in_range("edges of an arc", edges, 1, 10000, "");
  require_positive("radius of an arc", radius_m, "m");
  std::vector<ProfileCorner> corners;
  for (int i = 0; i <= edges; ++i) {
    const double angle = (from_rad * (edges - i) + to_rad * i) / edges;
    corners.push_back(
        {about.across_m + radius_m * std::cos(angle), about.z_m + radius_m * std::sin(angle), about.patch});
  }
  return corners;
}

inline void add_extruded(Body& body, const std::vector<ProfileCorner>& section, const SectionEnds& ends) {
  detail::require_profile(body, section);
  if (!(ends.low_m < ends.high_m))
    throw InvalidArgument(
        message("section from y = ", ends.low_m * 1e3, " mm to ", ends.high_m * 1e3, " mm, must be longer than 0 mm"));
  std::vector<int> low, high;
  for (const ProfileCorner& c : section) {
    low.push_back(detail::add_vertex(body, Vec3d(c.across_m, ends.low_m, c.z_m)));
    high.push_back(detail::add_vertex(body, Vec3d(c.across_m, ends.high_m, c.z_m)));
  }
  for (std::size_t k = 0; k < section.size(); ++k) {
    const std::size_t next = (k + 1) % section.size();
    body.facets.push_back({{low[k], high[k], high[next], low[next]}, section[k].patch});
  }
  body.facets.push_back({low, ends.low_patch});
  body.facets.push_back({{high.rbegin(), high.rend()}, ends.high_patch});
}

inline void add_revolved(Body& body, const std::vector<ProfileCorner>& profile, int edges_per_quarter) {
  require_in_range("edges of a quarter turn", edges_per_quarter, 1, 10000, "");
  detail::require_profile(body, profile);
  detail::Revolution(body, profile, edges_per_quarter).add();
}

}  // namespace lumo
