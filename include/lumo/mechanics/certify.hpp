#pragma once

#include "lumo/mechanics/contact/carrier.hpp"
#include "lumo/mechanics/contact/contact_surface.hpp"
#include "lumo/mechanics/contact/friction.hpp"
#include "lumo/mechanics/solvers/press_solver.hpp"

#include <array>
#include <cmath>
#include <utility>

namespace lumo {

/// A state whose balance is to be found.
struct PressedState {
  double load_N;                           ///< on the indenter
  const std::vector<Vec3d>& displacement;  ///< per mesh node [m]
  FrictionForces friction = {};            ///< depends on the way that was taken, and is given
};

/// Norm of the out-of-balance forces on the free components of the whole body and on the indenter [N], by a routine
/// that shares no assembly with the solver: the virtual work of each node's shape function, point by point, on the
/// whole mesh, without sectors, equations or linearised volumes and gaps. It does share the policies (the material's
/// stresses, the element's points and shape functions, the contact's response) and the points and weights of
/// ContactSurface: a fault in one of these is found only by the policies' own tests.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, Indenter Tool>
double out_of_balance(const Body& body, const TetMesh& mesh, const PressPhysics<Material, Contact, Element>& physics,
    const Moving<Tool>& indenter, const PressedState& state);

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

// Adds the internal forces of all tetrahedra.
template <class Material, class Element> void add_internal_forces(const TetMesh& mesh, const Material& material,
    const Element& element, const std::vector<Vec3d>& displacement, std::vector<Vec3d>& force) {
  constexpr std::size_t points = std::size_t(Element::points);
  for (const auto& t : mesh.tets) {
    std::array<Eigen::Matrix<double, 3, Element::nodes>, points> slope;
    std::array<Mat3d, points> F;
    std::array<double, points> volume;
    double whole = 0.0, changed = 0.0;
    for (std::size_t q = 0; q < points; ++q) {
      const auto by_xi = Element::gradients(int(q));
      Mat3d reference = Mat3d::Zero();
      for (int a = 0; a < Element::nodes; ++a)
        reference += mesh.nodes[std::size_t(t[std::size_t(a)])] * Vec3d(by_xi.col(a)).transpose();
      slope[q] = solved_transposed(reference, by_xi);
      F[q] = Mat3d::Identity();
      for (int a = 0; a < Element::nodes; ++a)
        F[q] += displacement[std::size_t(t[std::size_t(a)])] * Vec3d(slope[q].col(a)).transpose();
      volume[q] = Element::weight(int(q)) * reference.determinant();
      whole += volume[q];
      changed += volume[q] * F[q].determinant();
    }
    for (std::size_t q = 0; q < points; ++q) {
      const double J = F[q].determinant();
      const double ratio = element.mean_dilatation ? changed / whole : J;
      const Mat3d P = material.distortion_stress(F[q]) +
                      material.volumetric(ratio).stress * J * solved_transposed(F[q], Mat3d(Mat3d::Identity()));
      for (int a = 0; a < Element::nodes; ++a)
        force[std::size_t(t[std::size_t(a)])] += volume[q] * (P * Vec3d(slope[q].col(a)));
    }
  }
}

// Takes the contact pressure off the nodes' forces, and adds it to the push on an indenter.
template <class Contact, class Tool> void add_pressure(const ContactSurface& surface, const Contact& contact,
    const Moving<Tool>& rigid, const Positions& x, std::vector<Vec3d>& force, double* push) {
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (const SurfacePoint& p : surface.points(f)) {
      const DistanceSample d = rigid.sample(surface.position(f, p, x));
      const Vec3d traction = contact.respond(d.distance).pressure * d.gradient;
      if (push) *push += p.weight_m2 * traction.dot(rigid.direction);
      for (std::size_t k = 0; k < std::size_t(surface.nodes_per_face()); ++k)
        force[std::size_t(surface.face(f).nodes[k])] -= p.weight_m2 * p.shape[k] * traction;
    }
}

}  // namespace detail

template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, Indenter Tool>
double out_of_balance(const Body& body, const TetMesh& mesh, const PressPhysics<Material, Contact, Element>& physics,
    const Moving<Tool>& indenter, const PressedState& state) {
  std::vector<Vec3d> force(mesh.nodes.size(), Vec3d::Zero());
  detail::add_internal_forces(mesh, physics.material, physics.element, state.displacement, force);
  Positions x(3, Eigen::Index(mesh.nodes.size()));
  for (std::size_t k = 0; k < mesh.nodes.size(); ++k) x.col(Eigen::Index(k)) = mesh.nodes[k] + state.displacement[k];
  double push = state.friction.push_N;
  for (std::size_t k = 0; k < state.friction.on_nodes.size(); ++k) force[k] -= state.friction.on_nodes[k];
  const Carrier carrier{body.carrier};
  const auto surface = [&](auto chosen) { return ContactSurface(mesh, body, chosen, physics.contact); };
  detail::add_pressure(
      surface([](const Patch& p) { return p.contactable; }), physics.contact, indenter, x, force, &push);
  detail::add_pressure(surface([](const Patch& p) { return p.meets_carrier; }), physics.contact,
      Moving<Carrier>{&carrier, Vec3d::Zero(), indenter.direction}, x, force, nullptr);
  for (const BoundaryFace& f : mesh.faces)
    if (body.patches[std::size_t(f.patch)].bonded)
      for (int k = 0; k < mesh.nodes_per_face(); ++k) force[std::size_t(f.nodes[std::size_t(k)])].setZero();
  double sum = (push - state.load_N) * (push - state.load_N);
  for (const Vec3d& f : force) sum += f.squaredNorm();
  return std::sqrt(sum);
}

}  // namespace lumo
