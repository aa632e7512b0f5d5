#pragma once

#include "lumo/core/units.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "lumo/morphology/body.hpp"
#include "lumo/optics/tracer.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <tuple>
#include <vector>

/// Small optical bodies for the tests. The tracer reads nodes and boundary faces only, so these meshes have no
/// tetrahedra.
namespace optics_test {

using namespace lumo;

/// Collects quadratic boundary faces; nodes at one place (to 1e-9 m) are one node.
class SurfaceBuilder {
 public:
  TetMesh mesh;

  int node(const Vec3d& p) {
    const auto key = std::tuple(std::llround(p.x() * 1e9), std::llround(p.y() * 1e9), std::llround(p.z() * 1e9));
    const auto [it, fresh] = index_.try_emplace(key, int(mesh.nodes.size()));
    if (fresh) mesh.nodes.push_back(p);
    return it->second;
  }

  /// Maps the grid us × vs by `f`; the normal is ∂f/∂u × ∂f/∂v. The diagonal is mirrored with the signs of the middle
  /// of a cell.
  template <class F> void grid(const std::vector<double>& us, const std::vector<double>& vs, int patch, F&& f) {
    for (std::size_t i = 0; i + 1 < us.size(); ++i)
      for (std::size_t j = 0; j + 1 < vs.size(); ++j) {
        const double u0 = us[i], u1 = us[i + 1], v0 = vs[j], v1 = vs[j + 1];
        if ((u0 + u1) * (v0 + v1) >= 0.0) {
          triangle(f, {u0, v0}, {u1, v0}, {u1, v1}, patch);
          triangle(f, {u0, v0}, {u1, v1}, {u0, v1}, patch);
        } else {
          triangle(f, {u0, v0}, {u1, v0}, {u0, v1}, patch);
          triangle(f, {u1, v0}, {u1, v1}, {u0, v1}, patch);
        }
      }
  }

  template <class F>
  void triangle(F&& f, std::array<double, 2> a, std::array<double, 2> b, std::array<double, 2> c, int patch) {
    const auto at = [&](const std::array<double, 2>& p, const std::array<double, 2>& q) {
      return node(f(0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1])));
    };
    mesh.faces.push_back({{at(a, a), at(b, b), at(c, c), at(a, b), at(b, c), at(c, a)}, patch});
  }

 private:
  std::map<std::tuple<long long, long long, long long>, int> index_;
};

inline std::vector<double> linspace(double a, double b, int n) {
  std::vector<double> x(std::size_t(n + 1));
  for (int i = 0; i <= n; ++i) x[std::size_t(i)] = (a * (n - i) + b * i) / n;
  return x;
}

struct Model {
  Body body;
  TetMesh mesh;
};

/// A box [−h, h] about `center`, n × n cells a side; patches −x, +x, −y, +y, −z, +z. No regions, no emitters.
inline Model box(const Vec3d& h, const lumo::Medium& medium, int n = 3, const Vec3d& center = Vec3d::Zero()) {
  SurfaceBuilder s;
  Model m;
  const std::vector<double> g = linspace(-1.0, 1.0, n);
  for (int axis = 0; axis < 3; ++axis)
    for (int side = -1; side <= 1; side += 2) {
      const int i1 = (axis + 1) % 3, i2 = (axis + 2) % 3, patch = 2 * axis + (side > 0);
      s.grid(g, g, patch, [&](double u, double v) {
        Vec3d p;
        p[axis] = side * h[axis];
        p[i1] = (side > 0 ? u : v) * h[i1];
        p[i2] = (side > 0 ? v : u) * h[i2];
        return Vec3d(p + center);
      });
      Vec3d normal = Vec3d::Zero();
      normal[axis] = side;
      Patch q;
      q.shape = Plane{center + Vec3d(side * h.cwiseProduct(normal.cwiseAbs())), normal};
      m.body.patches.push_back(q);
    }
  m.mesh = s.mesh;
  m.body.medium = medium;
  return m;
}

/// A sphere of `radius` [m], a cube's grid blown up; one patch.
inline Model sphere(double radius, const lumo::Medium& medium, int n = 8) {
  Model m = box(Vec3d::Ones(), medium, n);
  for (Vec3d& p : m.mesh.nodes) {
    for (Eigen::Index a = 0; a < 3; ++a) p[a] = std::tan(0.25 * pi * p[a]);
    p = radius * p.normalized();
  }
  for (BoundaryFace& f : m.mesh.faces) f.patch = 0;
  Patch q;
  q.shape = SphereShape{Vec3d::Zero(), radius};
  m.body.patches = {q};
  return m;
}

struct PadShape {
  double width = 29.5e-3, length = 60e-3, flat = 6e-3, dome = 6e-3, stem = 8e-3, stem_height = 5e-3, gap = 0.0;
  double cell = 2e-3;
  double albedo = 0.8;
  lumo::Medium medium{1.4348, 71.3801};
};

/// Columns of the pad's grid, equal steps of the angle asin(x/a), on flat faces too: neighbours must agree about the
/// middles of edges.
inline std::vector<double> pad_columns(const PadShape& s) {
  const double a = 0.5 * s.width, w = 0.5 * s.stem, v = w + s.gap;
  const auto cells = [&](double length) { return std::max(1, int(std::ceil(length / s.cell - 1e-9))); };
  std::vector<double> xs;  // columns on the right side, then mirrored; denser in angle towards the rim
  const auto add = [&](double x0, double x1) {
    const double p0 = std::asin(std::min(1.0, x0 / a)), p1 = std::asin(std::min(1.0, x1 / a));
    const std::vector<double> p = linspace(p0, p1, std::max(cells(x1 - x0), int(std::ceil((p1 - p0) / 0.17))));
    for (double q : p)
      if (xs.empty() || a * std::sin(q) > xs.back() + 1e-9) xs.push_back(a * std::sin(q));
    xs.back() = x1;
  };
  add(0.0, w);
  if (s.gap > 0.0) add(w, v);
  add(v, a);
  std::vector<double> columns;
  for (std::size_t i = xs.size(); i-- > 1;) columns.push_back(-xs[i]);
  columns.insert(columns.end(), xs.begin(), xs.end());
  for (double& x : columns) x = std::asin(std::clamp(x / a, -1.0, 1.0));
  return columns;
}

/// Patches of the pad in the order of its grid's numbers, and what is rigid in its voids.
inline void add_pad_patches(Body& body, const PadShape& s) {
  const double a = 0.5 * s.width, l = 0.5 * s.length, w = 0.5 * s.stem, v = w + s.gap, hs = s.stem_height;
  const auto patch = [&](Shape shape, bool bonded) {
    Patch q;
    q.shape = shape;
    q.bonded = bonded;
    if (bonded) q.optics = Lambertian{s.albedo};
    body.patches.push_back(q);
  };
  patch(EllipticCylinder{{0, 0, s.flat}, a, s.dome}, false);
  // Shapes are those of the sector x ≥ 0, y ≥ 0, also on the patches of its mirror images (Body::symmetry).
  for (int image = 0; image < 2; ++image) patch(Plane{{a, 0, 0}, Vec3d::UnitX()}, false);
  for (int image = 0; image < 2; ++image) patch(Plane{{0, l, 0}, Vec3d::UnitY()}, false);
  patch(Plane{{0, 0, hs}, -Vec3d::UnitZ()}, true);
  patch(Plane{{0, 0, 0}, -Vec3d::UnitZ()}, true);
  for (int image = 0; image < 2; ++image) patch(Plane{{w, 0, 0}, -Vec3d::UnitX()}, true);
  patch(Plane{{0, 0, hs}, -Vec3d::UnitZ()}, false);
  for (int image = 0; image < 2; ++image) patch(Plane{{v, 0, 0}, -Vec3d::UnitX()}, false);
  if (s.gap > 0.0)
    for (double side : {-1.0, 1.0}) {
      const double x0 = side * w, x1 = side * v;
      RigidFace ground{"floor", {{x0, -l, 0}, {x1, -l, 0}, {x1, l, 0}, {x0, l, 0}}, Lambertian{s.albedo}};
      RigidFace flank{"stem side", {{x0, -l, 0}, {x0, l, 0}, {x0, l, hs}, {x0, -l, hs}}, Lambertian{s.albedo}};
      if (side < 0)
        std::reverse(ground.corners.begin(), ground.corners.end()),
            std::reverse(flank.corners.begin(), flank.corners.end());
      body.rigid_faces.push_back(ground);
      body.rigid_faces.push_back(flank);
    }
}

/// A fingertip-like pad: half elliptic cylinder on a block, on a stem (with voids where gap > 0) with five emitters; 11
/// regions along y.
inline Model pad(const PadShape& s = {}) {
  enum { cap, left, right, end0, end1, stem_top, base, stem_side_l, stem_side_r, roof, wall_l, wall_r };
  Model m;
  SurfaceBuilder b;
  const double a = 0.5 * s.width, l = 0.5 * s.length, w = 0.5 * s.stem, v = w + s.gap, hs = s.stem_height;
  const auto cells = [&](double length) { return std::max(1, int(std::ceil(length / s.cell - 1e-9))); };
  const std::vector<double> columns = pad_columns(s);
  const auto x_of = [&](double angle) { return a * std::sin(angle); };
  const std::vector<double> ys = linspace(-l, l, 2 * cells(l));
  const auto part = [&](double lo, double hi) {
    std::vector<double> c;
    for (double p : columns)
      if (x_of(p) >= lo - 1e-9 && x_of(p) <= hi + 1e-9) c.push_back(p);
    return c;
  };
  b.grid(columns, ys, cap, [&](double p, double y) { return Vec3d(x_of(p), y, s.flat + s.dome * std::cos(p)); });
  const std::vector<double> low = linspace(0.0, hs, cells(hs)), high = linspace(0.0, 1.0, cells(s.flat + s.dome - hs));
  const auto wall = [&](double x, bool faces_right, int patch) {
    b.grid(faces_right ? ys : low, faces_right ? low : ys, patch,
        [&](double p, double q) { return faces_right ? Vec3d(x, p, q) : Vec3d(x, q, p); });
  };
  const auto floor = [&](double x0, double x1, double z, int patch) {
    b.grid(ys, part(x0, x1), patch, [&](double y, double p) { return Vec3d(x_of(p), y, z); });
  };
  for (double side : {-1.0, 1.0}) {
    wall(side * a, side > 0, side > 0 ? right : left);
    std::vector<double> upper;
    for (double t : high) upper.push_back(hs + t * (s.flat - hs));
    b.grid(side > 0 ? ys : upper, side > 0 ? upper : ys, side > 0 ? right : left,
        [&](double p, double q) { return side > 0 ? Vec3d(a, p, q) : Vec3d(-a, q, p); });
    wall(side * v, side<0, s.gap> 0.0 ? (side > 0 ? wall_r : wall_l) : (side > 0 ? stem_side_r : stem_side_l));
    floor(side > 0 ? v : -a, side > 0 ? a : -v, 0.0, base);
    if (s.gap > 0.0) floor(side > 0 ? w : -v, side > 0 ? v : -w, hs, roof);
    const int end = side > 0 ? end1 : end0;
    const auto below = [&](double x0, double x1) {
      const std::vector<double> c = part(x0, x1);
      b.grid(side > 0 ? low : c, side > 0 ? c : low, end,
          [&](double p, double q) { return side > 0 ? Vec3d(x_of(q), l, p) : Vec3d(x_of(p), -l, q); });
    };
    below(v, a);
    below(-a, -v);
    b.grid(side > 0 ? high : columns, side > 0 ? columns : high, end, [&](double p, double q) {
      const double angle = side > 0 ? q : p, t = side > 0 ? p : q;
      return Vec3d(x_of(angle), side * l, hs + t * (s.flat + s.dome * std::cos(angle) - hs));
    });
  }
  floor(-w, w, hs, stem_top);
  m.mesh = b.mesh;
  add_pad_patches(m.body, s);
  m.body.medium = s.medium;
  m.body.symmetry = m.mesh.symmetry = {true, true};
  for (int k = -2; k <= 2; ++k)
    m.body.emitters.push_back(RectangleEmitter{{0, 11e-3 * k, hs}, {0.4e-3, 0, 0}, {0, 0.8e-3, 0}, 0.2, 0});
  m.body.regions = 11;
  m.body.region = [](const Vec3d& p, const Vec3d& n) {
    if (std::abs(n.x()) < 0.5 || std::abs(p.y()) > 27.5e-3 || std::abs(n.y()) > 0.5) return -1;
    return std::min(10, int((p.y() + 27.5e-3) / 5e-3));
  };
  return m;
}

/// A smooth dent of `depth` [m] about (x, y) on the pad's top, and a contact disc of `radius` [m] there (0: none).
struct Dent {
  double depth = 1e-3, x = 0.0, y = 0.0, sigma = 5e-3, radius = 0.0;

  // Free of divergence, as silicone is: what goes down under the tool bulges out at the sides.
  std::vector<Vec3d> displacement(const PadShape& s, const TetMesh& mesh) const {
    std::vector<Vec3d> u;
    const double height = s.flat + s.dome - s.stem_height;
    for (const Vec3d& p : mesh.nodes) {
      const double dx = p.x() - x, dy = p.y() - y, r2 = dx * dx + dy * dy,
                   t = std::max(0.0, (p.z() - s.stem_height) / height);
      const double bell = std::exp(-0.5 * r2 / (sigma * sigma));
      const double out =
          r2 > 1e-12 ? depth * (2.0 * t / height) * sigma * sigma * (1.0 - bell) / r2 : 0.5 * depth * 2.0 * t / height;
      u.push_back({out * dx, out * dy, -depth * bell * t * t});
    }
    return u;
  }
  std::vector<double> contact(const PadShape& s, const TetMesh& mesh) const {
    std::vector<double> phi;
    for (const Vec3d& p : mesh.nodes)
      phi.push_back(p.z() < s.flat ? -std::numeric_limits<double>::infinity()
                                   : radius * radius - std::pow(p.x() - x, 2) - std::pow(p.y() - y, 2));
    return phi;
  }
};

}  // namespace optics_test
