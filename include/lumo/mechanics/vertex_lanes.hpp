#pragma once

#include "lumo/mechanics/vertex_block.hpp"
#include "lumo/mechanics/vertex_colors.hpp"

#include <algorithm>
#include <array>
#include <vector>

namespace lumo {

/// Elastic and viscous forces and blocks of eight vertices of one colour at once, on linear tetrahedra of a dilatational solid. What a
/// vertex's tetrahedra need lies in the order of use; vertices with as many tetrahedra go together.
template <DilatationalMaterial Material>
class VertexLanes {
 public:
  static constexpr std::size_t width = Lanes::width;

  /// Up to eight vertices of one colour; −1 where there is none.
  struct Batch {
    std::array<int, width> vertex;
    std::size_t first, count;   ///< their slots
  };
  /// Squares C = FᵀF at a step's start, per slot: 11, 22, 33, 12, 13, 23.
  using Start = std::vector<std::array<Lanes, 6>>;

  /// `colors` name the vertices that move.
  VertexLanes(const TetMesh& mesh, const VertexElasticity<Material, LinearTet>& elasticity, const VertexColors& colors);

  /// Batches color by color.
  const std::vector<std::vector<Batch>>& batches() const { return batches_; }
  std::size_t slots() const { return slots_.size(); }

  /// Squares of one batch at positions x, into their places in `start`.
  void remember(const Batch& batch, const Positions& x, Start& start) const;

  /// Adds the shares of a batch's vertices; see VertexElasticity::add. `start` is not looked at without viscosity.
  void add(const Batch& batch, const Positions& x, const Start& start, double rate, std::array<VertexBlock, width>& out) const;

  /// Largest part of each vertex's step that is safe; see VertexElasticity::feasible_part.
  std::array<double, width> feasible_parts(const Batch& batch, const Positions& x, const std::array<Vec3, width>& steps) const;

 private:
  // One tetrahedron of each of the batch's vertices: its three other nodes and the gradients of their shape functions.
  struct Slot {
    std::array<Lanes, 9> gradient;
    Lanes weight;
    Lanes area_scale;   // signed 1/(6 V): the opposite face's doubled area vector times it is the slope of det F by the vertex
    std::array<std::array<int, width>, 3> node;   // times three: where its x is
  };
  // Where a batch's vertices are.
  static std::array<Lanes, 3> places(const Batch& batch, const Positions& x);
  // From vertices at `self` to the slot's other nodes.
  using Edges = std::array<std::array<Lanes, 3>, 3>;
  [[gnu::always_inline]] static Edges edges(const std::array<Lanes, 3>& self, const Slot& slot, const Positions& x) {
    Edges e;
    for (std::size_t b = 0; b < 3; ++b)
      for (std::size_t i = 0; i < 3; ++i) e[b][i] = Lanes::gathered(x.data() + i, slot.node[b]) - self[i];
    return e;
  }
  // F, column by column.
  [[gnu::always_inline]] static std::array<Lanes, 9> deformation(const Edges& e, const Slot& slot) {
    std::array<Lanes, 9> F;
    for (std::size_t j = 0; j < 3; ++j)
      for (std::size_t i = 0; i < 3; ++i) F[i + 3 * j] = e[0][i] * slot.gradient[j] + e[1][i] * slot.gradient[3 + j] + e[2][i] * slot.gradient[6 + j];
    return F;
  }
  [[gnu::always_inline]] static std::array<Lanes, 6> squares(const std::array<Lanes, 9>& F) {
    const auto dot = [&](std::size_t i, std::size_t j) -> Lanes { return F[3 * i] * F[3 * j] + F[3 * i + 1] * F[3 * j + 1] + F[3 * i + 2] * F[3 * j + 2]; };
    return {dot(0, 0), dot(1, 1), dot(2, 2), dot(0, 1), dot(0, 2), dot(1, 2)};
  }
  // Gradient of the vertex's own shape function.
  static std::array<Lanes, 3> own_gradient(const Slot& slot) {
    std::array<Lanes, 3> g;
    for (std::size_t j = 0; j < 3; ++j) g[j] = -(slot.gradient[j] + slot.gradient[3 + j] + slot.gradient[6 + j]);
    return g;
  }
  // det F and its slope c by the vertex's place, cof F applied to its gradient: the doubled area vector of the opposite face.
  [[gnu::always_inline]] static Lanes dilation(const Edges& e, const Lanes& scale, std::array<Lanes, 3>& c) {
    std::array<Lanes, 3> a, b;
    for (std::size_t i = 0; i < 3; ++i) a[i] = e[1][i] - e[0][i], b[i] = e[2][i] - e[0][i];
    for (std::size_t i = 0; i < 3; ++i) c[i] = scale * (a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3]);
    return -(c[0] * e[0][0] + c[1] * e[0][1] + c[2] * e[0][2]);
  }

  Material material_;
  std::vector<std::vector<Batch>> batches_;
  std::vector<Slot> slots_;
};

template <DilatationalMaterial Material>
VertexLanes<Material>::VertexLanes(const TetMesh& mesh, const VertexElasticity<Material, LinearTet>& elasticity, const VertexColors& colors) : material_(elasticity.material()) {
  for (const std::vector<int>& color : colors) {
    std::vector<int> order = color;
    std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return elasticity.incidences(a).size() > elasticity.incidences(b).size(); });
    batches_.emplace_back();
    for (std::size_t begin = 0; begin < order.size(); begin += width) {
      Batch batch{{}, slots_.size(), elasticity.incidences(order[begin]).size()};
      for (std::size_t lane = 0; lane < width; ++lane) batch.vertex[lane] = begin + lane < order.size() ? order[begin + lane] : -1;
      for (std::size_t k = 0; k < batch.count; ++k) {
        Slot slot;
        for (std::size_t lane = 0; lane < width; ++lane) {
          // What is missing repeats something sound without weight, so that no lane makes NaN.
          const int v = batch.vertex[lane] >= 0 ? batch.vertex[lane] : order[begin];
          const auto& at = elasticity.incidences(v);
          const bool real = batch.vertex[lane] >= 0 && k < at.size();
          const auto& in = at[std::min(k, at.size() - 1)];
          const auto& g = elasticity.gradient(in.tet, 0);
          std::array<Vec3, 3> at_rest;
          for (int b = 0, other = 0; b < 4; ++b) {
            if (b == in.place) continue;
            at_rest[std::size_t(other)] = mesh.nodes[std::size_t(mesh.tets[std::size_t(in.tet)][std::size_t(b)])];
            slot.node[std::size_t(other)][lane] = 3 * mesh.tets[std::size_t(in.tet)][std::size_t(b)];
            for (int c = 0; c < 3; ++c) slot.gradient[std::size_t(3 * other + c)].set(lane, g(c, b));
            ++other;
          }
          const Vec3 area = (at_rest[1] - at_rest[0]).cross(at_rest[2] - at_rest[0]);
          slot.area_scale.set(lane, area.dot(g.col(in.place)) / area.squaredNorm());   // at rest the slope is the vertex's own gradient
          slot.weight.set(lane, real ? elasticity.weight(in.tet, 0) : 0.0);
        }
        slots_.push_back(slot);
      }
      for (std::size_t lane = 0; lane < width; ++lane)
        if (batch.vertex[lane] < 0) batch.vertex[lane] = -1 - order[begin];   // its place is read, and no other's
      batches_.back().push_back(batch);
    }
  }
}

template <DilatationalMaterial Material>
std::array<Lanes, 3> VertexLanes<Material>::places(const Batch& batch, const Positions& x) {
  std::array<Lanes, 3> self;
  for (std::size_t lane = 0; lane < width; ++lane) {
    const int v = batch.vertex[lane] < 0 ? -1 - batch.vertex[lane] : batch.vertex[lane];
    for (std::size_t c = 0; c < 3; ++c) self[c].set(lane, x.data()[3 * std::size_t(v) + c]);
  }
  return self;
}

template <DilatationalMaterial Material>
std::array<double, VertexLanes<Material>::width> VertexLanes<Material>::feasible_parts(const Batch& batch, const Positions& x,
                                                                                       const std::array<Vec3, width>& steps) const {
  std::array<double, width> part;
  part.fill(1.0);
  std::array<Lanes, 3> step;
  for (std::size_t lane = 0; lane < width; ++lane)
    for (std::size_t i = 0; i < 3; ++i) step[i].set(lane, steps[lane][Eigen::Index(i)]);
  const std::array<Lanes, 3> self = places(batch, x);
  for (std::size_t k = batch.first; k < batch.first + batch.count; ++k) {
    std::array<Lanes, 3> c;
    const Lanes J = dilation(edges(self, slots_[k], x), slots_[k].area_scale, c);
    const Lanes slope = c[0] * step[0] + c[1] * step[1] + c[2] * step[2];
    for (std::size_t lane = 0; lane < width; ++lane)
      if (J[lane] + part[lane] * slope[lane] < 0.1 * J[lane]) part[lane] = -0.9 * J[lane] / slope[lane];
  }
  return part;
}

template <DilatationalMaterial Material>
void VertexLanes<Material>::remember(const Batch& batch, const Positions& x, Start& start) const {
  const std::array<Lanes, 3> self = places(batch, x);
  for (std::size_t k = batch.first; k < batch.first + batch.count; ++k) start[k] = squares(deformation(edges(self, slots_[k], x), slots_[k]));
}

template <DilatationalMaterial Material>
void VertexLanes<Material>::add(const Batch& batch, const Positions& x, const Start& start, double rate, std::array<VertexBlock, width>& out) const {
  const double mu = material_.shear_modulus();
  std::array<Lanes, 3> force;
  std::array<Lanes, 6> block;   // 11, 22, 33, 12, 13, 23
  const std::array<Lanes, 3> self = places(batch, x);
  static constexpr std::size_t row[6] = {0, 1, 2, 0, 0, 1}, column[6] = {0, 1, 2, 1, 2, 2};
  for (std::size_t k = batch.first; k < batch.first + batch.count; ++k) {
    const Slot& slot = slots_[k];
    const Edges e = edges(self, slot, x);
    const std::array<Lanes, 9> F = deformation(e, slot);
    const std::array<Lanes, 3> g = own_gradient(slot);
    std::array<Lanes, 3> Fg, c;
    for (std::size_t i = 0; i < 3; ++i) Fg[i] = F[i] * g[0] + F[i + 3] * g[1] + F[i + 6] * g[2];
    const DilatationSample<Lanes> h = material_.dilatation(dilation(e, slot.area_scale, c));
    const Lanes square = g[0] * g[0] + g[1] * g[1] + g[2] * g[2];
    const Lanes push = slot.weight * h.stress, stretch = mu * slot.weight, bulk = slot.weight * h.stiffness;
    for (std::size_t i = 0; i < 3; ++i) {
      force[i] -= stretch * Fg[i] + push * c[i];
      block[i] += stretch * square;
    }
    for (std::size_t m = 0; m < 6; ++m) block[m] += bulk * c[row[m]] * c[column[m]];
    if (rate > 0.0) {
      std::array<Lanes, 6> change = squares(F);
      for (std::size_t m = 0; m < 6; ++m) change[m] -= start[k][m];
      const Lanes w = (2.0 * rate) * slot.weight;
      const std::array<Lanes, 3> d = {change[0] * g[0] + change[3] * g[1] + change[4] * g[2], change[3] * g[0] + change[1] * g[1] + change[5] * g[2],
                                      change[4] * g[0] + change[5] * g[1] + change[2] * g[2]};
      for (std::size_t i = 0; i < 3; ++i) force[i] -= w * (F[i] * d[0] + F[i + 3] * d[1] + F[i + 6] * d[2]);
      for (std::size_t m = 0; m < 6; ++m) {
        const std::size_t i = row[m], j = column[m];
        block[m] += w * (square * (F[i] * F[j] + F[i + 3] * F[j + 3] + F[i + 6] * F[j + 6]) + Fg[i] * Fg[j]);
      }
    }
  }
  for (std::size_t lane = 0; lane < width; ++lane) {
    out[lane].force += Vec3(force[0][lane], force[1][lane], force[2][lane]);
    for (std::size_t m = 0; m < 6; ++m) {
      out[lane].block(Eigen::Index(row[m]), Eigen::Index(column[m])) += block[m][lane];
      if (m > 2) out[lane].block(Eigen::Index(column[m]), Eigen::Index(row[m])) += block[m][lane];
    }
  }
}

}  // namespace lumo
