#include "catch.hpp"
#include "optics/policies.hpp"

using namespace optics_test;

namespace {

double total(const Response& r) {
  double sum = 0.0;
  for (double p : r.power_W) sum += p;
  return sum;
}

// A clear box without refractive step; its floor is a Lambertian square that a lamp above it lights, its sides are
// black, its top is open.
Model lit_floor(double albedo, double half = 4e-3, double height = 1e-3) {
  Model m = box({half, half, 0.5 * height}, {1.0, 0.0}, 8, {0, 0, -0.5 * height});
  for (std::size_t k : {0u, 1u, 2u, 3u}) m.body.patches[k].optics = Absorber{};
  m.body.patches[4].optics = Lambertian{albedo};
  m.body.regions = 1;
  m.body.region = [](const Vec3d&, const Vec3d& n) { return n.z() > 0.5 ? 0 : -1; };
  return m;
}

template <class Readout> Response traced(const Model& m, const Readout& readout, int rays = 1 << 13) {
  return Tracer<BeerLambert, Readout>(few_rays<BeerLambert, Readout>(rays), readout).trace(m.body, m.mesh);
}

}  // namespace

TEST_CASE("Photodiodes that cover everything see all the light that leaves", "[readout]") {
  for (const NamedSurface& s : all_surfaces()) {
    Model m = lit_box(s.optics, {1.41, 60.0}, PointEmitter{{-1e-3, 0, 0}});
    std::vector<Photodiode> walls;
    for (int axis = 0; axis < 3; ++axis)
      for (double side : {-1.0, 1.0}) {
        const int a = (axis + 1) % 3, b = (axis + 2) % 3;
        walls.push_back({side * 8e-3 * Vec3d::Unit(axis), 8e-3 * Vec3d::Unit(a), -side * 8e-3 * Vec3d::Unit(b)});
      }
    const Response seen = traced(m, Photodiodes(walls)), all = traced(m, ExitPower{});
    INFO(s.name);
    CHECK(seen.power_W.size() == 6);
    CHECK(seen.ledger.elsewhere == Approx(0.0).margin(1e-9));
    CHECK(total(seen) == Approx(total(all)).epsilon(0.01));
    CHECK(seen.ledger.imbalance() < 1e-9);
  }
}

TEST_CASE("A round photodiode on the axis of a small Lambertian source takes the share R²/(R² + d²)", "[readout]") {
  Model m = box({20e-3, 20e-3, 1e-3}, {1.0, 0.0}, 4, {0, 0, 1e-3});
  m.body.emitters = {DiscEmitter{{0, 0, 0}, Vec3d::UnitZ(), 1e-6, 2.0}};
  for (double radius : {1e-3, 4e-3, 12e-3}) {
    const double d = 5e-3;
    const Response r = traced(m, Photodiodes({{{0, 0, d}, {radius, 0, 0}, {0, -radius, 0}, true}}), 1 << 16);
    const double exact = 2.0 * radius * radius / (radius * radius + d * d);
    CHECK(r.power_W[0] == Approx(exact).margin(4.0 * r.error_W[0] + 2e-3 * exact));
    CHECK(r.error_W[0] < 0.03 * exact);
  }
  // An acceptance angle cuts the cone down: sin² of it.
  const Response narrow = traced(m, Photodiodes({{{0, 0, 5e-3}, {12e-3, 0, 0}, {0, -12e-3, 0}, true, 0.5}}), 1 << 16);
  CHECK(narrow.power_W[0] == Approx(2.0 * std::pow(std::sin(0.5), 2)).epsilon(0.02));
  // From behind it sees nothing, and what hides behind another sees nothing.
  CHECK(traced(m, Photodiodes({{{0, 0, 5e-3}, {1e-3, 0, 0}, {0, 1e-3, 0}}})).power_W[0] == 0.0);
  const Photodiode near{{0, 0, 4e-3}, {2e-3, 0, 0}, {0, -2e-3, 0}}, far{{0, 0, 5e-3}, {2e-3, 0, 0}, {0, -2e-3, 0}};
  CHECK(traced(m, Photodiodes({far, near})).power_W[0] < 0.2 * traced(m, Photodiodes({far})).power_W[0]);
}

TEST_CASE("Light on an opaque patch is what the lamp's solid angle sends there", "[readout]") {
  const double half = 4e-3, height = 3e-3, lamp = -0.4e-3, d = height + lamp;
  // A small Lambertian source above the middle of a square (form factor of its quarter: Howell, Siegel & Mengüç 2010,
  // B-3)
  const double a = half / d, root = std::sqrt(1.0 + a * a), share = 4.0 * a / (pi * root) * std::atan(a / root);
  for (const double kept : {0.0, 0.5}) {
    Model m = lit_floor(0.0, half, height);
    m.body.patches[4].name = "floor";
    m.body.patches[4].optics = kept > 0.0 ? SurfaceOptics(Mirror{kept}) : SurfaceOptics(Absorber{});
    m.body.emitters = {DiscEmitter{{0, 0, lamp}, -Vec3d::UnitZ(), 1e-6, 2.0}};
    const PatchLight floor(m.body, {"floor"});
    const Tracer<BeerLambert, PatchLight> light(few_rays<BeerLambert, PatchLight>(1 << 14), floor);
    const Response whole = light.trace(m.body, m.mesh),
                   quarter = light.trace(m.body, m.mesh, SurfaceState{}, Symmetry{true, true});
    for (const Response& r : {whole, quarter}) {
      CHECK(r.power_W[0] == Approx(2.0 * (1.0 - kept) * share).epsilon(0.002));
      CHECK(r.ledger.imbalance() < 1e-9);
      CHECK(r.ledger.channels[0] + r.ledger.absorbed_at_surfaces + r.ledger.elsewhere == Approx(2.0));
    }
  }
  Model m = lit_floor(0.5);
  CHECK_THROWS_WITH(PatchLight(m.body, {"floor"}), Catch::Contains("the body must have one"));
  m.body.patches[4].name = "floor";
  CHECK_THROWS_WITH(PatchLight(m.body, {"floor"}), Catch::Contains("must be Absorber or Mirror"));
}

TEST_CASE("Connections carry the solid angle of their opening", "[readout]") {
  const Vec3d from{1e-3, -0.5e-3, 0.0};
  const OwenSobol s{9};
  const auto mean = [&](const auto& readout, int opening, auto&& f) {
    double sum = 0.0;
    for (std::uint32_t i = 0; i < 4096; ++i) {
      const Connection c = readout.connect(opening, from, s(i, 0), s(i, 1));
      sum += c.solid_angle_sr * f(c.direction) / 4096.0;
      CHECK(readout.channel(Escape{from, from, c.direction, -1}) >= 0);
    }
    return sum;
  };
  // Rectangle of half edges a, b whose foot is a corner: Ω = atan(ab/(d √(a² + b² + d²))).
  const Photodiodes corner({{from + Vec3d(2e-3, 1e-3, 3e-3), {2e-3, 0, 0}, {0, -1e-3, 0}}});
  CHECK(mean(corner, 0, [](const Vec3d&) { return 1.0; }) ==
        Approx(std::atan(4.0 * 2.0 / (3.0 * std::sqrt(16.0 + 4.0 + 9.0)))).epsilon(1e-4));
  // Disc seen from its axis: projected solid angle π R²/(R² + d²).
  const PinholeCamera camera({.position = from + Vec3d(0, 0, 4e-3),
      .view = -Vec3d::UnitZ(),
      .field_of_view_rad = 2.9,
      .aperture_m = 2e-3,
      .focus_m = 4e-3});
  CHECK(mean(camera, 0, [](const Vec3d& d) { return d.z(); }) == Approx(pi * 4.0 / 20.0).epsilon(1e-4));
}

TEST_CASE("The camera's image of a lit square: right pixels, right power, cos⁴", "[readout]") {
  // A square of white floor of 4 mm in a black box; the camera looks down from 20 mm above its middle.
  const double albedo = 0.8, radius = 0.05e-3, d = 20e-3;
  Model m = lit_floor(albedo, 4e-3, 0.2e-3);
  Patch black = m.body.patches[4];
  black.optics = Absorber{};
  m.body.patches.push_back(black);
  for (BoundaryFace& f : m.mesh.faces) {
    Vec3d middle = Vec3d::Zero();
    for (std::size_t k = 0; k < 3; ++k) middle += m.mesh.nodes[std::size_t(f.nodes[k])] / 3.0;
    if (f.patch == 4 && (middle.x() < 0.0 || middle.y() < 0.0))
      f.patch = 6;  // what stays white is the quadrant x > 0, y > 0
  }
  m.body.emitters = {DiscEmitter{{2e-3, 2e-3, -0.01e-3}, -Vec3d::UnitZ(), 1e-3}};
  const PinholeCamera camera({.position = {0, 0, d},
      .view = -Vec3d::UnitZ(),
      .up = Vec3d::UnitY(),
      .field_of_view_rad = 2.0 * std::atan(8e-3 / d),
      .columns = 16,
      .rows = 16,
      .aperture_m = radius,
      .focus_m = d});
  const Response r = traced(m, camera, 1 << 14);
  // Cells of 1 mm at the top face: columns 8 … 11 are x in (0, 4) mm, rows 4 … 7 are y in (4, 0) mm.
  CHECK(camera.pixel({0.5e-3, 3.5e-3, 0}) == 4 * 16 + 8);
  CHECK(camera.pixel({3.5e-3, 0.5e-3, 0}) == 7 * 16 + 11);
  CHECK(camera.pixel({0, 0, 30e-3}) == -1);
  CHECK(camera.pixel({9e-3, 0, 0}) == -1);
  double white = 0.0;
  for (int row = 0; row < 16; ++row)
    for (int column = 0; column < 16; ++column) {
      const double p = r.power_W[std::size_t(16 * row + column)];
      const bool lit = column >= 8 && column <= 11 && row >= 4 && row <= 7;
      const bool rim =
          column >= 7 && column <= 12 && row >= 3 && row <= 8;  // the floor lies 0.2 mm lower than what is sharp
      if (lit) white += p;
      if (!rim) CHECK(p == 0.0);
    }
  CHECK(r.power_W[5 * 16 + 9] > 4.0 * r.power_W[7 * 16 + 8]);  // the lamp stands above the middle of the square
  // All that the floor sends, albedo·1 W, with a cosine law: π a²/d² of its intensity on the axis, cos⁴ off it.
  const double off = std::hypot(2e-3, 2e-3) / d,
               exact = albedo * radius * radius / (d * d) / std::pow(1.0 + off * off, 2);
  CHECK(total(r) == Approx(exact).epsilon(0.04));
  CHECK(white > 0.9 * total(r));
}

TEST_CASE("Brightness: a Lambertian floor looks as bright from twice as far", "[readout]") {
  Model m = lit_floor(0.8, 6e-3, 1e-3);
  m.body.emitters = {RectangleEmitter{{0, 0, -0.01e-3}, {5e-3, 0, 0}, {0, -5e-3, 0}}};  // looks down
  // One pixel, an opening small against the distance: power = π L Ω_pixel-area … = L · A_opening · Ω_pixel, whatever
  // the distance.
  const auto look = [&](double distance, double fov_rad) {
    return traced(m,
        PinholeCamera({.position = {0, 0, distance},
            .view = -Vec3d::UnitZ(),
            .field_of_view_rad = fov_rad,
            .columns = 1,
            .rows = 1,
            .aperture_m = 0.2e-3,
            .focus_m = distance + 1e-3}),
        1 << 15)
        .power_W[0];
  };
  const double fov = 2.0 * std::atan(1e-3 / 21e-3);
  const double near = look(10e-3, fov), far = look(20e-3, fov);
  CHECK(near == Approx(far).epsilon(0.03));
  // Radiance of the floor's middle: nearly all of the lamp's light falls on it, 0.8 W/(π 100 mm²); pixel of solid angle
  // (2/21)².
  CHECK(far == Approx(0.8 / (pi * 1e-4) * pi * 0.2e-3 * 0.2e-3 * std::pow(2.0 / 21.0, 2)).epsilon(0.06));
}

TEST_CASE("A camera sees a symmetric state's both halves, though only one is traced", "[readout]") {
  Model m = lit_floor(0.9, 4e-3, 1e-3);
  m.body.symmetry = m.mesh.symmetry = {true, true};
  for (std::size_t k : {0u, 2u}) m.body.patches[k].shape = m.body.patches[k + 1].shape;
  m.body.emitters = {DiscEmitter{{0, 0, -0.1e-3}, -Vec3d::UnitZ(), 1e-3}};
  const PinholeCamera camera({.position = {2e-3, 1e-3, 10e-3},
      .view = {-0.2, -0.1, -1.0},
      .columns = 6,
      .rows = 6,
      .aperture_m = 0.3e-3,
      .focus_m = 10e-3});
  const Tracer<BeerLambert, PinholeCamera> tracer(few_rays<BeerLambert, PinholeCamera>(1 << 14), camera);
  const Response quarter = tracer.trace(m.body, m.mesh), full = tracer.trace(m.body, m.mesh, std::vector<Vec3d>{}, {});
  CHECK(total(quarter) == Approx(total(full)).epsilon(0.01));
  for (std::size_t k = 0; k < 36; ++k)
    CHECK(quarter.power_W[k] ==
          Approx(full.power_W[k]).margin(5.0 * std::hypot(quarter.error_W[k], full.error_W[k]) + 1e-3 * total(full)));
  CHECK(
      std::abs(full.power_W[14] - full.power_W[21]) > 10.0 * full.error_W[14]);  // the picture itself is not symmetric
  CHECK(quarter.rays < full.rays);
  CHECK_FALSE(tracer.image_channels(m.body, 0).has_value());
}

TEST_CASE("Broken cameras and photodiodes are refused by name", "[readout]") {
  CHECK_THROWS_AS(PinholeCamera({.view = Vec3d::UnitZ(), .up = Vec3d::UnitZ()}), InvalidArgument);
  CHECK_THROWS_AS(PinholeCamera({.columns = 0}), InvalidArgument);
  CHECK_THROWS_AS(PinholeCamera({.aperture_m = 0.0}), InvalidArgument);
  CHECK_THROWS_AS(PinholeCamera({.focus_m = -1.0}), InvalidArgument);
  CHECK_THROWS_AS(PinholeCamera({.field_of_view_rad = 3.5}), InvalidArgument);
  CHECK_THROWS_AS(Photodiodes({}), InvalidArgument);
  CHECK_THROWS_AS(Photodiodes({{Vec3d::Zero(), Vec3d::UnitX(), Vec3d::UnitX()}}), InvalidArgument);
  CHECK_THROWS_AS(Photodiodes({{Vec3d::Zero(), Vec3d::UnitX(), Vec3d::UnitY(), false, 0.0}}), InvalidArgument);
}
