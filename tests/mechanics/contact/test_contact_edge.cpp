#include "catch.hpp"
#include "lumo/mechanics/contact/contact_set.hpp"
#include "lumo/mesh/contact_slope.hpp"
#include "mechanics/bodies.hpp"

#include <cmath>
#include <functional>
#include <random>

using namespace lumo;

namespace {

/// All that lies above z = 0.
struct Ceiling {
  double distance(const Vec3d& p) const { return -p.z(); }
  DistanceSample sample(const Vec3d& p) const { return {-p.z(), -Vec3d::UnitZ(), Mat3d::Zero()}; }
};

/// Hertz's gap [m] beside a contact of radius a under a sphere of radius R; inside, an overlap as a penalty leaves it.
double round_gap(double r, double a, double R) {
  const double q = (r * r - a * a) / (a * a);
  return q > 0.0 ? a * a / (pi * R) * hertz_gap(q) : -2e-6 * std::sqrt(-q);
}

/// The same under a cylinder: half-width b. Source: Johnson 1985, eq. (4.48) integrated.
double line_gap(double x, double b, double R) {
  const double s = std::abs(x) / b;
  return s > 1.0 ? 0.5 * b * b / R * (s * std::sqrt(s * s - 1.0) - std::acosh(s)) : -2e-6 * std::sqrt(1.0 - s * s);
}

/// The top of a slab under a flat ceiling, at the given gap; its nodes are shaken within their plane. Linear, for faces
/// that sag into the ceiling are none that a solver would leave.
struct Slab {
  Body body;
  TetMesh mesh;
  ContactSurface surface;
  Positions x;

  Slab(int cells, unsigned seed, const std::function<double(double, double)>& gap)
      : body(test::block_body(size)),
        mesh(shaken(cells, seed)),
        surface(mesh, body, [](const Patch& p) { return p.contactable; }),
        x(positions_of(mesh)) {
    for (Eigen::Index k = 0; k < x.cols(); ++k)
      if (x(2, k) > 0.5 * size.z()) x(2, k) = -gap(x(0, k), x(1, k));
  }
  ContactField field() const {
    const Ceiling ceiling;
    return contact_field(mesh, surface, SDFContact{}, Moving<Ceiling>{&ceiling, Vec3d::Zero(), -Vec3d::UnitZ()}, x);
  }

  static inline const Vec3d size{16e-3, 16e-3, 2e-3};

 private:
  static TetMesh shaken(int cells, unsigned seed) {
    TetMesh mesh = test::block_mesh(size, test::even(cells), test::even(cells), test::even(1), 1, false);
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> shift(-0.25, 0.25);
    for (Vec3d& p : mesh.nodes)
      for (int i = 0; i < 2; ++i)
        if (p[i] > 0.0 && p[i] < size[i]) p[i] += shift(random) * size[i] / cells;
    return mesh;
  }
};

}  // namespace

TEST_CASE("Hertz's gap and its opening are each other's inverse, its slope the derivative") {
  for (const double q : {1e-6, 1e-3, 0.1, 1.0, 5.0, 100.0}) {
    CAPTURE(q);
    CHECK(hertz_opening(hertz_gap(q)) == Approx(q).epsilon(1e-9));
    const double h = 1e-4 * q;
    CHECK(hertz_slope(q) == Approx((hertz_gap(q + h) - hertz_gap(q - h)) / (2.0 * h)).epsilon(1e-6));
  }
  CHECK(hertz_gap(1e-6) == Approx(4.0 / 3.0 * 1e-9).epsilon(1e-5));  // (4/3) q^(3/2) at the edge
  CHECK(hertz_opening(0.0) == 0.0);
  CHECK(hertz_slope(-0.5) == 0.0);
}

TEST_CASE("a round contact's area and slopes are Hertz's on any mesh with three nodes to its radius") {
  constexpr double R = 10e-3;
  for (const double a : {1e-3, 2e-3, 3.3e-3})
    for (unsigned seed = 0; seed < 4; ++seed) {
      CAPTURE(a, seed);
      const double cx = 8e-3 + 0.11e-3 * seed, cy = 8e-3 - 0.07e-3 * seed;
      const auto radius = [&](double x, double y) { return std::hypot(x - cx, y - cy); };
      const Slab slab(52, seed, [&](double x, double y) { return round_gap(radius(x, y), a, R); });
      const ContactField field = slab.field();
      CHECK(contact_area(slab.surface, field.field, slab.x) == Approx(pi * a * a).epsilon(a < 2e-3 ? 0.025 : 0.006));
      double worst = 0.0, norm = 0.0;
      for (Eigen::Index k = 0; k < slab.x.cols(); ++k) {
        const ContactSlope& slope = field.slopes[std::size_t(k)];
        if (slope.weight < 1.0) continue;
        const double r = radius(slab.x(0, k), slab.x(1, k)), q = (r * r - a * a) / (a * a);
        const double exact = 2.0 * r / (pi * R) * hertz_slope(q);
        const Vec3d n = (slope.normal + hertz_slope(slope.opening) * slope.tilt).normalized();
        worst = std::max(worst, std::abs(std::hypot(n.x(), n.y()) / n.z() - exact));
        norm = std::max(norm, exact);
        if (r > 1.5 * a) CHECK(n.x() * (slab.x(0, k) - cx) + n.y() * (slab.x(1, k) - cy) > 0.0);
      }
      CHECK(worst < 0.06 * a / R);
      CHECK(norm > 0.1 * a / R);
    }
}

TEST_CASE("a long contact's width is right, and two contacts are as large as each by itself") {
  constexpr double b = 1.8e-3, R = 10e-3;
  const Slab line(52, 1, [&](double x, double) { return line_gap(x - 8.1e-3, b, R); });
  CHECK(contact_area(line.surface, line.field().field, line.x) == Approx(2.0 * b * Slab::size.y()).epsilon(0.02));

  constexpr double a1 = 1.5e-3, a2 = 2.0e-3;
  const auto first = [&](double x, double y) { return round_gap(std::hypot(x - 4e-3, y - 5e-3), a1, R); };
  const auto second = [&](double x, double y) { return round_gap(std::hypot(x - 11e-3, y - 10e-3), a2, 0.5 * R); };
  const Slab pair(52, 2, [&](double x, double y) { return std::min(first(x, y), second(x, y)); });
  CHECK(contact_area(pair.surface, pair.field().field, pair.x) == Approx(pi * (a1 * a1 + a2 * a2)).epsilon(0.02));
}

TEST_CASE("each of two contacts says how large it is, how fine its mesh, and what it bears") {
  constexpr double a1 = 1.5e-3, a2 = 2.0e-3, R = 10e-3;
  const auto first = [&](double x, double y) { return round_gap(std::hypot(x - 4e-3, y - 5e-3), a1, R); };
  const auto second = [&](double x, double y) { return round_gap(std::hypot(x - 11e-3, y - 10e-3), a2, 0.5 * R); };
  const Slab pair(52, 2, [&](double x, double y) { return std::min(first(x, y), second(x, y)); });
  const ContactField field = pair.field();
  REQUIRE(field.spots.size() == 2);
  const ContactSpot &large = field.spots[0], &small = field.spots[1];
  CHECK(large.force_N > small.force_N);
  double force = 0.0;
  for (const ContactSpot& s : field.spots) force += s.force_N;
  const std::vector<double> areas = pair.surface.node_areas();
  double pressed = 0.0;
  for (std::size_t k = 0; k < areas.size(); ++k) pressed += areas[k] * field.pressure_Pa[k];
  CHECK(force == Approx(pressed).epsilon(1e-9));
  CHECK(large.radius_m() == Approx(a2).epsilon(0.02));
  CHECK(small.radius_m() == Approx(a1).epsilon(0.02));
  CHECK((large.reference_m - Vec3d(11e-3, 10e-3, Slab::size.z())).norm() < 0.1e-3);
  for (const ContactSpot& s : field.spots) {
    CHECK(s.rim_m == Approx(2.0 * pi * s.radius_m()).epsilon(0.05));
    CHECK(s.edge_m == Approx(Slab::size.x() / 52).epsilon(0.15));  // 1.075 times, as equilateral triangles
    CHECK(s.force_outside_N < 0.02 * s.force_N);
  }
}

TEST_CASE("a surface that rests has the support's normal where it touches") {
  const Slab slab(26, 3, [](double x, double) { return x < 8e-3 ? -1e-6 : 2e-6; });
  const Ceiling ceiling;
  const auto slopes =
      resting_slopes(slab.mesh, slab.surface, Moving<Ceiling>{&ceiling, Vec3d::Zero(), -Vec3d::UnitZ()}, slab.x);
  int touching = 0;
  for (std::size_t k = 0; k < slopes.size(); ++k) {
    const bool on_top = slab.mesh.nodes[k].z() == Slab::size.z(), touches = on_top && slab.mesh.nodes[k].x() < 8e-3;
    CHECK(slopes[k].weight == (touches ? 1.0 : 0.0));
    CHECK(slopes[k].normal == (on_top ? Vec3d(Vec3d::UnitZ()) : Vec3d(Vec3d::Zero())));
    touching += touches;
  }
  CHECK(touching > 300);
}

TEST_CASE("a surface that hangs free has no contact, and one that touches all over is in contact all over") {
  const Slab free(8, 0, [](double, double) { return 0.1e-3; });
  CHECK(contact_area(free.surface, free.field().field, free.x) == 0.0);
  const Slab pressed(8, 0, [](double, double) { return -1e-6; });
  CHECK(contact_area(pressed.surface, pressed.field().field, pressed.x) ==
        Approx(Slab::size.x() * Slab::size.y()).epsilon(1e-9));
}
