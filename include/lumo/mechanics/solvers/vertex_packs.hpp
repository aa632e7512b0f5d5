#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mechanics/elements/element_packs.hpp"
#include "lumo/mechanics/solvers/vertex_block.hpp"
#include "lumo/mesh/tet_mesh.hpp"

#include <algorithm>
#include <array>
#include <vector>

namespace lumo {

/// Groups of nodes no two of which share a tetrahedron: each node takes the first group that is free, in the order of
/// node numbers.
using VertexColors = std::vector<std::vector<int>>;

inline VertexColors color_vertices(const TetMesh& mesh) {
  const std::size_t per = std::size_t(mesh.nodes_per_tet());
  std::vector<std::vector<int>> tets_of(mesh.nodes.size());
  for (std::size_t e = 0; e < mesh.tets.size(); ++e)
    for (std::size_t a = 0; a < per; ++a) tets_of[std::size_t(mesh.tets[e][a])].push_back(int(e));
  VertexColors colors;
  std::vector<int> color(mesh.nodes.size(), -1), last_seen;
  for (std::size_t v = 0; v < mesh.nodes.size(); ++v) {
    for (int e : tets_of[v])
      for (std::size_t a = 0; a < per; ++a)
        if (const int c = color[std::size_t(mesh.tets[std::size_t(e)][a])]; c >= 0) last_seen[std::size_t(c)] = int(v);
    std::size_t free = 0;
    while (free < colors.size() && last_seen[free] == int(v)) ++free;
    if (free == colors.size()) {
      colors.emplace_back();
      last_seen.push_back(-1);
    }
    color[v] = int(free);
    colors[free].push_back(int(v));
  }
  return colors;
}

/// Throws InvalidArgument unless every node is in one group and no two nodes of a group share a tetrahedron.
inline void validate(const VertexColors& colors, const TetMesh& mesh) {
  std::vector<int> color(mesh.nodes.size(), -1);
  for (std::size_t c = 0; c < colors.size(); ++c)
    for (int v : colors[c]) {
      if (v < 0 || std::size_t(v) >= mesh.nodes.size())
        throw InvalidArgument(message("color ", c, " names node ", v, " of ", mesh.nodes.size()));
      if (color[std::size_t(v)] >= 0) throw InvalidArgument(message("node ", v, " has more than one color"));
      color[std::size_t(v)] = int(c);
    }
  for (std::size_t v = 0; v < color.size(); ++v)
    if (color[v] < 0) throw InvalidArgument(message("node ", v, " has no color"));
  for (const auto& t : mesh.tets)
    for (int a = 0; a < mesh.nodes_per_tet(); ++a)
      for (int b = 0; b < a; ++b)
        if (color[std::size_t(t[std::size_t(a)])] == color[std::size_t(t[std::size_t(b)])])
          throw InvalidArgument(
              message("nodes ", t[std::size_t(a)], " and ", t[std::size_t(b)], " of one tetrahedron have one color"));
}

/// A solid of the form W = μ/2 (I_C − 3) + h(J), whose P = μ F + h'(J) cof F is cheap enough to be taken for many
/// elements at once.
template <class M>
concept DilatationalMaterial = HyperelasticMaterial<M> && requires(const M& m, const SimdPack& J) {
  { m.dilatation(J) } -> std::same_as<DilatationSample<SimdPack>>;
};

/// Elastic and viscous forces and blocks of eight vertices of one color at once, on linear tetrahedra of a dilatational
/// solid. What a vertex's tetrahedra need lies in the order of use; vertices with as many tetrahedra go together. A
/// sweep waits for memory as much as for arithmetic, and the solid is isotropic: a tetrahedron at rest is seen in axes
/// of its own, where a third of F's derivatives vanish.
template <DilatationalMaterial Material> class VertexPacks {
 public:
  static constexpr std::size_t width = SimdPack::width;

  /// Up to eight vertices of one color.
  struct Batch {
    std::array<int, width> vertex;  ///< where there is none, the first again
    std::array<bool, width> moves;  ///< there is one
    std::size_t first, count;       ///< their slots
  };
  /// Per slot what viscosity wants of a step's start: the column of C = FᵀF along the vertex's own gradient.
  using Start = std::vector<VectorPack>;

  /// `colors` name the vertices that move.
  VertexPacks(const TetMesh& mesh, const VertexElasticity<Material, LinearTet>& elasticity, const VertexColors& colors);

  /// Batches color by color.
  const std::vector<std::vector<Batch>>& batches() const { return batches_; }
  std::size_t slots() const { return slots_.size(); }

  /// Start of one batch.
  void remember(const Batch& batch, const PaddedPositions& x, Start& start) const;

  /// Adds the shares of a batch's vertices; see VertexElasticity::add. `start` is not looked at without viscosity.
  void add(const Batch& batch, const PaddedPositions& x, const Start& start, double rate,
      std::array<VertexBlock, width>& out) const;

  /// Largest part of each vertex's step that is safe; see VertexElasticity::feasible_part.
  std::array<double, width> feasible_parts(
      const Batch& batch, const PaddedPositions& x, const std::array<Vec3d, width>& steps) const;

 private:
  // One tetrahedron of each of the batch's vertices, by its three other nodes. Axis 1 lies along the gradient g = (γ,
  // 0, 0) of the vertex's own shape function, axis 3 across the first other node's: the gradients are (a₀, c, 0), (a₁,
  // d, f), (a₂, −c−d, −f), γ = −a₀−a₁−a₂, and γ c f = 1/(6 V).
  struct Slot {
    VectorPack a;
    SimdPack c, d, f;                            // [1/m]
    SimdPack volume;                             // [m³]; 0 where a vertex has no further tetrahedron
    std::array<std::array<int, width>, 3> node;  // right-handed as seen from the vertex
  };
  // A tetrahedron as it is now.
  struct Shape {
    MatrixPack F;
    VectorPack area;  // slope of det F by the vertex's place, cof F applied to g
    SimdPack J, gamma;
  };

  [[gnu::always_inline]] static VectorPack difference(const VectorPack& a, const VectorPack& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
  }
  // From vertices at `self`.
  [[gnu::always_inline]] static Shape shape(const VectorPack& self, const Slot& s, const PaddedPositions& x) {
    const VectorPack p0 = SimdPack::gathered(x, s.node[0]), p1 = SimdPack::gathered(x, s.node[1]),
                     p2 = SimdPack::gathered(x, s.node[2]);
    const VectorPack e0 = difference(p0, self), e1 = difference(p1, self), e2 = difference(p2, self),
                     u = difference(p0, p2), v = difference(p1, p2);
    Shape now;
    now.gamma = -(s.a[0] + s.a[1] + s.a[2]);
    const SimdPack scale = now.gamma * s.c * s.f;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
      now.F[0][i] = s.a[0] * e0[i] + s.a[1] * e1[i] + s.a[2] * e2[i];
      now.F[1][i] = s.c * u[i] + s.d * v[i];
      now.F[2][i] = s.f * v[i];
      now.area[i] = scale * (u[k] * v[j] - u[j] * v[k]);
    }
    now.J = -dot(now.area, e2);
    return now;
  }
  // Column of C along axis 1.
  [[gnu::always_inline]] static VectorPack square(const Shape& now) {
    return {dot(now.F[0], now.F[0]), dot(now.F[1], now.F[0]), dot(now.F[2], now.F[0])};
  }

  Material material_;
  std::vector<std::vector<Batch>> batches_;
  std::vector<Slot> slots_;
};

template <DilatationalMaterial Material> VertexPacks<Material>::VertexPacks(
    const TetMesh& mesh, const VertexElasticity<Material, LinearTet>& elasticity, const VertexColors& colors)
    : material_(elasticity.material()) {
  for (const std::vector<int>& color : colors) {
    std::vector<int> order = color;
    std::stable_sort(order.begin(), order.end(),
        [&](int a, int b) { return elasticity.incidences(a).size() > elasticity.incidences(b).size(); });
    batches_.emplace_back();
    for (std::size_t begin = 0; begin < order.size(); begin += width) {
      Batch batch{{}, {}, slots_.size(), elasticity.incidences(order[begin]).size()};
      for (std::size_t lane = 0; lane < width; ++lane) {
        batch.moves[lane] = begin + lane < order.size();
        batch.vertex[lane] = order[batch.moves[lane] ? begin + lane : begin];
      }
      for (std::size_t k = 0; k < batch.count; ++k) {
        Slot slot;
        for (std::size_t lane = 0; lane < width; ++lane) {
          // What is missing repeats something sound without volume, so that no lane makes NaN.
          const auto& at = elasticity.incidences(batch.vertex[lane]);
          const auto& in = at[std::min(k, at.size() - 1)];
          const auto& gradient = elasticity.gradient(in.tet, 0);
          // The other nodes of a right-handed tetrahedron, right-handed as seen from each.
          static constexpr int others[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
          const auto& other = others[in.place];
          const Vec3d axis1 = gradient.col(in.place).normalized(), g0 = gradient.col(other[0]),
                      g1 = gradient.col(other[1]);
          const Vec3d axis2 = Vec3d(g0 - g0.dot(axis1) * axis1).normalized();
          for (std::size_t b = 0; b < 3; ++b) {
            slot.a[b].set(lane, gradient.col(other[b]).dot(axis1));
            slot.node[b][lane] = mesh.tets[std::size_t(in.tet)][std::size_t(other[b])];
          }
          slot.c.set(lane, g0.dot(axis2));
          slot.d.set(lane, g1.dot(axis2));
          slot.f.set(lane, std::abs(g1.dot(axis1.cross(axis2))));  // the third axis points where f is positive
          slot.volume.set(lane, batch.moves[lane] && k < at.size() ? elasticity.weight(in.tet, 0) : 0.0);
        }
        slots_.push_back(slot);
      }
      batches_.back().push_back(batch);
    }
  }
}

template <DilatationalMaterial Material>
std::array<double, VertexPacks<Material>::width> VertexPacks<Material>::feasible_parts(
    const Batch& batch, const PaddedPositions& x, const std::array<Vec3d, width>& steps) const {
  std::array<double, width> part;
  part.fill(1.0);
  VectorPack step;
  for (std::size_t lane = 0; lane < width; ++lane)
    for (std::size_t i = 0; i < 3; ++i) step[i].set(lane, steps[lane][Eigen::Index(i)]);
  const VectorPack self = SimdPack::gathered(x, batch.vertex);
  for (std::size_t k = batch.first; k < batch.first + batch.count; ++k) {
    const Shape now = shape(self, slots_[k], x);
    const SimdPack slope = dot(now.area, step);
    for (std::size_t lane = 0; lane < width; ++lane)
      if (now.J[lane] + part[lane] * slope[lane] < least_J_kept * now.J[lane])
        part[lane] = (least_J_kept - 1.0) * now.J[lane] / slope[lane];
  }
  return part;
}

template <DilatationalMaterial Material>
void VertexPacks<Material>::remember(const Batch& batch, const PaddedPositions& x, Start& start) const {
  const VectorPack self = SimdPack::gathered(x, batch.vertex);
  for (std::size_t k = batch.first; k < batch.first + batch.count; ++k) start[k] = square(shape(self, slots_[k], x));
}

template <DilatationalMaterial Material> void VertexPacks<Material>::add(const Batch& batch, const PaddedPositions& x,
    const Start& start, double rate, std::array<VertexBlock, width>& out) const {
  static constexpr std::size_t row[6] = {0, 1, 2, 0, 0, 1}, column[6] = {0, 1, 2, 1, 2, 2};
  const double mu = material_.shear_modulus();
  const VectorPack self = SimdPack::gathered(x, batch.vertex);
  VectorPack force;
  std::array<SimdPack, 6> block;
  for (std::size_t k = batch.first; k < batch.first + batch.count; ++k) {
    // Neighbours are scattered over the mesh: those of the slot after next are sent for.
    for (const auto& nodes : slots_[std::min(k + 2, slots_.size() - 1)].node)
      for (int n : nodes) SimdPack::prefetch(x[std::size_t(n)]);
    const Slot& s = slots_[k];
    const Shape now = shape(self, s, x);
    const DilatationSample<SimdPack> h = material_.dilatation(now.J);
    const SimdPack stretch = mu * s.volume * now.gamma, push = s.volume * h.stress, bulk = s.volume * h.stiffness;
    VectorPack bulk_area;
    for (std::size_t i = 0; i < 3; ++i) {
      force[i] -= stretch * now.F[0][i] + push * now.area[i];
      block[i] += stretch * now.gamma;
      bulk_area[i] = bulk * now.area[i];
    }
    for (std::size_t m = 0; m < 6; ++m) block[m] += bulk_area[row[m]] * now.area[column[m]];
    if (rate > 0.0) {
      const SimdPack w = (2.0 * rate) * s.volume * now.gamma;
      const VectorPack change = difference(square(now), start[k]);
      for (std::size_t i = 0; i < 3; ++i)
        force[i] -= w * (now.F[0][i] * change[0] + now.F[1][i] * change[1] + now.F[2][i] * change[2]);
      const SimdPack wg = w * now.gamma;
      for (std::size_t m = 0; m < 6; ++m) {
        const std::size_t i = row[m], j = column[m];
        block[m] += wg * (2.0 * now.F[0][i] * now.F[0][j] + now.F[1][i] * now.F[1][j] + now.F[2][i] * now.F[2][j]);
      }
    }
  }
  for (std::size_t lane = 0; lane < width; ++lane) {
    out[lane].force += Vec3d(force[0][lane], force[1][lane], force[2][lane]);
    for (std::size_t m = 0; m < 6; ++m) {
      out[lane].block(Eigen::Index(row[m]), Eigen::Index(column[m])) += block[m][lane];
      if (m > 2) out[lane].block(Eigen::Index(column[m]), Eigen::Index(row[m])) += block[m][lane];
    }
  }
}

}  // namespace lumo
