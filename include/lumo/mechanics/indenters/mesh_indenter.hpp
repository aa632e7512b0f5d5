#pragma once

#include "lumo/geometry/signed_distance.hpp"
#include "lumo/mechanics/indenters/indenter.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

namespace lumo {

/// Signed distance to a closed triangle surface on a cubic grid, carried on between its points by the cubic spline
/// through them: twice continuously differentiable, of fourth order where the distance is smooth. Near sharp edges the
/// spline rounds by a fraction of a cell. From two cells outside the surface's box on it passes, within one cell, into
/// the exact distance. Source: Unser 1999 (spline through samples).
class DistanceGrid {
 public:
  /// `cells` across the surface's longest side. Throws MeshError for a surface that bounds no solid, InvalidArgument
  /// for other than 8 … 256 cells.
  DistanceGrid(const TriangleSurface& surface, int cells);
  DistanceGrid(const DistanceGrid&) = delete;  // what is exact points into the surface
  DistanceGrid& operator=(const DistanceGrid&) = delete;

  double distance(const Vec3d& p) const { return sample(p).distance; }

  /// Distance with its derivatives.
  DistanceSample sample(const Vec3d& p) const;

  double spacing_m() const { return h_; }
  const TriangleSurface& surface() const { return surface_; }
  /// Largest difference from the exact distance that was found at the middles of all cells within one spacing of the
  /// surface [m].
  double error_m() const { return error_; }

 private:
  static constexpr int pad = 6, rim = 3;  // cells about the surface, of which the outer ones only feed the spline

  double& at(int i, int j, int k) {
    return c_[std::size_t(i) + std::size_t(n_[0]) * (std::size_t(j) + std::size_t(n_[1]) * std::size_t(k))];
  }
  double at(int i, int j, int k) const { return const_cast<DistanceGrid*>(this)->at(i, j, k); }
  Vec3d node(int i, int j, int k) const { return origin_ + h_ * Vec3d(i, j, k); }

  static const TriangleSurface& checked(const TriangleSurface& surface) {
    validate_surface(surface);
    return surface;
  }
  void fill();
  void filter();
  void measure();
  DistanceSample spline(const Vec3d& p) const;
  DistanceSample exact(const Vec3d& p) const;

  TriangleSurface surface_;
  SignedDistance exact_;
  Vec3d origin_, low_, high_;  // first node; box in which the spline holds
  std::array<int, 3> n_{};     // nodes each way
  double h_ = 0.0, error_ = 0.0;
  std::vector<double> c_;  // spline coefficients
};

inline DistanceGrid::DistanceGrid(const TriangleSurface& surface, int cells)
    : surface_(checked(surface)), exact_(surface_) {
  if (cells < 8 || cells > 256)
    throw InvalidArgument(message("cells of a distance grid are ", cells, ", must lie in [8, 256]"));
  Eigen::AlignedBox3d box;
  for (const Vec3d& v : surface_.vertices) box.extend(v);
  const Vec3d size = box.sizes();
  h_ = size.maxCoeff() / cells;
  origin_ = box.min() - pad * h_ * Vec3d::Ones();
  for (int a = 0; a < 3; ++a) n_[std::size_t(a)] = int(std::ceil(size[a] / h_ - 1e-9)) + 2 * pad + 1;
  low_ = origin_ + rim * h_ * Vec3d::Ones();
  high_ = node(n_[0] - 1 - rim, n_[1] - 1 - rim, n_[2] - 1 - rim);
  c_.resize(std::size_t(n_[0]) * std::size_t(n_[1]) * std::size_t(n_[2]));
  fill();
  filter();
  measure();
}

inline void DistanceGrid::fill() {
  constexpr double reach = 1.001;  // cells: one, and rounding
  for (int k = 0; k < n_[2]; ++k)
    for (int j = 0; j < n_[1]; ++j)
      for (int i = 0; i < n_[0]; ++i)  // from node to node the distance changes by no more than the way
        at(i, j, k) = exact_.distance(
            node(i, j, k), i > 0 ? std::abs(at(i - 1, j, k)) + reach * h_ : std::numeric_limits<double>::infinity());
}

// The spline through the samples, line by line in all three directions, mirrored at the ends.
inline void DistanceGrid::filter() {
  const double pole = std::sqrt(3.0) - 2.0;  // of the cubic B-spline (Unser 1999)
  constexpr int terms = 30;                  // of the sum from the mirrored end: pole^30 is below 1e-17
  const auto line = [&](int count, auto&& value) {
    double first = 0.0, power = 1.0;
    for (int i = 0; i < std::min(count, terms); ++i, power *= pole) first += power * value(i);
    value(0) = first;
    for (int i = 1; i < count; ++i) value(i) += pole * value(i - 1);
    value(count - 1) = pole / (pole * pole - 1.0) * (value(count - 1) + pole * value(count - 2));
    for (int i = count - 2; i >= 0; --i) value(i) = pole * (value(i + 1) - value(i));
    for (int i = 0; i < count; ++i) value(i) *= 6.0;
  };
  for (int k = 0; k < n_[2]; ++k)
    for (int j = 0; j < n_[1]; ++j) line(n_[0], [&](int i) -> double& { return at(i, j, k); });
  for (int k = 0; k < n_[2]; ++k)
    for (int i = 0; i < n_[0]; ++i) line(n_[1], [&](int j) -> double& { return at(i, j, k); });
  for (int j = 0; j < n_[1]; ++j)
    for (int i = 0; i < n_[0]; ++i) line(n_[2], [&](int k) -> double& { return at(i, j, k); });
}

inline void DistanceGrid::measure() {
  for (int k = rim; k < n_[2] - 1 - rim; ++k)
    for (int j = rim; j < n_[1] - 1 - rim; ++j)
      for (int i = rim; i < n_[0] - 1 - rim; ++i) {
        const Vec3d p = node(i, j, k) + Vec3d::Constant(0.5 * h_);
        const double d = spline(p).distance;
        if (std::abs(d) < h_) error_ = std::max(error_, std::abs(d - exact_.distance(p, 3.0 * h_)));
      }
}

inline DistanceSample DistanceGrid::spline(const Vec3d& p) const {
  std::array<int, 3> cell;
  std::array<std::array<double, 4>, 3> w, dw, ddw;  // weights of the four nodes about p each way, and their derivatives
  for (std::size_t a = 0; a < 3; ++a) {
    const double u = (p[Eigen::Index(a)] - origin_[Eigen::Index(a)]) / h_;
    cell[a] = std::min(int(std::fmin(std::fmax(u, 1.0), n_[a])), n_[a] - 3);  // of NaN, any cell
    const double t = u - cell[a], s = 1.0 - t;
    w[a] = {s * s * s / 6.0, 2.0 / 3.0 - 0.5 * t * t * (2.0 - t), 2.0 / 3.0 - 0.5 * s * s * (2.0 - s), t * t * t / 6.0};
    dw[a] = {-0.5 * s * s / h_, 0.5 * t * (3.0 * t - 4.0) / h_, -0.5 * s * (3.0 * s - 4.0) / h_, 0.5 * t * t / h_};
    ddw[a] = {s / (h_ * h_), (3.0 * t - 2.0) / (h_ * h_), (3.0 * s - 2.0) / (h_ * h_), t / (h_ * h_)};
  }
  DistanceSample d{0.0, Vec3d::Zero(), Mat3d::Zero()};
  for (std::size_t k = 0; k < 4; ++k)
    for (std::size_t j = 0; j < 4; ++j) {
      double f = 0.0, fx = 0.0, fxx = 0.0;
      for (std::size_t i = 0; i < 4; ++i) {
        const double c = at(cell[0] + int(i) - 1, cell[1] + int(j) - 1, cell[2] + int(k) - 1);
        f += w[0][i] * c;
        fx += dw[0][i] * c;
        fxx += ddw[0][i] * c;
      }
      d.distance += w[1][j] * w[2][k] * f;
      d.gradient += Vec3d(w[1][j] * w[2][k] * fx, dw[1][j] * w[2][k] * f, w[1][j] * dw[2][k] * f);
      d.hessian(0, 0) += w[1][j] * w[2][k] * fxx;
      d.hessian(1, 1) += ddw[1][j] * w[2][k] * f;
      d.hessian(2, 2) += w[1][j] * ddw[2][k] * f;
      d.hessian(1, 0) += dw[1][j] * w[2][k] * fx;
      d.hessian(2, 0) += w[1][j] * dw[2][k] * fx;
      d.hessian(2, 1) += dw[1][j] * dw[2][k] * f;
    }
  d.hessian.triangularView<Eigen::StrictlyUpper>() = d.hessian.transpose();
  return d;
}

inline DistanceSample DistanceGrid::sample(const Vec3d& p) const {
  // How far p has gone from the spline to the exact distance, from 0 to 1 over the box's outermost cell, and how that
  // changes.
  double gone = 0.0;
  Vec3d slope = Vec3d::Zero();
  Mat3d bend = Mat3d::Zero();
  for (int a = 0; a < 3; ++a) {
    const double side = p[a] < 0.5 * (low_[a] + high_[a]) ? -1.0 : 1.0,
                 t = (side < 0.0 ? low_[a] - p[a] : p[a] - high_[a]) / h_ + 1.0;
    if (!(t > 0.0)) continue;
    if (t >= 1.0) return exact(p);
    // 1 − Π (1 − w) with w = t³ (10 − 15 t + 6 t²), whose first two derivatives vanish at both ends
    const double w = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t), dw = side / h_ * 30.0 * t * t * (1.0 - t) * (1.0 - t);
    const double ddw = 60.0 * t * (1.0 - t) * (1.0 - 2.0 * t) / (h_ * h_);
    bend *= 1.0 - w;
    bend.col(a) -= dw * slope;
    bend.row(a) -= dw * slope.transpose();
    bend(a, a) += ddw * (1.0 - gone);
    slope *= 1.0 - w;
    slope[a] += dw * (1.0 - gone);
    gone += w * (1.0 - gone);
  }
  const DistanceSample near = spline(p);
  if (gone == 0.0) return near;
  const DistanceSample far = exact(p);
  const double apart = far.distance - near.distance;
  const Vec3d turn = far.gradient - near.gradient;
  return {near.distance + gone * apart, near.gradient + gone * turn + apart * slope,
      near.hessian + gone * (far.hessian - near.hessian) + slope * turn.transpose() + turn * slope.transpose() +
          apart * bend};
}

inline DistanceSample DistanceGrid::exact(const Vec3d& p) const {
  const SignedDistance::Sample s = exact_.sample(p);
  return {s.distance, s.gradient, s.hessian};
}

/// Rigid tool of any closed triangle surface, by the signed distance on a grid; the surface's own coordinates are the
/// tool's frame. Copies share the grid. `MeshIndenter tool(read_surface("knob.stl"))`.
class MeshIndenter {
 public:
  /// Throws as DistanceGrid does.
  explicit MeshIndenter(const TriangleSurface& surface, int cells = 64)
      : grid_(std::make_shared<const DistanceGrid>(surface, cells)) {
    Eigen::AlignedBox3d box;
    for (const Vec3d& v : surface.vertices) {
      radius_m_ = std::max(radius_m_, v.norm());
      box.extend(v);
    }
    contact_radius_m_ = 0.5 * box.sizes().minCoeff();
  }

  /// The same surface on as fine a grid.
  bool operator==(const MeshIndenter& other) const {
    const TriangleSurface &a = grid_->surface(), &b = other.grid_->surface();
    return grid_ == other.grid_ ||
           (grid_->spacing_m() == other.grid_->spacing_m() && a.vertices == b.vertices && a.triangles == b.triangles);
  }

  double radius_m() const { return radius_m_; }
  double contact_radius_m() const { return contact_radius_m_; }
  double distance(const Vec3d& p) const { return grid_->distance(p); }
  DistanceSample sample(const Vec3d& p) const { return grid_->sample(p); }
  const DistanceGrid& grid() const { return *grid_; }

 private:
  std::shared_ptr<const DistanceGrid> grid_;
  double radius_m_ = 0.0, contact_radius_m_ = 0.0;
};

inline void validate(const MeshIndenter& m) {
  require_in_range("radius about a mesh indenter's origin", m.radius_m() * 1e3, 0.05, 1000.0, "mm");
}

static_assert(Indenter<MeshIndenter>);

}  // namespace lumo
