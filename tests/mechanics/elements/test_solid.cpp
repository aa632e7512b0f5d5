#include "catch.hpp"
#include "lumo/mechanics/elements/element.hpp"
#include "lumo/mechanics/elements/solid.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/materials/stable_neo_hookean.hpp"
#include "lumo/mechanics/solvers/press_system.hpp"
#include "mechanics/bodies.hpp"
#include "mechanics/dual.hpp"

#include <Eigen/Dense>

using namespace lumo;

static_assert(!TetElement<int>);

namespace {

const NeoHookean kMaterial{.mu = 1e5, .lambda = 9.9e6};

// A law as a user may write it, of which nothing is known but what the concept asks for.
template <class Law> struct Opaque {
  Law law;
  double shear_modulus() const { return law.shear_modulus(); }
  double distortion_energy(const Mat3d& F) const { return law.distortion_energy(F); }
  Mat3d distortion_stress(const Mat3d& F) const { return law.distortion_stress(F); }
  Mat9d distortion_tangent(const Mat3d& F) const { return law.distortion_tangent(F); }
  VolumetricSample<double> volumetric(double J) const { return law.volumetric(J); }
};
template <class Law> void validate(const Opaque<Law>& m) { validate(m.law); }

}  // namespace

TEMPLATE_TEST_CASE("shape functions of an element sum to one and reproduce linear fields", "", QuadraticTet, LinearTet,
    LinearPatchTet) {
  // Corners, then the middles of edges.
  Eigen::Matrix<double, 3, 10> place;
  place << 0, 1, 0, 0, 0.5, 0.5, 0, 0, 0.5, 0,  //
      0, 0, 1, 0, 0, 0.5, 0.5, 0, 0, 0.5,       //
      0, 0, 0, 1, 0, 0, 0, 0.5, 0.5, 0.5;
  double volume = 0.0, mass = 0.0;
  for (int q = 0; q < TestType::points; ++q) {
    volume += TestType::weight(q);
    const auto g = TestType::gradients(q);
    CHECK(g.rowwise().sum().norm() < 1e-14);
    CHECK((g * place.leftCols(TestType::nodes).transpose() - Mat3d::Identity()).norm() < 1e-14);
  }
  CHECK(volume == Approx(1.0 / 6.0).epsilon(1e-14));
  for (int a = 0; a < TestType::nodes; ++a) mass += TestType::mass_share(a);
  CHECK(mass == Approx(1.0).epsilon(1e-14));
}

TEST_CASE("gradients of the shape functions are what dual numbers find") {
  using test::Dual;
  const Vec3d xi(0.2, 0.3, 0.1);
  for (int i = 0; i < 3; ++i) {
    const Vec3<Dual> at = test::by_entry(xi, i);
    const std::array<Dual, 4> l = {1.0 - at.sum(), at.x(), at.y(), at.z()};
    for (int k = 0; k < 10; ++k) {  // corners, then the middles of edges
      const std::size_t a = std::size_t(k < 4 ? k : tet_edges[k - 4][0]),
                        b = std::size_t(k < 4 ? k : tet_edges[k - 4][1]);
      const Dual quadratic = k < 4 ? l[a] * (2.0 * l[a] - 1.0) : 4.0 * l[a] * l[b];
      CHECK(shape_gradients<10>(xi)(i, k) == Approx(quadratic.slope).margin(1e-14));
      if (k < 4) CHECK(shape_gradients<4>(xi)(i, k) == l[a].slope);
    }
  }
  for (const int order : {1, 2}) {
    const auto slopes = face_shape_derivatives(0.2, 0.3, order);
    const auto by_u = face_shape(Dual(0.2, 1.0), Dual(0.3), order), by_v = face_shape(Dual(0.2), Dual(0.3, 1.0), order);
    for (std::size_t k = 0; k < 6; ++k) {
      CHECK(slopes[k][0] == Approx(by_u[k].slope).margin(1e-14));
      CHECK(slopes[k][1] == Approx(by_v[k].slope).margin(1e-14));
    }
  }
}

TEST_CASE("a patch of linear tetrahedra without the cure is those tetrahedra") {
  const TetMesh patches = test::small_mesh<LinearPatchTet>();
  TetMesh parts;
  parts.order = 1;
  parts.nodes = patches.nodes;
  for (const auto& t : patches.tets)
    for (const auto& part : LinearPatchTet::parts) {
      parts.tets.emplace_back();
      for (std::size_t k = 0; k < 4; ++k) parts.tets.back()[k] = t[std::size_t(part[k])];
    }
  const Solid<NeoHookean, LinearPatchTet> patched(patches, kMaterial, {false});
  const Solid<NeoHookean, LinearTet> split(parts, kMaterial, {});
  CHECK(split.smallest_volume() > 0.0);
  Positions x = positions_of(patches);
  for (Eigen::Index k = 0; k < x.cols(); ++k) x.col(k) += test::wavy(x.col(k), 8e-3);
  Positions f = Positions::Zero(3, x.cols()), g = f;
  patched.add_forces(x, f);
  split.add_forces(x, g);
  CHECK(patched.energy(x) == Approx(split.energy(x)).epsilon(1e-12));
  CHECK((f - g).norm() < 1e-12 * g.norm());
  const auto mass = lumped_masses<LinearPatchTet>(patches, 1000.0), separate = lumped_masses<LinearTet>(parts, 1000.0);
  for (std::size_t k = 0; k < mass.size(); ++k) CHECK(mass[k] == Approx(separate[k]).epsilon(1e-12));
}

TEMPLATE_TEST_CASE("patch test: an affine field has the exact stress everywhere and no force on free interior nodes",
    "", QuadraticTet, LinearTet, LinearPatchTet) {
  const TetMesh mesh = test::small_mesh<TestType>();
  const Solid<NeoHookean, TestType> solid(mesh, kMaterial, TestType{});
  Mat3d F;
  F << 1.1, 0.05, -0.02, 0.03, 0.97, 0.04, -0.01, 0.06, 0.95;
  Positions x = positions_of(mesh);
  for (Eigen::Index k = 0; k < x.cols(); ++k) x.col(k) = F * x.col(k);
  CHECK(solid.energy(x) == Approx(test::small_size.prod() * energy_density(kMaterial, F)).epsilon(1e-12));
  Positions f = Positions::Zero(3, x.cols());
  solid.add_forces(x, f);
  std::vector<char> boundary(mesh.nodes.size(), 0);
  for (const auto& face : mesh.faces)
    for (int k = 0; k < mesh.nodes_per_face(); ++k) boundary[std::size_t(face.nodes[std::size_t(k)])] = 1;
  const double scale = f.colwise().norm().maxCoeff();
  int interior = 0;
  for (std::size_t k = 0; k < mesh.nodes.size(); ++k)
    if (!boundary[k]) {
      ++interior;
      CHECK(f.col(Eigen::Index(k)).norm() < 1e-12 * scale);
    }
  CHECK(interior > 0);
  // Virtual work on the boundary: sum of force ⊗ X is the volume times P.
  Mat3d work = Mat3d::Zero();
  for (std::size_t k = 0; k < mesh.nodes.size(); ++k) work += f.col(Eigen::Index(k)) * mesh.nodes[k].transpose();
  CHECK((work - test::small_size.prod() * first_piola(kMaterial, F)).norm() < 1e-12 * work.norm());
}

TEMPLATE_TEST_CASE(
    "rigid motion makes no force, and rotation turns forces with it", "", QuadraticTet, LinearTet, LinearPatchTet) {
  const TetMesh mesh = test::small_mesh<TestType>();
  const Solid<NeoHookean, TestType> solid(mesh, kMaterial, TestType{});
  const Mat3d Q = Eigen::AngleAxisd(0.8, Vec3d(1, 2, 3).normalized()).toRotationMatrix();
  Positions rigid = positions_of(mesh), bent = rigid;
  for (Eigen::Index k = 0; k < rigid.cols(); ++k) {
    bent.col(k) += test::wavy(bent.col(k), 8e-3);
    rigid.col(k) = Q * rigid.col(k) + Vec3d(1, -2, 3);
  }
  Positions f = Positions::Zero(3, rigid.cols()), g = f, h = f;
  solid.add_forces(rigid, f);
  solid.add_forces(bent, g);
  solid.add_forces(Q * bent, h);
  CHECK(f.norm() < 1e-10 * g.norm());
  CHECK((h - Q * g).norm() < 1e-12 * g.norm());
  CHECK(solid.energy(Q * bent) == Approx(solid.energy(bent)).epsilon(1e-12));
}

TEMPLATE_TEST_CASE(
    "forces and tangent of a solid are the derivatives of its energy", "", QuadraticTet, LinearTet, LinearPatchTet) {
  for (bool cure : {true, false}) {
    const TetMesh mesh = test::small_mesh<TestType>();
    const Solid<NeoHookean, TestType> solid(mesh, kMaterial, TestType{cure});
    const Body body = test::block_body(test::small_size);
    const Sector sector = sector_of(mesh, {});
    const Equations eq(sector, body, {});
    Positions x = positions_of(mesh);
    for (Eigen::Index k = 0; k < x.cols(); ++k) x.col(k) += test::wavy(x.col(k), 8e-3);
    const auto forces = [&](const Positions& at) {
      Positions f = Positions::Zero(3, at.cols());
      solid.add_forces(at, f);
      return f;
    };
    SparseLower tangent = eq.pattern;
    std::fill_n(tangent.valuePtr(), tangent.nonZeros(), 0.0);
    solid.add_tangent(x, {&eq}, {tangent.valuePtr()});
    Eigen::MatrixXd K = tangent;
    K.triangularView<Eigen::StrictlyUpper>() = K.transpose();
    const Positions f = forces(x);
    const double h = 1e-8;
    for (Eigen::Index i = 0; i < x.size(); i += 7) {
      Positions up = x, down = x;
      up.data()[i] += h;
      down.data()[i] -= h;
      CHECK((solid.energy(up) - solid.energy(down)) / (2 * h) == Approx(f.data()[i]).margin(1e-6 * f.norm()));
      const int column = eq.of[std::size_t(i)];
      if (column < 0) continue;
      const Positions slope = (forces(up) - forces(down)) / (2 * h);
      for (std::size_t j = 0; j < eq.of.size(); ++j)
        if (const int row = eq.of[j]; row >= 0)
          CHECK(slope.data()[j] == Approx(K(row, column)).margin(1e-6 * K.norm()));
    }
  }
}

TEMPLATE_TEST_CASE("a law that is taken for eight elements at once has the forces and the tangent of one that is not",
    "", QuadraticTet, LinearTet, LinearPatchTet) {
  const TetMesh mesh = test::small_mesh<TestType>();
  const Equations eq(sector_of(mesh, {}), test::block_body(test::small_size), {});
  Positions x = positions_of(mesh);
  for (Eigen::Index k = 0; k < x.cols(); ++k) x.col(k) += test::wavy(x.col(k), 8e-3);
  const auto agree = [&](const auto& law, bool cure) {
    static_assert(DilatationalDistortion<std::decay_t<decltype(law)>>);
    const Solid fast(mesh, law, TestType{cure});
    const Solid slow(mesh, Opaque<std::decay_t<decltype(law)>>{law}, TestType{cure});
    const VolumeRatios at = fast.volume_ratios(x);
    CHECK(at.J.size() == mesh.tets.size() * (cure ? 1 : std::size_t(TestType::points)));
    std::vector<double> about = at.J;
    for (std::size_t k = 0; k < about.size(); ++k) about[k] *= 1.0 + 1e-3 * std::sin(double(k));
    for (const std::vector<double>* theta : {static_cast<const std::vector<double>*>(nullptr), &std::as_const(about)}) {
      Positions f = Positions::Zero(3, x.cols()), g = f;
      fast.add_forces(x, f, theta);
      slow.add_forces(x, g, theta);
      CHECK((f - g).norm() < 1e-12 * g.norm());
      SparseLower a = eq.pattern, b = eq.pattern;
      std::fill_n(a.valuePtr(), a.nonZeros(), 0.0);
      std::fill_n(b.valuePtr(), b.nonZeros(), 0.0);
      fast.add_tangent(x, {&eq}, {a.valuePtr()}, theta);
      slow.add_tangent(x, {&eq}, {b.valuePtr()}, theta);
      CHECK((a - b).norm() < 1e-12 * b.norm());
    }
  };
  for (const bool cure : {true, false}) {
    agree(kMaterial, cure);
    agree(StableNeoHookean{.mu = 1e5, .lambda = 9.9e6}, cure);
  }
}

TEMPLATE_TEST_CASE("volume ratios are carried on along their slope", "", QuadraticTet, LinearTet, LinearPatchTet) {
  const TetMesh mesh = test::small_mesh<TestType>();
  Positions x = positions_of(mesh), dx = x;
  for (Eigen::Index k = 0; k < x.cols(); ++k) {
    x.col(k) += test::wavy(x.col(k), 8e-3);
    dx.col(k) = test::wavy(2.0 * x.col(k), 1e-3);
  }
  for (const bool cure : {true, false}) {
    const Solid<NeoHookean, TestType> solid(mesh, kMaterial, TestType{cure});
    const double h = 1e-4;
    const VolumeRatios now = solid.volume_ratios(x), up = solid.volume_ratios(x + h * dx),
                       down = solid.volume_ratios(x - h * dx);
    std::vector<double> carried = now.J;
    solid.carry_on(carried, x, dx);
    for (std::size_t k = 0; k < carried.size(); ++k)
      CHECK(carried[k] - now.J[k] == Approx((up.J[k] - down.J[k]) / (2 * h)).margin(1e-7));
    CHECK(now.smallest <= *std::min_element(now.J.begin(), now.J.end()));
  }
}

TEST_CASE("elements with mean dilatation do not lock, the linear one does") {
  // A block bonded at bottom and top, pressed by a little. From nu = 0.3 to 0.4999 the stiffness of a good element
  // follows that of a much finer mesh; that of linear tetrahedra runs away.
  const Vec3d size(10e-3, 10e-3, 5e-3);
  const auto reaction = [&](auto element, int n, double nu) {
    const double mu = 1e5, lambda = 2 * mu * nu / (1 - 2 * nu);
    Body body = test::block_body(size);
    body.patches[1].bonded = true;
    const TetMesh mesh =
        test::block_mesh(size, test::even(n), test::even(n), test::even(n), decltype(element)::order, false);
    const Solid<NeoHookean, decltype(element)> solid(mesh, NeoHookean{mu, lambda}, element);
    const Equations eq(sector_of(mesh, {}), body, {});
    Positions x = positions_of(mesh);
    x.row(2) *= 1.0 - 1e-5;  // affine start; then Newton with bottom and top held
    SparseLower tangent = eq.pattern;
    EigenCholesky linear;
    linear.analyze(eq.pattern);
    for (int k = 0; k < 8; ++k) {
      Positions f = Positions::Zero(3, x.cols());
      solid.add_forces(x, f);
      Eigen::VectorXd r(eq.count);
      for (std::size_t i = 0; i < eq.of.size(); ++i)
        if (eq.of[i] >= 0) r[eq.of[i]] = f.data()[i];
      if (r.norm() < 1e-12) break;
      std::fill_n(tangent.valuePtr(), tangent.nonZeros(), 0.0);
      solid.add_tangent(x, {&eq}, {tangent.valuePtr()});
      REQUIRE(linear.factorize(tangent) == FactorStatus::positive_definite);
      const Eigen::VectorXd du = -linear.solve(r);
      for (std::size_t i = 0; i < eq.of.size(); ++i)
        if (eq.of[i] >= 0) x.data()[i] += du[eq.of[i]];
    }
    Positions f = Positions::Zero(3, x.cols());
    solid.add_forces(x, f);
    double push = 0.0;
    for (Eigen::Index k = 0; k < x.cols(); ++k)
      if (positions_of(mesh)(2, k) == size.z()) push -= f(2, k);
    return push;
  };
  for (double nu : {0.3, 0.495, 0.4999}) {
    const double fine = reaction(QuadraticTet{}, 6, nu);
    const double quadratic = reaction(QuadraticTet{}, 3, nu) / fine, linear = reaction(LinearTet{}, 6, nu) / fine;
    const double patches = reaction(LinearPatchTet{}, 3, nu) / fine,
                 uncured = reaction(LinearPatchTet{false}, 3, nu) / fine;
    INFO("nu = " << nu << ": quadratic " << quadratic << ", linear " << linear << ", linear patches " << patches
                 << ", without cure " << uncured);
    CHECK(quadratic == Approx(1.0).margin(0.06));
    CHECK(patches == Approx(1.0).margin(0.12));
    for (double locking : {linear, uncured})
      if (nu > 0.4) CHECK(locking > 1.5);
      else CHECK(locking == Approx(1.0).margin(0.12));
  }
}
