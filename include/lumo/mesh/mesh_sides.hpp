#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mesh/tet_mesh.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <numeric>
#include <span>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

namespace lumo::detail {

// A side of an element, or a boundary face as a side of what is outside: each must have one partner of opposite sense.
struct MeshSide {
  int middle, most;  // corners; the least one is the bucket that it lies in
  int from;          // 4 × element + corner opposite; −1 − face
  bool odd;          // sorting its corners was an odd permutation

  bool operator<(const MeshSide& o) const { return std::tie(middle, most, from) < std::tie(o.middle, o.most, o.from); }
  bool same_corners(const MeshSide& o) const { return middle == o.middle && most == o.most; }
};

class MeshSides {
 public:
  explicit MeshSides(const TetMesh& mesh) : mesh_(mesh), begin_(mesh.nodes.size() + 1, 0) {
    for_each([&](const std::array<int, 3>& c, int) { ++begin_[std::size_t(std::min({c[0], c[1], c[2]})) + 1]; });
    std::partial_sum(begin_.begin(), begin_.end(), begin_.begin());
    sides_.resize(begin_.back());
    std::vector<std::size_t> end(begin_);
    for_each([&](std::array<int, 3> c, int from) {
      bool odd = from < 0;  // seen from the other side
      const auto order = [&](std::size_t i, std::size_t j) {
        if (c[i] <= c[j]) return;
        std::swap(c[i], c[j]);
        odd = !odd;
      };
      order(0, 1);
      order(1, 2);
      order(0, 1);
      sides_[end[std::size_t(c[0])]++] = {c[1], c[2], from, odd};
    });
  }

  /// Throws unless all have their partners.
  void require_pairs() {
    for (std::size_t node = 0; node + 1 < begin_.size(); ++node) {
      const auto first = sides_.begin() + std::ptrdiff_t(begin_[node]),
                 last = sides_.begin() + std::ptrdiff_t(begin_[node + 1]);
      std::sort(first, last);
      for (auto side = first; side != last;) {
        const auto end = std::find_if(side, last, [&](const MeshSide& s) { return !s.same_corners(*side); });
        require_pair({side, end});
        side = end;
      }
    }
  }

 private:
  template <class Visit> void for_each(Visit&& visit) const {
    for (std::size_t e = 0; e < mesh_.tets.size(); ++e)
      for (std::size_t k = 0; k < 4; ++k) visit(corners(int(4 * e + k)), int(4 * e + k));
    for (std::size_t f = 0; f < mesh_.faces.size(); ++f) visit(corners(-1 - int(f)), -1 - int(f));
  }
  std::array<int, 3> corners(int from) const {
    if (from < 0) {
      const auto& n = mesh_.faces[std::size_t(-1 - from)].nodes;
      return {n[0], n[1], n[2]};
    }
    const auto& t = mesh_.tets[std::size_t(from / 4)];
    const auto& [a, b, c] = outward_faces[std::size_t(from % 4)];
    return {t[std::size_t(a)], t[std::size_t(b)], t[std::size_t(c)]};
  }
  // Middle nodes of a side, each where the corner opposite to it is in ascending order.
  std::array<int, 3> middles(int from) const {
    // Of the edges that lie opposite to the corners, in the order of outward_faces.
    static constexpr std::array<std::array<std::size_t, 3>, 4> opposite{{{9, 8, 5}, {9, 6, 7}, {8, 7, 4}, {5, 4, 6}}};
    std::array<int, 3> c = corners(from), m{};
    for (std::size_t k = 0; k < 3; ++k)
      m[k] = from < 0 ? mesh_.faces[std::size_t(-1 - from)].nodes[3 + (k + 1) % 3]
                      : mesh_.tets[std::size_t(from / 4)][opposite[std::size_t(from % 4)][k]];
    const auto order = [&](std::size_t i, std::size_t j) {
      if (c[i] <= c[j]) return;
      std::swap(c[i], c[j]);
      std::swap(m[i], m[j]);
    };
    order(0, 1);
    order(1, 2);
    order(0, 1);
    return m;
  }
  static std::string name(int from) { return from < 0 ? message("face ", -1 - from) : message("element ", from / 4); }
  void require_pair(std::span<const MeshSide> same) const {
    using Reason = MeshError::Reason;
    const MeshSide& one = same[0];
    if (same.size() == 1 && one.from < 0)
      throw MeshError(Reason::bad_index, message("mesh ", name(one.from), " is no side of an element"));
    if (same.size() == 1)
      throw MeshError(Reason::open, message("mesh ", name(one.from), " has a side without neighbour or boundary face"));
    const MeshSide& other = same[1];
    if (same.size() > 2)
      throw MeshError(Reason::not_manifold,
          message("mesh ", name(one.from), ", ", name(other.from), " and ", name(same[2].from), " share one side"));
    if (one.odd == other.odd)
      throw MeshError(Reason::not_manifold, message("mesh ", name(one.from), " and ", name(other.from),
                                                " lie on one side of their common face: one is inside out"));
    if (mesh_.order == 2 && middles(one.from) != middles(other.from))
      throw MeshError(Reason::open, message("mesh ", name(one.from), " and ", name(other.from),
                                        " share three corners, but not the middle nodes between them"));
  }

  const TetMesh& mesh_;
  std::vector<std::size_t> begin_;  // of each node's bucket
  std::vector<MeshSide> sides_;
};

}  // namespace lumo::detail
