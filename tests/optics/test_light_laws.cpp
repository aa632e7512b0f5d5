#include "catch.hpp"
#include "optics/scenes.hpp"

#include <functional>

using namespace optics_test;

namespace {

using Config = Tracer<BeerLambert>::Config;

Config config(int rays, double roulette) {
  Config c;
  c.rays_per_emitter = rays;
  c.replicates = 4;
  c.carrier_rays = 1 << 14;
  c.exit_rays = 1 << 18;
  c.roulette_below = roulette;
  c.scene.sub_facets = 2;
  return c;
}

// ∫ f(c) 2 c dc over the hemisphere's cosines: a cosine law.
double hemisphere(const std::function<double(double)>& f) {
  const int n = 20000;
  double sum = 0.0;
  for (int i = 0; i < n; ++i) {
    const double c = (i + 0.5) / n;
    sum += f(c) * 2.0 * c / n;
  }
  return sum;
}

// A wide flat box of height h with an emitter at its bottom; the top is region 0.
Model slab(double h, const lumo::Medium& medium, const SurfaceOptics& bottom) {
  Model m = box({50e-3, 50e-3, 0.5 * h}, medium, 2);
  m.body.patches[4].optics = bottom;
  m.body.emitters = {RectangleEmitter{{1e-4, 2e-4, -0.5 * h}, {1e-4, 0, 0}, {0, 1e-4, 0}, 2.0, 0}};
  m.body.regions = 1;
  m.body.region = [](const Vec3d&, const Vec3d& n) { return n.z() > 0.5 ? 0 : -1; };
  return m;
}

}  // namespace

TEST_CASE("Slab without a refractive step: Beer–Lambert under a cosine law", "[light]") {
  const double h = 2e-3, mu = 200.0;
  const Model m = slab(h, {1.0, mu}, Absorber{});
  const Response r = Tracer<BeerLambert>(config(1 << 14, 0.0)).trace(m.body, m.mesh);
  const double exact = 2.0 * hemisphere([&](double c) { return std::exp(-mu * h / c); });
  CHECK(r.power_W[0] == Approx(exact).margin(1e-3 * exact + 4.0 * r.error_W[0]));
  CHECK(r.direct.sum() == Approx(r.replicates.sum()));
  CHECK(r.ledger.emitted == Approx(2.0));
}

TEST_CASE("Slab of silicone on black ground: first Fresnel transmission", "[light]") {
  const double h = 2e-3, mu = 71.38, n = 1.4348;
  const Model m = slab(h, {n, mu}, Absorber{});
  const Response r = Tracer<BeerLambert>(config(1 << 14, 0.0)).trace(m.body, m.mesh);
  const double exact =
      2.0 * hemisphere([&](double c) { return (1.0 - fresnel(c, n).reflectance) * std::exp(-mu * h / c); });
  CHECK(r.power_W[0] == Approx(exact).margin(1e-3 * exact + 4.0 * r.error_W[0]));
  CHECK(r.ledger.lost == 0.0);
}

TEST_CASE("Slab on a perfect mirror: everything in the escape cone comes out in the end", "[light]") {
  const double n = 1.41;
  const Model m = slab(0.2e-3, {n, 0.0}, Mirror{1.0});
  Config c = config(1 << 12, 1e-3);
  c.largest_lost = 1.0;  // beyond the critical angle light is caught for good
  const Response r = Tracer<BeerLambert>(c).trace(m.body, m.mesh);
  const double exact = 2.0 * (1.0 - (1.0 - 1.0 / (n * n)));  // share of the cosine law below the critical angle
  CHECK(r.power_W[0] == Approx(exact).margin(2e-3 * exact + 4.0 * r.error_W[0]));
}

TEST_CASE("Sphere with a source in its centre: every ray is normal, passes sum up in closed form", "[light]") {
  const double radius = 5e-3, n = 1.4348, mu = 71.38;
  Model m = sphere(radius, {n, mu});
  m.body.emitters = {RectangleEmitter{Vec3d::Zero(), {1e-7, 0, 0}, {0, 1e-7, 0}, 1.0, 0}};
  const Response r = Tracer<BeerLambert>(config(1 << 10, 0.0)).trace(m.body, m.mesh);
  const double r0 = fresnel(1.0, n).reflectance, t = std::exp(-mu * radius);
  const double exact = (1.0 - r0) * t / (1.0 - r0 * t * t);
  CHECK(r.ledger.elsewhere == Approx(exact).epsilon(1e-3));
  CHECK(r.ledger.elsewhere + r.ledger.absorbed_in_medium == Approx(1.0).epsilon(1e-9));
}

TEST_CASE("Long light pipe: what is totally reflected at the sides reaches the end", "[light]") {
  const double n = 1.5;
  Model m = box({1e-3, 1e-3, 0.3}, {n, 0.0}, 2);
  m.body.patches[4].optics = m.body.patches[5].optics = Absorber{};
  m.body.emitters = {RectangleEmitter{{0, 0, -0.3}, {1e-3, 0, 0}, {0, 1e-3, 0}, 1.0, 0}};
  // Sampling error of both shares: 1.7e-3 rms over seeds. Rays at more than 4096 bounces, 7e-4 of the power, are given
  // up.
  Config settings = config(1 << 14, 1e-3);
  settings.largest_lost = 1e-3;
  const Response r = Tracer<BeerLambert>(settings).trace(m.body, m.mesh);
  // In the disc of projected directions: |x| and |y| below the critical cosine. 2c² > 1, so the square cuts four caps
  // off.
  const double c = std::sqrt(1.0 - 1.0 / (n * n)), cap = std::acos(c) - c * std::sqrt(1.0 - c * c);
  const double guided = 1.0 - 4.0 * cap / pi;
  CHECK(r.ledger.absorbed_at_surfaces == Approx(guided).margin(5e-3));
  CHECK(r.ledger.elsewhere == Approx(1.0 - guided).margin(5e-3));
}

TEST_CASE("Integrating sphere: the port takes f/(1 − a(1 − f))", "[light]") {
  const double radius = 10e-3, albedo = 0.9;
  Model m = sphere(radius, {1.0, 0.0}, 10);
  Patch port = m.body.patches[0];
  m.body.patches[0].optics = Lambertian{albedo};
  m.body.patches.push_back(port);
  double open = 0.0, all = 0.0;
  for (BoundaryFace& f : m.mesh.faces) {
    const auto p = [&](std::size_t k) { return m.mesh.nodes[std::size_t(f.nodes[k])]; };
    const double a = (p(1) - p(0)).cross(p(2) - p(0)).norm();
    const Vec3d mean = (p(0) + p(1) + p(2)) / 3.0;
    if (mean.z() > 0.75 * radius) {
      f.patch = 1;
      open += a;
    }
    all += a;
  }
  m.body.emitters = {RectangleEmitter{{0, 0, -0.9999 * radius}, {1e-6, 0, 0}, {0, 1e-6, 0}, 1.0, 0}};
  const Response r = Tracer<BeerLambert>(config(1 << 14, 0.0)).trace(m.body, m.mesh);
  const double f = open / all, exact = f / (1.0 - albedo * (1.0 - f));
  CHECK(r.ledger.elsewhere == Approx(exact).epsilon(0.01));
  CHECK(r.ledger.imbalance() < 1e-9);
}

TEST_CASE("White furnace: without absorption all light leaves the finger", "[light]") {
  PadShape s;
  s.medium.extinction_per_m = 0.0;
  s.albedo = 1.0;
  s.cell = 4e-3;
  for (double gap : {0.0, 2e-3}) {
    s.gap = gap;
    const Model m = pad(s);
    const Response r = Tracer<BeerLambert>(config(1 << 11, 0.1)).trace(m.body, m.mesh);
    double out = r.ledger.elsewhere;
    for (double p : r.power_W) out += p;
    CHECK(r.ledger.absorbed_in_medium == 0.0);
    CHECK(r.ledger.absorbed_at_surfaces == Approx(0.0).margin(1e-9));
    CHECK(out == Approx(1.0).margin(0.02));
    CHECK(r.ledger.imbalance() < 1e-9);
    CHECK(r.ledger.lost < 1e-3);  // light that circles for ever between smooth faces
  }
}

TEST_CASE("a lamp however near below a clear face sends through it what Fresnel lets pass", "[light]") {
  const double n = 1.41, half = 2e-3;
  Model m = box({10e-3, 10e-3, half}, {n, 0.0}, 2);
  for (Patch& p : m.body.patches) p.optics = Absorber{};
  m.body.patches[5].optics = Dielectric{};
  m.body.regions = 1;
  m.body.region = [](const Vec3d&, const Vec3d& out) { return out.z() > 0.5 ? 0 : -1; };
  const auto passes = [&](double c) {
    const double s = n * std::sqrt(1.0 - c * c);
    return s >= 1.0 ? 0.0 : 1.0 - fresnel(c, n).reflectance;
  };
  const double disc = hemisphere(passes), point = hemisphere([&](double c) { return passes(c) / (2.0 * c) / 2.0; });
  CHECK(disc == Approx(0.46359).margin(2e-5));
  CHECK(point == Approx(0.13486).margin(2e-5));
  for (const double below : {1e-3, 0.5e-3, 0.2e-3, 0.1e-3, 0.01e-3}) {
    const Vec3d at(0.3e-3, 0.2e-3, half - below);
    for (const auto& [lamp, exact] : {std::pair(Emitter(PointEmitter{at}), point),
             std::pair(Emitter(DiscEmitter{at, Vec3d::UnitZ(), 0.4e-3, 1.0, 0}), disc)}) {
      m.body.emitters = {lamp};
      const Response r = Tracer<BeerLambert>{}.trace(m.body, m.mesh);
      INFO(below * 1e3 << " mm below, " << r.power_W[0] << " +- " << r.error_W[0]);
      CHECK(std::abs(r.power_W[0] - exact) < 4.0 * r.error_W[0] + 1e-5);
      CHECK(r.error_W[0] < 2e-3 * exact);
      CHECK(r.ledger.imbalance() < 1e-9);
      CHECK(std::abs(r.ledger.refinement) < 1e-3);
    }
  }
}
