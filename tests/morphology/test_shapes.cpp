#include "catch.hpp"

#include "lumo/mesh/body_check.hpp"
#include "lumo/morphology/body.hpp"
#include "lumo/morphology/round_shapes.hpp"

#include <functional>
#include <random>
#include <string>

using namespace lumo;

namespace {

// A shape, and its equation: 0 on the surface, growing outwards. The two are written apart from each other.
struct KnownShape {
  std::string name;
  Shape shape;
  std::function<double(const Vec3d&)> equation;
};

const Vec3d center{2e-3, -3e-3, 5e-3}, axis = Vec3d(1.0, 2.0, -0.5).normalized();

double along(const Vec3d& p) { return axis.dot(p - center); }
double aside(const Vec3d& p) { return axis.cross(p - center).norm(); }

std::vector<KnownShape> all_shapes() {
  const double angle = 0.4;
  std::vector<KnownShape> shapes{{"plane", Plane{center, axis}, [](const Vec3d& p) { return along(p); }},
      {"sphere", SphereShape{center, 6e-3}, [](const Vec3d& p) { return (p - center).norm() - 6e-3; }},
      {"cylinder", CylinderShape{center, axis, 4e-3}, [](const Vec3d& p) { return aside(p) - 4e-3; }},
      {"cone", ConeShape{center - 16e-3 * axis, axis, angle},
          [=](const Vec3d& p) { return aside(p) - std::tan(angle) * (along(p) + 16e-3); }},
      {"torus", TorusShape{center, axis, 6e-3, 2e-3},
          [](const Vec3d& p) { return std::hypot(aside(p) - 6e-3, along(p)) - 2e-3; }}};
  for (const Vec3d& semi : {Vec3d(6e-3, 3e-3, 4e-3), Vec3d(3e-3, 3e-3, 9e-3), Vec3d(5e-3, 5e-3, 5e-3)})
    shapes.push_back({"ellipsoid", EllipsoidShape{center, semi},
        [=](const Vec3d& p) { return 3e-3 * ((p - center).cwiseQuotient(semi).squaredNorm() - 1.0); }});
  return shapes;
}

}  // namespace

TEST_CASE("The foot of a point lies on the surface, the normal is the gradient, and the way there is along it") {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> place(-8e-3, 8e-3);
  for (const KnownShape& known : all_shapes()) {
    INFO(known.name);
    validate(known.shape);
    for (int k = 0; k < 500; ++k) {
      const Vec3d p = center + Vec3d(place(random), place(random), place(random));
      const Vec3d foot = closest_point(known.shape, p), n = outward_normal(known.shape, p);
      CHECK(std::abs(known.equation(foot)) < 1e-12);
      CHECK((closest_point(known.shape, foot) - foot).norm() < 1e-12);
      CHECK(n.norm() == Approx(1.0).epsilon(1e-12));
      CHECK((p - foot).cross(n).norm() < 1e-11);
      Vec3d gradient;
      for (Eigen::Index a = 0; a < 3; ++a) {
        Vec3d step = Vec3d::Zero();
        step[a] = 1e-7;
        gradient[a] = (known.equation(foot + step) - known.equation(foot - step)) / 2e-7;
      }
      CHECK((gradient.normalized() - n).norm() < 1e-6);
    }
  }
}

TEST_CASE("No point of a surface is nearer than the foot") {
  std::mt19937 random(6);
  std::uniform_real_distribution<double> place(-8e-3, 8e-3), nearby(-2e-3, 2e-3);
  for (const KnownShape& known : all_shapes()) {
    INFO(known.name);
    for (int k = 0; k < 100; ++k) {
      const Vec3d p = center + Vec3d(place(random), place(random), place(random));
      const double distance = (closest_point(known.shape, p) - p).norm();
      for (int j = 0; j < 20; ++j) {
        const Vec3d other = closest_point(known.shape, p + Vec3d(nearby(random), nearby(random), nearby(random)));
        CHECK((other - p).norm() >= distance - 1e-12);
      }
    }
  }
}

TEST_CASE("The foot on an ellipsoid is right at its planes, poles and centre, and is a cylinder's where it is long") {
  const EllipsoidShape flat{Vec3d::Zero(), {6e-3, 4e-3, 2e-3}};
  CHECK((flat.closest_point(Vec3d::Zero()) - Vec3d(0, 0, 2e-3)).norm() < 1e-15);
  // Out of the plane z = 0, inside the focal curve: x = a² px/(a² − c²), likewise y.
  const Vec3d foot = flat.closest_point({1e-3, 0.5e-3, 0.0});
  CHECK(foot.x() == Approx(36.0 / 32.0 * 1e-3));
  CHECK(foot.y() == Approx(16.0 / 12.0 * 0.5e-3));
  CHECK(foot.z() == Approx(2e-3 * std::sqrt(1.0 - 1.125 * 1.125 / 36.0 - 4.0 / 9.0 / 16.0)));
  CHECK((flat.closest_point({9e-3, 0, 0}) - Vec3d(6e-3, 0, 0)).norm() < 1e-15);
  const EllipsoidShape longish{Vec3d::Zero(), {6e-3, 1e6, 2e-3}};
  const EllipticCylinder upper{Vec3d::Zero(), 6e-3, 2e-3};
  for (const Vec3d& p : {Vec3d(1e-3, 2e-3, 1e-3), Vec3d(5e-3, 0.0, 1.5e-3), Vec3d(-7e-3, 1e-3, 3e-3)}) {
    CHECK((longish.closest_point(p) - upper.closest_point(p)).norm() < 1e-9);
    CHECK((longish.normal(p) - upper.normal(p)).norm() < 1e-6);
  }
}

TEST_CASE("A hole has the same surface, and the normal points into it") {
  const std::vector<std::pair<Shape, Shape>> pairs{
      {CylinderShape{center, axis, 4e-3}, CylinderShape{center, axis, 4e-3, true}},
      {ConeShape{center, axis, 0.5}, ConeShape{center, axis, 0.5, true}},
      {EllipsoidShape{center, {6e-3, 3e-3, 4e-3}}, EllipsoidShape{center, {6e-3, 3e-3, 4e-3}, true}},
      {TorusShape{center, axis, 6e-3, 2e-3}, TorusShape{center, axis, 6e-3, 2e-3, true}}};
  for (const auto& [full, hole] : pairs)
    for (const Vec3d& p : {Vec3d(7e-3, 1e-3, 2e-3), Vec3d(-1e-3, 0.0, 9e-3)}) {
      CHECK((closest_point(full, p) - closest_point(hole, p)).norm() < 1e-15);
      CHECK((outward_normal(full, p) + outward_normal(hole, p)).norm() < 1e-15);
    }
}

namespace {

// A user's: the parabolic trough z = bend x²/2 along y, by Newton's method.
struct Trough {
  double bend_per_m = 20.0;

  Vec3d closest_point(const Vec3d& p) const {
    double x = p.x();
    for (int k = 0; k < 50; ++k) {
      const double z = 0.5 * bend_per_m * x * x, slope = bend_per_m * x;
      x -= (x - p.x() + (z - p.z()) * slope) / (1.0 + slope * slope + (z - p.z()) * bend_per_m);
    }
    return {x, p.y(), 0.5 * bend_per_m * x * x};
  }
  Vec3d normal(const Vec3d& p) const { return Vec3d(-bend_per_m * closest_point(p).x(), 0.0, 1.0).normalized(); }
};

}  // namespace

TEST_CASE("A shape of one's own is a patch's shape, keeps its type, and is refused if it says so") {
  const Shape own = Trough{30.0};
  CHECK((closest_point(own, {2e-3, 1e-3, 60e-6}) - Vec3d(2e-3, 1e-3, 60e-6)).norm() < 1e-12);
  CHECK(outward_normal(own, {0, 0, 0}) == Vec3d(0, 0, 1));
  REQUIRE(std::get<OwnShape>(own).as<Trough>() != nullptr);
  CHECK(std::get<OwnShape>(own).as<Trough>()->bend_per_m == 30.0);
  CHECK(std::get<OwnShape>(own).as<TorusShape>() == nullptr);
  const Shape plane = Plane{};
  CHECK(std::holds_alternative<Plane>(plane));

  const auto refused = [](const Shape& shape) {
    Body body;
    body.patches = {{.name = "wall", .shape = shape}};
    try {
      require_on_shapes(body);
    } catch (const InvalidArgument& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  CHECK(refused(CylinderShape{{0, 0, 0}, {0, 0, 2}, 1e-3}) ==
        "patch \"wall\": axis of a cylinder has length 2, must be 1");
  CHECK_THAT(refused(CylinderShape{.radius = -1.0}), Catch::Contains("radius of a cylinder"));
  CHECK_THAT(refused(ConeShape{.half_angle_rad = 2.0}), Catch::Contains("half angle of a cone"));
  CHECK_THAT(refused(TorusShape{.ring = 1e-3, .tube = 2e-3}), Catch::Contains("tube"));
  CHECK_THAT(refused(EllipsoidShape{.semi = {1.0, std::nan(""), 1.0}}), Catch::Contains("half axis"));
  CHECK_THAT(refused(Plane{{0, 0, 0}, {0, 1, 1}}), Catch::Contains("direction of a plane"));
  CHECK(refused(TorusShape{}).empty());
}
