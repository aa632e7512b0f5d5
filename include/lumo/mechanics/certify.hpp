#pragma once

#include "lumo/mechanics/contact/contact_set.hpp"
#include "lumo/mechanics/contact/friction.hpp"
#include "lumo/mechanics/contact/state.hpp"
#include "lumo/mechanics/solvers/press_system.hpp"

#include <array>
#include <cmath>
#include <utility>

namespace lumo {

namespace detail {

// x of Aᵀ x = b by Gauss's elimination with the largest pivots, operation for operation as Eigen's PartialPivLU has it,
// which takes the compiler as long as a tenth of a program with a simulator.
template <class Columns> Columns solved_transposed(const Mat3d& A, Columns b) {
  std::array<std::array<double, 3>, 3> a;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) a[i][j] = A(Eigen::Index(j), Eigen::Index(i));
  for (std::size_t k = 0; k < 3; ++k) {
    std::size_t pivot = k;
    for (std::size_t i = k + 1; i < 3; ++i)
      if (std::abs(a[i][k]) > std::abs(a[pivot][k])) pivot = i;
    if (pivot != k) {
      std::swap(a[k], a[pivot]);
      for (Eigen::Index c = 0; c < b.cols(); ++c) std::swap(b(Eigen::Index(k), c), b(Eigen::Index(pivot), c));
    }
    for (std::size_t i = k + 1; i < 3; ++i) {
      if (a[k][k] != 0.0) a[i][k] /= a[k][k];
      for (std::size_t j = k + 1; j < 3; ++j) a[i][j] -= a[i][k] * a[k][j];
    }
  }
  for (Eigen::Index c = 0; c < b.cols(); ++c) {
    const auto rest = [&](std::size_t k, std::size_t from, std::size_t to) {
      double sum = 0.0;
      for (std::size_t i = from; i < to; ++i) sum += a[k][i] * b(Eigen::Index(i), c);
      return b(Eigen::Index(k), c) - sum;
    };
    for (std::size_t k = 1; k < 3; ++k) b(Eigen::Index(k), c) = rest(k, 0, k);
    for (std::size_t k = 3; k-- > 0;) b(Eigen::Index(k), c) = rest(k, k + 1, 3) * (1.0 / a[k][k]);
  }
  return b;
}

}  // namespace detail

/// Norm of the out-of-balance forces on the free components of the whole body and on the indenter [N], by a routine
/// that shares no assembly with the solver: the virtual work of each node's shape function, point by point, on the
/// whole mesh, without sectors, equations or linearised volumes and gaps. It does share the policies (the material's
/// stresses, the element's points and shape functions, the contact's response) and the points and weights of
/// ContactSurface: a fault in one of these is not found here but by the policies' own tests. Friction depends on the
/// way that was taken and is given.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, Indenter Tool>
double out_of_balance(const Body& body, const TetMesh& mesh, const Material& material, const Contact& contact,
                      const Element& element, const Tool& tool, const Vec3d& origin, const Vec3d& direction,
                      double load_N, const std::vector<Vec3d>& displacement, const FrictionForces& friction = {}) {
  std::vector<Vec3d> force(mesh.nodes.size(), Vec3d::Zero());
  for (const auto& t : mesh.tets) {
    std::array<Eigen::Matrix<double, 3, Element::nodes>, std::size_t(Element::points)> slope;
    std::array<Mat3d, std::size_t(Element::points)> F;
    std::array<double, std::size_t(Element::points)> volume;
    double whole = 0.0, changed = 0.0;
    for (std::size_t q = 0; q < std::size_t(Element::points); ++q) {
      const auto by_xi = Element::gradients(int(q));
      Mat3d reference = Mat3d::Zero();
      for (int a = 0; a < Element::nodes; ++a)
        reference += mesh.nodes[std::size_t(t[std::size_t(a)])] * Vec3d(by_xi.col(a)).transpose();
      slope[q] = detail::solved_transposed(reference, by_xi);
      F[q] = Mat3d::Identity();
      for (int a = 0; a < Element::nodes; ++a)
        F[q] += displacement[std::size_t(t[std::size_t(a)])] * Vec3d(slope[q].col(a)).transpose();
      volume[q] = Element::weight(int(q)) * reference.determinant();
      whole += volume[q];
      changed += volume[q] * F[q].determinant();
    }
    for (std::size_t q = 0; q < std::size_t(Element::points); ++q) {
      const double J = F[q].determinant();
      const double seen = element.mean_dilatation ? changed / whole : J;
      const Mat3d P = material.distortion_stress(F[q]) +
                      material.volumetric(seen).stress * J * detail::solved_transposed(F[q], Mat3d(Mat3d::Identity()));
      for (int a = 0; a < Element::nodes; ++a)
        force[std::size_t(t[std::size_t(a)])] += volume[q] * (P * Vec3d(slope[q].col(a)));
    }
  }
  Positions x(3, Eigen::Index(mesh.nodes.size()));
  for (std::size_t k = 0; k < mesh.nodes.size(); ++k) x.col(Eigen::Index(k)) = mesh.nodes[k] + displacement[k];
  const Carrier carrier{body.carrier};
  double push = friction.push_N;
  for (std::size_t k = 0; k < friction.on_nodes.size(); ++k) force[k] -= friction.on_nodes[k];
  const auto press = [&](const ContactSurface& surface, const auto& rigid, bool is_indenter) {
    for (std::size_t f = 0; f < surface.size(); ++f)
      for (const SurfacePoint& p : surface.points(f)) {
        const DistanceSample d = rigid.sample(surface.position(f, p, x));
        const Vec3d traction = contact.respond(d.distance).pressure * d.gradient;
        if (is_indenter) push += p.weight_m2 * traction.dot(direction);
        for (std::size_t k = 0; k < std::size_t(mesh.nodes_per_face()); ++k)
          force[std::size_t(surface.face(f).nodes[k])] -= p.weight_m2 * p.shape[k] * traction;
      }
  };
  press(ContactSurface(
            mesh, body, [](const Patch& p) { return p.contactable; }, contact),
        Moving<Tool>{&tool, origin, direction}, true);
  press(ContactSurface(
            mesh, body, [](const Patch& p) { return p.meets_carrier; }, contact),
        Moving<Carrier>{&carrier, Vec3d::Zero(), direction}, false);
  for (const BoundaryFace& f : mesh.faces)
    if (body.patches[std::size_t(f.patch)].bonded)
      for (int k = 0; k < mesh.nodes_per_face(); ++k) force[std::size_t(f.nodes[std::size_t(k)])].setZero();
  double sum = (push - load_N) * (push - load_N);
  for (const Vec3d& f : force) sum += f.squaredNorm();
  return std::sqrt(sum);
}

}  // namespace lumo
