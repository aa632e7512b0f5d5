#include "catch.hpp"
#include "lumo/mechanics/elements/energy_error.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"

#include "mechanics/bodies.hpp"

#include <cmath>
#include <functional>
#include <vector>

using namespace lumo;

namespace {

const Vec3d size(10e-3, 10e-3, 10e-3);
const NeoHookean soft{.mu = 106e3, .lambda = 10.494e6};

TetMesh block(int cells, int order) {
  return test::block_mesh(size, test::even(cells), test::even(cells), test::even(cells), order, false);
}

template <class Element> double error(const TetMesh& mesh, const std::function<Vec3d(const Vec3d&)>& moved) {
  Positions x(3, Eigen::Index(mesh.nodes.size()));
  for (std::size_t k = 0; k < mesh.nodes.size(); ++k) x.col(Eigen::Index(k)) = moved(mesh.nodes[k]);
  return EnergyError<NeoHookean, Element>(mesh, soft)(x);
}

Vec3d sheared(const Vec3d& p) { return p + Vec3d(0.2 * p.z(), 0.0, 0.1 * p.x()); }

/// Bends a block; stresses are not linear.
Vec3d bent(const Vec3d& p) {
  const double t = 40.0 * p.x(), r = 25e-3 - p.z();
  return {r * std::sin(t), p.y(), 25e-3 - r * std::cos(t)};
}

}  // namespace

TEST_CASE("where elements hold the stresses exactly there is no error") {
  CHECK(error<QuadraticTet>(block(2, 2), sheared) < 1e-20);
  CHECK(error<LinearTet>(block(2, 1), sheared) < 1e-20);
  CHECK(error<LinearPatchTet>(block(2, 2), sheared) < 1e-20);
  CHECK(error<QuadraticTet>(block(2, 2), [](const Vec3d& p) { return p; }) < 1e-12);
}

TEST_CASE("the error falls with the elements, and linear ones know bending worse") {
  const double coarse = error<QuadraticTet>(block(2, 2), bent), fine = error<QuadraticTet>(block(4, 2), bent);
  CHECK(coarse > 1e-5);
  CHECK(fine < 0.2 * coarse);
  const double linear = error<LinearTet>(block(4, 1), bent);
  CHECK(linear > 20.0 * fine);
  CHECK(error<LinearTet>(block(8, 1), bent) < 0.5 * linear);
}

TEST_CASE("what is not finite has an infinite error") {
  const TetMesh mesh = block(2, 2);
  CHECK(std::isinf(error<QuadraticTet>(mesh, [](const Vec3d& p) { return Vec3d(std::nan("") * p); })));
}
