#pragma once

#include "lumo/mechanics/contact/first_touch.hpp"
#include "lumo/mechanics/contact/scenario.hpp"
#include "lumo/mechanics/indenters/indenter.hpp"
#include "lumo/mesh/sector.hpp"
#include "quasi_definite.hpp"

#include <array>
#include <chrono>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

namespace lumo::reference {

/// Quadratic displacement and continuous linear pressure (Taylor, Hood 1973; inf-sup stable) on lumo's meshes, with an
/// element, contact assembly and Newton loop of its own. Stationary point of
///   ∫ μ/2 (I_C − 3) − μ ln J + p ln J − p²/(2λ) dV + ∫ k/2 ⟨−g⟩² dA − F s,
/// which for λ/2 (ln J)² is the law's perturbed Lagrangian.
struct Constants {
  double mu = 106.0e3;
  double lambda = 10.494e6;
  double penalty = 1e11;  ///< per reference area [N/m³]
};

/// Signed distance to a union of boxes with rounded edges: from the nearest point of each box without its rim.
inline DistanceSample over_boxes(const std::vector<RigidBox>& boxes, const Vec3d& x) {
  DistanceSample least{std::numeric_limits<double>::infinity(), Vec3d::UnitZ(), Mat3d::Zero()};
  for (const RigidBox& box : boxes) {
    const Vec3d rel = x - box.center, core = box.half.array() - box.edge_radius,
                foot = rel.cwiseMin(core).cwiseMax(-core), off = rel - foot;
    DistanceSample d;
    if (const double length = off.norm(); length > 0.0) {
      d = {length - box.edge_radius, off / length, Mat3d::Zero()};
      Mat3d bends = Mat3d::Zero();
      for (int k = 0; k < 3; ++k) bends(k, k) = off[k] != 0.0;
      d.hessian = (bends - d.gradient * d.gradient.transpose()) / length;
    } else {
      Eigen::Index axis = 0;
      const double in = (core - rel.cwiseAbs()).minCoeff(&axis);
      d = {-in - box.edge_radius, Vec3d::Unit(axis) * (rel[axis] < 0.0 ? -1.0 : 1.0), Mat3d::Zero()};
    }
    if (d.distance < least.distance) least = d;
  }
  return least;
}

/// Equilibrium at one load, on the sector's nodes.
struct Equilibrium {
  bool converged = false;
  /// As many negative pivots as pressures: the stiffness with the pressures eliminated is positive definite.
  bool stable = false;
  double load_N = 0.0, depth_m = 0.0, residual_N = 0.0, overlap_m = 0.0;
  int factors = 0;
  std::vector<Vec3d> displacement;
  std::vector<double> pressure_Pa;  ///< p per node, NaN at middle nodes
};

/// Point and weight (of volume 1) of a degree-5 rule with fourteen points. Source: Walkington 2000.
inline std::pair<std::array<double, 4>, double> tet_point(int q) {
  constexpr double a = 0.31088591926330060980, b = 0.092735250310891226402, c = 0.045503704125649649492;
  if (q < 8) {
    const double t = q < 4 ? a : b;
    std::array<double, 4> l{t, t, t, t};
    l[std::size_t(q % 4)] = 1.0 - 3.0 * t;
    return {l, q < 4 ? 0.11268792571801585080 : 0.07349304311636194934};
  }
  static constexpr std::size_t pairs[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};
  std::array<double, 4> l{c, c, c, c};
  for (std::size_t k : pairs[q - 8]) l[k] = 0.5 - c;
  return {l, 0.042546020777081466438};
}

class TaylorHood {
 public:
  static constexpr int points = 14, displacements = 30, unknowns = 34, splits = 8, face_points = 3 * splits * splits;
  using Points = Eigen::Matrix3Xd;

  /// Unknowns of the whole problem: positions, pressures, advance.
  struct Place {
    Points x;
    Eigen::VectorXd p;
    double advance = 0.0;
  };
  /// What the contact law is linearised about at a point: pressure carried on linearly by the steps, and whether the
  /// point takes part.
  struct Touching {
    double pressure = 0.0;
    bool active = false;
  };
  using Contacts = std::array<std::vector<Touching>, 2>;  // with the indenter, with the carrier

  /// `planes`: symmetry planes that bound `mesh`. Faces of contactable patches meet the indenter, those that meet the
  /// carrier its boxes.
  TaylorHood(const Body& body, const TetMesh& mesh, Symmetry planes, const Constants& constants);

  /// States at increasing loads (the sector's share of each is `share`), from first touch; ends at the first that does
  /// not converge.
  std::vector<Equilibrium> press(const Sphere& sphere, const Vec3d& origin, const Vec3d& direction,
      const std::vector<double>& loads, double share);

  // Parts, open to verification.
  void start(const Sphere& sphere, const Vec3d& origin, const Vec3d& direction);
  /// Out-of-balance forces and volumes with their derivative; with `seen` contact is linearised, else as it is.
  Eigen::VectorXd residual(const Place& at, const Contacts* seen, bool with_matrix);
  const SparseLower& matrix() const { return matrix_; }
  const Eigen::VectorXd& coupling() const { return coupling_; }
  double push() const { return push_; }
  double overlap() const { return overlap_; }
  Place rest() const;
  void fix(int node, int axis) { fixed_.push_back(3 * node + axis); }
  void number();  ///< after the last fix()
  int equation(int node, int axis) const { return equation_[std::size_t(3 * node + axis)]; }
  int count() const { return count_; }
  /// Newton's method at a load (the sector's share) from `at`.
  Equilibrium solve(Place& at, double load, double tolerance);

 private:
  struct Surface {
    std::vector<BoundaryFace> faces;
    std::vector<double> area;  ///< per face and point [m²]
  };
  using Gradients = Eigen::Matrix<double, 3, 10>;

  Surface surface(const std::vector<BoundaryFace>& faces) const;
  double weight(std::size_t e, int q) const { return weight_[e * points + std::size_t(q)]; }
  const Gradients& gradient(std::size_t e, int q) const { return gradient_[e * points + std::size_t(q)]; }
  Eigen::Matrix<double, 3, 10> local(std::size_t e, const Points& x) const {
    Eigen::Matrix<double, 3, 10> l;
    for (int a = 0; a < 10; ++a) l.col(a) = x.col(mesh_.tets[e][std::size_t(a)]);
    return l;
  }
  double smallest_J(const Points& x) const;
  /// Gradients by the undeformed position, and weights, at all points of the elements.
  void set_up_elements();
  /// Shapes and slopes of a curved face at its points.
  void set_up_faces();
  /// Contact and bonded faces, symmetry planes.
  void set_up_boundary(const Body& body, Symmetry planes);
  void add_elements(const Place& at, Eigen::VectorXd& r, bool with_matrix);
  void add_contact(std::size_t side, const Place& at, const Contacts* seen, Eigen::VectorXd& r, bool with_matrix);
  /// One step of Newton's method: of the positions, the pressures and the advance.
  struct Step {
    Points x;
    Eigen::VectorXd p;
    double advance = 0.0;
  };
  /// The step at `at` towards equilibrium with `load`; updates `out`'s factors and stability. nullopt if the matrix is
  /// singular or the step is not finite.
  std::optional<Step> newton_step(const Place& at, double load, Equilibrium& out);
  /// Adds the fraction `t` of a step. Contact pressures follow it as it was linearised; a point leaves contact if that
  /// predicts a pull.
  void take(const Step& step, double t, Place& at);
  /// Points that overlap take part from now on.
  void join_overlapping(const Place& at);
  /// Advances rigidly until the overlap pushes back with the load: the start of the first load.
  void advance_to_load(Place& at, double load);
  /// Calls visit(face, point, position) at all points of the faces that may touch.
  template <class Visit> void near(std::size_t side, const Place& at, Visit&& visit) const;
  DistanceSample sample(std::size_t side, const Vec3d& x, double advance) const {
    return side == 0 ? sphere_.sample(x - origin_ - advance * direction_) : over_boxes(carrier_, x);
  }
  double distance(std::size_t side, const Vec3d& x, double advance) const {
    return side == 0 ? sphere_.distance(x - origin_ - advance * direction_) : over_boxes(carrier_, x).distance;
  }
  Vec3d position(const BoundaryFace& f, std::size_t k, const Points& x) const {
    Vec3d at = Vec3d::Zero();
    for (std::size_t a = 0; a < 6; ++a) at += shape_[k][a] * x.col(f.nodes[a]);
    return at;
  }
  void add(int row, int column, double value) {
    if (row < 0 || column < 0) return;
    if (row < column) std::swap(row, column);
    const int* begin = matrix_.innerIndexPtr() + matrix_.outerIndexPtr()[column];
    const int* end = matrix_.innerIndexPtr() + matrix_.outerIndexPtr()[column + 1];
    matrix_.valuePtr()[std::lower_bound(begin, end, row) - matrix_.innerIndexPtr()] += value;
  }

  TetMesh mesh_;
  Constants constants_;
  std::vector<RigidBox> carrier_;
  std::array<Surface, 2> surfaces_;
  std::vector<Gradients, Eigen::aligned_allocator<Gradients>> gradient_;
  std::vector<double> weight_;
  std::vector<int> fixed_, equation_, pressure_equation_;  // −1: fixed or a middle node
  int count_ = 0, pressures_ = 0;
  std::vector<int> slot_;
  SparseLower matrix_;
  QuasiDefinite factor_;
  Eigen::VectorXd coupling_;
  double push_ = 0.0, push_stiffness_ = 0.0, overlap_ = 0.0;
  // On the way a carrier's rounded edges are taken as flat: their curvature makes Newton's method cycle. Without it
  // convergence is linear.
  static constexpr double settled = 1e-3;  // residual over load below which they are not
  bool flat_ = true;
  Sphere sphere_;
  Vec3d origin_ = Vec3d::Zero(), direction_ = -Vec3d::UnitZ();
  Contacts contacts_;
  std::array<std::array<double, 6>, face_points> shape_;
  std::array<std::array<std::array<double, 2>, 6>, face_points> slope_;
  std::array<double, 14> point_weight_;
  std::array<std::array<double, 4>, 14> linear_;
};

inline TaylorHood::TaylorHood(const Body& body, const TetMesh& mesh, Symmetry planes, const Constants& constants)
    : mesh_(mesh), constants_(constants), carrier_(body.carrier) {
  set_up_elements();
  set_up_faces();
  set_up_boundary(body, planes);
  number();
}

inline void TaylorHood::set_up_elements() {
  static constexpr std::size_t ends[6][2] = {{0, 1}, {1, 2}, {0, 2}, {0, 3}, {1, 3}, {2, 3}};
  Eigen::Matrix<double, 3, 4> corner;
  corner << -1, 1, 0, 0, -1, 0, 1, 0, -1, 0, 0, 1;
  std::array<Gradients, std::size_t(points)> by_xi;
  for (std::size_t q = 0; q < std::size_t(points); ++q) {
    std::tie(linear_[q], point_weight_[q]) = tet_point(int(q));
    const auto& l = linear_[q];
    for (std::size_t k = 0; k < 4; ++k)
      by_xi[q].col(Eigen::Index(k)) = (4.0 * l[k] - 1.0) * corner.col(Eigen::Index(k));
    for (std::size_t k = 0; k < 6; ++k)
      by_xi[q].col(Eigen::Index(4 + k)) = 4.0 * (l[ends[k][1]] * corner.col(Eigen::Index(ends[k][0])) +
                                                    l[ends[k][0]] * corner.col(Eigen::Index(ends[k][1])));
  }
  for (const auto& t : mesh_.tets)
    for (std::size_t q = 0; q < std::size_t(points); ++q) {
      Mat3d jacobian = Mat3d::Zero();
      for (int a = 0; a < 10; ++a)
        jacobian += mesh_.nodes[std::size_t(t[std::size_t(a)])] * by_xi[q].col(a).transpose();
      gradient_.push_back(jacobian.inverse().transpose() * by_xi[q]);
      weight_.push_back(point_weight_[q] / 6.0 * jacobian.determinant());
    }
}

inline void TaylorHood::set_up_faces() {
  std::size_t at = 0;
  for (int i = 0; i < splits; ++i)
    for (int j = 0; j < splits; ++j)
      for (int q = 0; q < 3; ++q, ++at) {
        // Cells of the (u, v) square beyond the diagonal are turned by half about its middle: they are the downward
        // triangles.
        const bool folded = i + j >= splits;
        double u = (i + (q == 1 ? 2.0 / 3.0 : 1.0 / 6.0)) / splits, v = (j + (q == 2 ? 2.0 / 3.0 : 1.0 / 6.0)) / splits;
        if (folded) {
          u = 1.0 - u;
          v = 1.0 - v;
        }
        shape_[at] = {(1 - u - v) * (1 - 2 * u - 2 * v), u * (2 * u - 1), v * (2 * v - 1), 4 * u * (1 - u - v),
            4 * u * v, 4 * v * (1 - u - v)};
        const double w = 1 - u - v;
        slope_[at] = {{{1 - 4 * w, 1 - 4 * w}, {4 * u - 1, 0}, {0, 4 * v - 1}, {4 * (w - u), -4 * u}, {4 * v, 4 * u},
            {-4 * v, 4 * (w - v)}}};
      }
}

inline void TaylorHood::set_up_boundary(const Body& body, Symmetry planes) {
  std::vector<BoundaryFace> outer, inner;
  for (const BoundaryFace& f : mesh_.faces) {
    const Patch& patch = body.patches[std::size_t(f.patch)];
    if (patch.contactable) outer.push_back(f);
    if (patch.meets_carrier) inner.push_back(f);
    if (patch.bonded)
      for (int n : f.nodes)
        for (int axis = 0; axis < 3; ++axis) fix(n, axis);
  }
  surfaces_ = {surface(outer), surface(inner)};
  for (std::size_t side = 0; side < 2; ++side) contacts_[side].resize(surfaces_[side].area.size());
  for (std::size_t k = 0; k < mesh_.nodes.size(); ++k) {
    if (planes.x && mesh_.nodes[k].x() == 0.0) fix(int(k), 0);
    if (planes.y && mesh_.nodes[k].y() == 0.0) fix(int(k), 1);
  }
}

inline TaylorHood::Surface TaylorHood::surface(const std::vector<BoundaryFace>& faces) const {
  Surface s{faces, {}};
  for (const BoundaryFace& f : faces)
    for (std::size_t k = 0; k < std::size_t(face_points); ++k) {
      Vec3d by_u = Vec3d::Zero(), by_v = Vec3d::Zero();
      for (std::size_t a = 0; a < 6; ++a) {
        by_u += slope_[k][a][0] * mesh_.nodes[std::size_t(f.nodes[a])];
        by_v += slope_[k][a][1] * mesh_.nodes[std::size_t(f.nodes[a])];
      }
      s.area.push_back(by_u.cross(by_v).norm() / (2.0 * face_points));
    }
  return s;
}

inline void TaylorHood::number() {
  equation_.assign(3 * mesh_.nodes.size(), 0);
  for (int f : fixed_) equation_[std::size_t(f)] = -1;
  count_ = 0;
  for (int& e : equation_)
    if (e == 0) e = count_++;
  pressure_equation_.assign(mesh_.nodes.size(), -1);
  pressures_ = 0;
  for (const auto& t : mesh_.tets)
    for (std::size_t k = 0; k < 4; ++k)
      if (int& e = pressure_equation_[std::size_t(t[k])]; e < 0) e = count_ + pressures_++;
  count_ += pressures_;

  const auto of = [&](std::size_t e, int k) {
    return k < displacements ? equation_[std::size_t(3 * mesh_.tets[e][std::size_t(k / 3)] + k % 3)]
                             : pressure_equation_[std::size_t(mesh_.tets[e][std::size_t(k - displacements)])];
  };
  std::vector<std::vector<int>> pattern(static_cast<std::size_t>(count_));
  for (std::size_t e = 0; e < mesh_.tets.size(); ++e)
    for (int j = 0; j < unknowns; ++j)
      for (int i = j; i < unknowns; ++i)
        if (const int a = of(e, i), b = of(e, j); a >= 0 && b >= 0)
          pattern[std::size_t(std::min(a, b))].push_back(std::max(a, b));
  matrix_.resize(count_, count_);
  Eigen::VectorXi filled(count_);
  for (int c = 0; c < count_; ++c) {
    auto& column = pattern[std::size_t(c)];
    std::sort(column.begin(), column.end());
    column.erase(std::unique(column.begin(), column.end()), column.end());
    filled[c] = int(column.size());
  }
  matrix_.reserve(filled);
  for (int c = 0; c < count_; ++c)
    for (int r : pattern[std::size_t(c)]) matrix_.insert(r, c) = 0.0;
  matrix_.makeCompressed();
  slot_.clear();
  for (std::size_t e = 0; e < mesh_.tets.size(); ++e)
    for (int j = 0; j < unknowns; ++j)
      for (int i = j; i < unknowns; ++i) {
        const auto [c, r] = std::minmax({of(e, i), of(e, j)});
        int slot = -1;
        if (c >= 0) {
          const int* list = matrix_.innerIndexPtr();
          slot =
              int(std::lower_bound(list + matrix_.outerIndexPtr()[c], list + matrix_.outerIndexPtr()[c + 1], r) - list);
        }
        slot_.push_back(slot);
      }
  factor_.analyze(matrix_);
}

inline void TaylorHood::start(const Sphere& sphere, const Vec3d& origin, const Vec3d& direction) {
  sphere_ = sphere;
  origin_ = origin;
  direction_ = direction;
  for (auto& side : contacts_) std::fill(side.begin(), side.end(), Touching{});
}

inline TaylorHood::Place TaylorHood::rest() const {
  Place at{Points(3, Eigen::Index(mesh_.nodes.size())), Eigen::VectorXd::Zero(Eigen::Index(mesh_.nodes.size())), 0.0};
  for (std::size_t k = 0; k < mesh_.nodes.size(); ++k) at.x.col(Eigen::Index(k)) = mesh_.nodes[k];
  return at;
}

inline double TaylorHood::smallest_J(const Points& x) const {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t e = 0; e < mesh_.tets.size(); ++e) {
    const auto l = local(e, x);
    for (int q = 0; q < points; ++q) least = std::min(least, Mat3d(l * gradient(e, q).transpose()).determinant());
  }
  return least;
}

inline void TaylorHood::add_elements(const Place& at, Eigen::VectorXd& r, bool with_matrix) {
  const double mu = constants_.mu, inverse_lambda = 1.0 / constants_.lambda;
  Eigen::Matrix<double, displacements, points> H, weighted;
  Eigen::Matrix<double, displacements, displacements> outer;
  Eigen::Matrix<double, 10, 10> laplacian;
  Eigen::Matrix<double, 4, displacements> divergence;
  Eigen::Matrix4d mass;
  for (std::size_t e = 0; e < mesh_.tets.size(); ++e) {
    const auto& t = mesh_.tets[e];
    const auto l = local(e, at.x);
    Eigen::Matrix<double, 3, 10> force = Eigen::Matrix<double, 3, 10>::Zero();
    Eigen::Vector4d volume = Eigen::Vector4d::Zero();
    laplacian.setZero();
    divergence.setZero();
    mass.setZero();
    for (int q = 0; q < points; ++q) {
      const double w = weight(e, q);
      const Gradients& g = gradient(e, q);
      const Mat3d F = l * g.transpose();
      const double J = F.determinant();
      const Mat3d inverse = F.inverse();
      const Eigen::Map<const Eigen::Vector4d> shape(linear_[std::size_t(q)].data());
      double p = 0.0;
      for (int k = 0; k < 4; ++k) p += shape[k] * at.p[t[std::size_t(k)]];
      const Gradients h = inverse.transpose() * g;  // gradients by the deformed position
      force += w * (mu * F * g + (p - mu) * h);
      volume += w * (std::log(J) - p * inverse_lambda) * shape;
      if (!with_matrix) continue;
      const Eigen::Map<const Eigen::Matrix<double, displacements, 1>> flat(h.data());
      H.col(q) = flat;
      weighted.col(q) = w * (mu - p) * flat;
      laplacian.noalias() += (w * mu) * g.transpose() * g;
      divergence.noalias() += w * shape * flat.transpose();
      mass.noalias() += (w * inverse_lambda) * shape * shape.transpose();
    }
    for (int a = 0; a < 10; ++a)
      for (int i = 0; i < 3; ++i)
        if (const int row = equation_[std::size_t(3 * t[std::size_t(a)] + i)]; row >= 0) r[row] += force(i, a);
    for (int k = 0; k < 4; ++k) r[pressure_equation_[std::size_t(t[std::size_t(k)])]] += volume[k];
    if (!with_matrix) continue;
    outer.noalias() = weighted * H.transpose();
    const int* slot = slot_.data() + e * (unknowns * (unknowns + 1) / 2);
    double* values = matrix_.valuePtr();
    for (int j = 0; j < unknowns; ++j)
      for (int i = j; i < unknowns; ++i, ++slot) {
        if (*slot < 0) continue;
        if (i >= displacements) {
          values[*slot] +=
              j >= displacements ? -mass(i - displacements, j - displacements) : divergence(i - displacements, j);
        } else {
          // ∂P/∂F : (e_j ⊗ g_b) · (e_i ⊗ g_a) = μ g_a·g_b δ_ij + (μ − p) h_b,i h_a,j
          const int a = i / 3, m = i % 3, b = j / 3, n = j % 3;
          values[*slot] += outer(3 * a + n, 3 * b + m) + (m == n ? laplacian(a, b) : 0.0);
        }
      }
  }
}

template <class Visit> void TaylorHood::near(std::size_t side, const Place& at, Visit&& visit) const {
  for (std::size_t f = 0; f < surfaces_[side].faces.size(); ++f) {
    const auto& n = surfaces_[side].faces[f].nodes;
    const Vec3d a = at.x.col(n[0]), b = at.x.col(n[1]), c = at.x.col(n[2]), middle = (a + b + c) / 3.0;
    double reach = std::max({(a - middle).norm(), (b - middle).norm(), (c - middle).norm()});
    for (std::size_t k = 0; k < 3; ++k)
      reach = std::max(
          reach, (2.0 * at.x.col(n[3 + k]) - 0.5 * at.x.col(n[k]) - 0.5 * at.x.col(n[(k + 1) % 3]) - middle).norm());
    const bool far = side == 0 ? sphere_.distance(middle - origin_ - at.advance * direction_) > reach
                               : over_boxes(carrier_, middle).distance > reach;
    if (far) continue;
    for (std::size_t k = 0; k < std::size_t(face_points); ++k) visit(f, k, position(surfaces_[side].faces[f], k, at.x));
  }
}

inline void TaylorHood::add_contact(
    std::size_t side, const Place& at, const Contacts* seen, Eigen::VectorXd& r, bool with_matrix) {
  const double stiffness = constants_.penalty;
  const Surface& s = surfaces_[side];
  Eigen::Matrix<double, 18, 18> K;
  Eigen::Matrix<double, 18, 1> force, toward;
  std::size_t open = std::size_t(-1);
  const auto flush = [&] {
    if (open == std::size_t(-1)) return;
    const auto& n = s.faces[open].nodes;
    for (int i = 0; i < 18; ++i) {
      const int row = equation_[std::size_t(3 * n[std::size_t(i / 3)] + i % 3)];
      if (row < 0) continue;
      r[row] += force[i];
      if (!with_matrix) continue;
      if (side == 0) coupling_[row] += toward[i];
      for (int j = 0; j < 18; ++j)
        if (const int column = equation_[std::size_t(3 * n[std::size_t(j / 3)] + j % 3)]; column >= 0 && column <= row)
          add(row, column, K(i, j));
    }
  };
  const auto visit = [&](std::size_t f, std::size_t k, const Vec3d& x) {
    const std::size_t id = f * face_points + k;
    const double gap = distance(side, x, at.advance);
    if (side == 0) overlap_ = std::max(overlap_, -gap);
    if (seen ? !(*seen)[side][id].active : gap >= 0.0) return;
    if (f != open) {
      flush();
      open = f;
      K.setZero();
      force.setZero();
      toward.setZero();
    }
    const DistanceSample d = sample(side, x, at.advance);
    const double area = s.area[id];
    const Vec3d pull = area * stiffness * gap * d.gradient;  // ∂energy/∂x
    if (side == 0) push_ -= pull.dot(direction_);
    for (int a = 0; a < 6; ++a) force.segment<3>(3 * a) += shape_[k][std::size_t(a)] * pull;
    if (!with_matrix) return;
    const double pressure = seen ? (*seen)[side][id].pressure : -stiffness * gap;
    Mat3d block = area * stiffness * d.gradient * d.gradient.transpose();
    if (side == 0 || !flat_) block -= area * pressure * d.hessian;
    if (side == 0) push_stiffness_ += direction_.dot(block * direction_);
    const Vec3d along = block * direction_;
    for (int a = 0; a < 6; ++a) {
      toward.segment<3>(3 * a) -= shape_[k][std::size_t(a)] * along;
      for (int b = 0; b < 6; ++b)
        K.block<3, 3>(3 * a, 3 * b) += shape_[k][std::size_t(a)] * shape_[k][std::size_t(b)] * block;
    }
  };
  if (seen) {  // points that take part may have moved far off
    for (std::size_t f = 0; f < s.faces.size(); ++f)
      for (std::size_t k = 0; k < std::size_t(face_points); ++k)
        if ((*seen)[side][f * face_points + k].active) visit(f, k, position(s.faces[f], k, at.x));
  } else {
    near(side, at, visit);
  }
  flush();
}

inline Eigen::VectorXd TaylorHood::residual(const Place& at, const Contacts* seen, bool with_matrix) {
  Eigen::VectorXd r = Eigen::VectorXd::Zero(count_);
  push_ = push_stiffness_ = overlap_ = 0.0;
  if (with_matrix) {
    std::fill_n(matrix_.valuePtr(), matrix_.nonZeros(), 0.0);
    coupling_ = Eigen::VectorXd::Zero(count_);
  }
  add_elements(at, r, with_matrix);
  for (std::size_t side = 0; side < 2; ++side) add_contact(side, at, seen, r, with_matrix);
  return r;
}

inline void TaylorHood::join_overlapping(const Place& at) {
  for (std::size_t side = 0; side < 2; ++side)
    near(side, at, [&](std::size_t f, std::size_t k, const Vec3d& x) {
      const std::size_t id = f * face_points + k;
      Touching& t = contacts_[side][id];
      if (!t.active && distance(side, x, at.advance) < 0.0) t = {0.0, true};
    });
}

inline void TaylorHood::advance_to_load(Place& at, double load) {
  for (at.advance = 1e-9; at.advance < 0.2 * sphere_.radius_m(); at.advance *= 1.5) {
    residual(at, nullptr, false);
    if (push_ >= load) break;
  }
  join_overlapping(at);
}

inline std::optional<TaylorHood::Step> TaylorHood::newton_step(const Place& at, double load, Equilibrium& out) {
  flat_ = out.residual_N > settled * load || !out.stable;
  const Eigen::VectorXd r = residual(at, &contacts_, true);
  const double push = push_ - load, push_stiffness = push_stiffness_;
  const int negative = factor_.factorize(matrix_);
  ++out.factors;
  if (negative < 0) return std::nullopt;
  out.stable = negative == pressures_;
  const Eigen::VectorXd z = factor_.solve(r), response = factor_.solve(coupling_);
  const double schur = push_stiffness - coupling_.dot(response);
  out.stable = out.stable && schur > 0.0;
  const double ds = (-push + coupling_.dot(z)) / schur;
  const Eigen::VectorXd du = -z - response * ds;
  if (!du.allFinite() || !std::isfinite(ds)) return std::nullopt;

  Step step{Points::Zero(3, at.x.cols()), Eigen::VectorXd::Zero(at.p.size()), ds};
  for (std::size_t k = 0; k < equation_.size(); ++k)
    if (equation_[k] >= 0) step.x.data()[k] = du[equation_[k]];
  for (std::size_t k = 0; k < pressure_equation_.size(); ++k)
    if (pressure_equation_[k] >= 0) step.p[Eigen::Index(k)] = du[pressure_equation_[k]];
  return step;
}

inline void TaylorHood::take(const Step& step, double t, Place& at) {
  for (std::size_t side = 0; side < 2; ++side)
    for (std::size_t f = 0; f < surfaces_[side].faces.size(); ++f)
      for (std::size_t k = 0; k < std::size_t(face_points); ++k) {
        const std::size_t id = f * face_points + k;
        Touching& c = contacts_[side][id];
        if (!c.active) continue;
        const BoundaryFace& face = surfaces_[side].faces[f];
        const DistanceSample d = sample(side, position(face, k, at.x), at.advance);
        const double moved = d.gradient.dot(position(face, k, step.x) - (side == 0 ? step.advance : 0.0) * direction_);
        c.pressure += t * (-constants_.penalty * (d.distance + moved) - c.pressure);
        if (c.pressure <= 0.0) c = {};
      }
  at.x += t * step.x;
  at.p += t * step.p;
  at.advance += t * step.advance;
}

inline Equilibrium TaylorHood::solve(Place& at, double load, double tolerance) {
  Equilibrium out;
  const int solid = count_ - pressures_;
  if (at.advance == 0.0) advance_to_load(at, load);
  double last_step = 1.0;
  for (int iteration = 0; iteration < 100; ++iteration) {
    const Eigen::VectorXd plain = residual(at, nullptr, false);
    out.residual_N = std::hypot(plain.head(solid).norm(), push_ - load);
    out.overlap_m = overlap_;
    if (!std::isfinite(out.residual_N)) return out;
    if (out.residual_N <= tolerance * load && (tolerance > 1e-4 || last_step < 1e-8)) {
      out.converged = true;
      break;
    }
    const std::optional<Step> step = newton_step(at, load, out);
    if (!step) return out;
    const double now = smallest_J(at.x);
    double t = std::min(1.0, 0.2 * sphere_.radius_m() / std::max(std::abs(step->advance), 1e-300));
    for (int k = 0; k < 20 && !(smallest_J(at.x + t * step->x) > 0.2 * now); ++k) t *= 0.5;
    take(*step, t, at);
    last_step = std::max(step->x.cwiseAbs().maxCoeff(), std::abs(step->advance));
    join_overlapping(at);
  }
  return out;
}

inline std::vector<Equilibrium> TaylorHood::press(
    const Sphere& sphere, const Vec3d& origin, const Vec3d& direction, const std::vector<double>& loads, double share) {
  start(sphere, origin, direction);
  Place at = rest();
  std::vector<Equilibrium> states;
  double last = 0.0;
  for (double load : loads) {
    int factors = 0;
    bool lost = false;
    for (double f = last > 0.0 ? 4.0 * last : load / 16.0; f < 0.99 * load && !lost; f *= 4.0) {
      const Equilibrium way = solve(at, share * f, 0.03);
      factors += way.factors;
      lost = !way.converged;
    }
    Equilibrium e = solve(at, share * load, 1e-8);
    if (e.converged) {  // the tangent of the state itself
      flat_ = false;
      residual(at, nullptr, true);
      const int negative = factor_.factorize(matrix_);
      e.stable = negative == pressures_ && push_stiffness_ - coupling_.dot(factor_.solve(coupling_)) > 0.0;
    }
    e.factors += factors + 1;
    e.load_N = load;
    e.depth_m = at.advance;
    for (std::size_t k = 0; k < mesh_.nodes.size(); ++k) {
      e.displacement.push_back(at.x.col(Eigen::Index(k)) - mesh_.nodes[k]);
      e.pressure_Pa.push_back(
          pressure_equation_[k] >= 0 ? at.p[Eigen::Index(k)] : std::numeric_limits<double>::quiet_NaN());
    }
    states.push_back(std::move(e));
    if (!states.back().converged) break;
    last = load;
  }
  return states;
}

}  // namespace lumo::reference
