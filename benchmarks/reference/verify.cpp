// Checks of the reference solver itself: exits with 1 when one fails.

#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "mechanics/bodies.hpp"
#include "taylor_hood.hpp"

#include <cstdio>

namespace {

using namespace lumo;
using reference::TaylorHood;

bool all_passed = true;

void check(const char* what, double value, double limit) {
  const bool passed = std::abs(value) <= limit;
  all_passed = all_passed && passed;
  std::printf("%-72s %11.3e  (limit %.1e) %s\n", what, value, limit, passed ? "ok" : "FAILED");
}

std::vector<double> graded(int n, double power, bool from_end) {
  std::vector<double> x;
  for (int i = 0; i <= n; ++i)
    x.push_back(from_end ? 1.0 - std::pow(1.0 - double(i) / n, power) : std::pow(double(i) / n, power));
  return x;
}

void quadrature() {
  // ∫ λ0² λ1² λ2 dV / V = 3! 2! 2! 1! / 8!
  double sum = 0.0;
  for (int q = 0; q < 14; ++q) {
    const auto [l, w] = reference::tet_point(q);
    sum += w * l[0] * l[0] * l[1] * l[1] * l[2];
  }
  check("tetrahedron rule of degree 5, relative", sum / (24.0 / 40320.0) - 1.0, 1e-12);
}

Body all_round(Body b) {
  for (Patch& p : b.patches) {
    p.bonded = true;
    p.contactable = false;
  }
  return b;
}

void patch_test() {
  // Boundary moved by x → F x, pressure of the homogeneous state: the residual vanishes everywhere inside.
  const Vec3d size(1e-2, 1e-2, 1e-2);
  TetMesh mesh = test::block_mesh(size, {0, .3, 1}, {0, .6, 1}, {0, .45, 1}, 2, false);
  TaylorHood solver(all_round(test::block_body(size)), mesh, {}, {});
  solver.start({}, Vec3d(0, 0, 1), -Vec3d::UnitZ());
  Mat3d F;
  F << 1.05, 0.1, 0.02, -0.03, 0.96, 0.04, 0.0, 0.05, 1.01;
  auto at = solver.rest();
  for (int k = 0; k < at.x.cols(); ++k) at.x.col(k) = F * at.x.col(k);
  at.p.setConstant(10.494e6 * std::log(F.determinant()));
  const auto r = solver.residual(at, nullptr, false);
  check("patch test: residual / (p h^2)", r.norm() / (std::abs(at.p[0]) * 1e-4), 1e-12);
}

void derivatives() {
  const Vec3d size(1e-2, 1e-2, 1e-2);
  Body body = test::block_body(size);
  body.patches[2].contactable = body.patches[2].meets_carrier = false;
  TaylorHood solver(
      body, test::block_mesh(size, test::even(2), test::even(2), test::even(2), 2, false), {}, {106e3, 10.494e6, 1e9});
  const Vec3d origin(5e-3, 4e-3, 1.48e-2);
  solver.start(Sphere{10e-3}, origin, Vec3d(-0.5, 0, -std::sqrt(0.75)));
  auto at = solver.rest();
  for (int k = 0; k < at.x.cols(); ++k) {
    const Vec3d X = at.x.col(k);
    at.x.col(k) += 0.3 * X.z() / size.z() * test::wavy(X, size.z());
    at.p[k] = 2e4 * std::sin(1e3 * X.sum());
  }
  at.advance = 4e-4;
  solver.residual(at, nullptr, true);
  const SparseLower K = solver.matrix();
  const Eigen::VectorXd coupling = solver.coupling();
  const double stretch = 1e-7;
  double worst = 0.0, largest = 0.0;
  for (int node : {20, 26, 40, 60, 90}) {
    if (node >= at.x.cols()) continue;
    const int j = solver.equation(node, 2);
    if (j < 0) continue;
    auto up = at, down = at;
    up.x(2, node) += stretch;
    down.x(2, node) -= stretch;
    const Eigen::VectorXd by =
        (solver.residual(up, nullptr, false) - solver.residual(down, nullptr, false)) / (2 * stretch);
    for (int i = 0; i < solver.count(); ++i) {
      const double entry = i >= j ? K.coeff(i, j) : K.coeff(j, i);
      worst = std::max(worst, std::abs(entry - by[i]));
      largest = std::max(largest, std::abs(by[i]));
    }
  }
  check("tangent against finite differences, relative", worst / largest, 1e-5);
  auto up = at, down = at;
  up.advance += stretch;
  down.advance -= stretch;
  const Eigen::VectorXd by =
      (solver.residual(up, nullptr, false) - solver.residual(down, nullptr, false)) / (2 * stretch);
  check("coupling to the advance, relative", (by - coupling).norm() / by.norm(), 1e-3);
}

struct Block {
  Body body;
  TetMesh mesh;
};

Block fine_block(double half, int n) {
  auto [body, mesh] = test::symmetric_block(
      Vec3d(half, half, half), graded(n, 2.0, false), graded(n, 2.0, false), graded(n, 2.0, true));
  return {body, mesh};
}

std::vector<double> depths(const Block& b, double radius, const std::vector<double>& loads,
    const reference::Constants& constants, bool& stable) {
  const Sector sector = sector_of(b.mesh, {true, true});
  TaylorHood solver(b.body, sector.mesh, {true, true}, constants);
  const Scenario<Sphere> s{Sphere{2 * radius}, 0.0, 0.0, loads};
  const Touch touch = first_touch(b.body, b.mesh, s);
  std::vector<double> d;
  for (const auto& e : solver.press(s.indenter, touch.origin, s.direction(), loads, 0.25)) {
    stable = stable && e.converged && e.stable;
    d.push_back(e.depth_m);
  }
  return d;
}

void hertz() {
  const double nu = 0.45, mu = 1e5, lambda = 2 * mu * nu / (1 - 2 * nu), E_star = 2 * mu * (1 + nu) / (1 - nu * nu),
               R = 20e-3;
  auto [body, mesh] = test::symmetric_block(
      Vec3d(12e-3, 12e-3, 12e-3), graded(15, 2.4, false), graded(15, 2.4, false), graded(13, 2.4, true));
  bool stable = true;
  const std::vector<double> loads = {0.002, 0.004};
  const auto d = depths({body, mesh}, R, loads, {mu, lambda, 3e11}, stable);
  for (std::size_t k = 0; k < d.size(); ++k) {
    // Stiffer than a half-space by what a bonded layer of depth h adds (Dimitriadis and others 2002): 1 + a χ + a² χ²,
    // χ = √(R d)/h.
    const double a = 2.0 / pi * (1.2876 - 1.4678 * nu + 1.3442 * nu * nu) / (1.0 - nu),
                 chi = std::sqrt(R * d[k]) / 12e-3;
    const double layer = 4.0 / 3.0 * E_star * std::sqrt(R) * std::pow(d[k], 1.5) * (1.0 + a * chi + a * a * chi * chi);
    check("Hertz on a bonded layer: force ratio - 1", loads[k] / layer - 1.0, 0.015);
  }
  check("Hertz: not converged or not stable", stable ? 0 : 1, 0);
}

void locking() {
  // Coarse against fine must not get worse as ν goes to ½.
  for (const double nu : {0.3, 0.45, 0.495, 0.4999}) {
    const double mu = 1e5, lambda = 2 * mu * nu / (1 - 2 * nu);
    bool stable = true;
    const double coarse = depths(fine_block(12e-3, 5), 5e-3, {2.0}, {mu, lambda, 1e11}, stable).back();
    const double fine = depths(fine_block(12e-3, 10), 5e-3, {2.0}, {mu, lambda, 1e11}, stable).back();
    std::printf("  nu %.4f: depth coarse %.4f mm, fine %.4f mm\n", nu, 1e3 * coarse, 1e3 * fine);
    check("no locking: coarse / fine - 1", coarse / fine - 1.0, 0.03);
    check("no locking: not converged or not stable", stable ? 0 : 1, 0);
  }
}

void against_lumo() {
  const Block b = fine_block(12e-3, 8);
  bool stable = true;
  const std::vector<double> loads = {1.0, 5.0, 15.0};
  const auto d = depths(b, 5e-3, loads, {1e5, 1e7, 1e11}, stable);
  const Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<MixedCholesky>> simulator{NeoHookean{1e5, 1e7}};
  const auto states = simulator.press(b.body, b.mesh, Scenario<Sphere>{Sphere{10e-3}, 0.0, 0.0, loads});
  for (std::size_t k = 0; k < std::min(d.size(), states.size()); ++k)
    check("lumo on the same mesh: depth ratio - 1", states[k].depth_m / d[k] - 1.0, 0.01);
  check("block: not converged or not stable", stable && d.size() == 3 ? 0 : 1, 0);
}

}  // namespace

int main() {
  quadrature();
  patch_test();
  derivatives();
  against_lumo();
  hertz();
  locking();
  return all_passed ? 0 : 1;
}
