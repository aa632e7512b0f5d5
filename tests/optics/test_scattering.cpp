#include "catch.hpp"
#include "optics/policies.hpp"

#include <fstream>
#include <sstream>

using namespace optics_test;

namespace {

/// A collimated beam, as a user would write it: no density of directions, so its light is traced forward.
struct Pencil {
  Vec3d center = Vec3d::Zero();
  Vec3d direction = -Vec3d::UnitZ();
  double power_W = 1.0;
  int channel = 0;

  Vec3d axis() const { return direction; }
  Vec3d point(double, double) const { return center; }
  Polar polar(double) const { return {0.0, 1.0}; }
  Pencil mirrored(const Vec3d& m) const {
    return {m.cwiseProduct(center), m.cwiseProduct(direction), power_W, channel};
  }
};
static_assert(EmitterModel<Pencil>);

// A wide slab under a beam that has just entered it; regions: top, bottom.
Model slab(double thickness, const lumo::Medium& medium) {
  Model m = box({0.1, 0.1, 0.5 * thickness}, medium, 2);
  m.body.emitters = {
      Pencil{{1e-4, 2e-4, 0.5 * thickness}}};  // off the middle: images of a path share their random numbers
  m.body.regions = 2;
  m.body.region = [](const Vec3d&, const Vec3d& n) { return n.z() > 0.5 ? 0 : n.z() < -0.5 ? 1 : -1; };
  return m;
}

}  // namespace

TEST_CASE("Henyey and Greenstein: moments of the angle, evenness at g = 0, and free paths", "[scattering]") {
  const int n = 20000;
  for (double g : {-0.8, -0.3, 0.0, 5e-5, 2e-4, 0.5, 0.9, 0.99}) {
    const ScatteringMedium medium(lumo::Medium{1.4, 200.0, 0.7, g});
    double first = 0.0, second = 0.0, third = 0.0, last = -1.0;
    for (int i = 0; i < n; ++i) {
      const double c = medium.scattering_cosine((i + 0.5) / n);
      CHECK(c >= last);
      last = c;
      first += c / n;
      second += 0.5 * (3.0 * c * c - 1.0) / n;
      third += 0.5 * (5.0 * c * c * c - 3.0 * c) / n;
    }
    // Its Legendre moments are powers of g.
    CHECK(first == Approx(g).margin(1e-6));
    CHECK(second == Approx(g * g).margin(1e-5));
    CHECK(third == Approx(g * g * g).margin(1e-5));
  }
  const ScatteringMedium medium(lumo::Medium{1.4, 200.0, 0.7, 0.5});
  for (double u : {0.1, 0.5, 0.9}) {
    const double s = medium.free_path_m(3e-3, u);
    CHECK((1.0 - std::exp(-200.0 * s)) / (1.0 - std::exp(-0.6)) == Approx(u));
  }
  CHECK(ScatteringMedium(lumo::Medium{1.4, 0.0, 0.7, 0.5}).free_path_m(3e-3, 0.25) == Approx(0.75e-3));
  CHECK(ScatteringMedium(lumo::Medium{1.4, 1e-9, 0.7, 0.5}).free_path_m(3e-3, 0.25) == Approx(0.75e-3));
  CHECK_THROWS_AS(ScatteringMedium(lumo::Medium{1.4, 1.0, 1.1, 0.0}), InvalidArgument);
  CHECK_THROWS_AS(ScatteringMedium(lumo::Medium{1.4, 1.0, 0.5, 1.0}), InvalidArgument);
  CHECK_THROWS_AS(ScatteringMedium(lumo::Medium{1.4, -1.0, 0.5, 0.0}), InvalidArgument);
}

TEST_CASE("Without albedo a scattering medium is Beer's, to the last bit", "[scattering]") {
  PadShape s;
  s.cell = 4e-3;
  s.gap = 2e-3;
  const Model m = pad(s);
  const Dent d{1e-3, 1e-3, 4e-3, 4e-3, 2e-3};
  const auto u = d.displacement(s, m.mesh);
  const auto phi = d.contact(s, m.mesh);
  const Response beer = Tracer<BeerLambert>(few_rays<BeerLambert, ExitPower>(1 << 10)).trace(m.body, m.mesh, u, phi);
  const Response turbid =
      Tracer<ScatteringMedium>(few_rays<ScatteringMedium, ExitPower>(1 << 10)).trace(m.body, m.mesh, u, phi);
  CHECK((beer.replicates.array() == turbid.replicates.array()).all());
  CHECK(beer.ledger.absorbed_in_medium == turbid.ledger.absorbed_in_medium);
  CHECK(beer.segments == turbid.segments);
}

TEST_CASE("Index-matched slab, albedo 0.9, g 0.75, optical depth 2: van de Hulst's reflection and transmission",
    "[scattering]") {
  // 0.09739 and 0.66096: van de Hulst, Multiple Light Scattering (1980), as quoted by Wang, Jacques & Zheng, MCML,
  // Comput. Meth. Prog. Biomed. 47 (1995), Table 1.
  const Model m = slab(0.2e-3, {1.0, 10000.0, 0.9, 0.75});
  auto c = few_rays<ScatteringMedium, ExitPower>(1 << 16);
  for (int exit_rays : {0, 1 << 10}) {  // a beam is never gathered, so that this changes nothing
    c.exit_rays = exit_rays;
    const Response r = Tracer<ScatteringMedium>(c).trace(m.body, m.mesh);
    CHECK(r.power_W[0] == Approx(0.09739).margin(4.0 * r.error_W[0]));
    CHECK(r.power_W[1] == Approx(0.66096).margin(4.0 * r.error_W[1]));
    CHECK(r.error_W[0] < 1.5e-3);
    CHECK(r.error_W[1] < 2e-3);
    CHECK(r.ledger.imbalance() < 1e-9);
    CHECK(r.direct.col(1).mean() == Approx(std::exp(-2.0)).epsilon(1e-9));
  }
}

TEST_CASE("Thick medium of index 1.5, albedo 0.9, scattering evenly: Giovanelli's reflectance", "[scattering]") {
  // 0.2600 with what the surface reflects at once: Giovanelli, Optica Acta 2 (1955), as quoted by Wang et al. (1995),
  // Table 2.
  const Model m = slab(8e-3, {1.5, 10000.0, 0.9, 0.0});
  const Response r = Tracer<ScatteringMedium>(few_rays<ScatteringMedium, ExitPower>(1 << 16)).trace(m.body, m.mesh);
  const double entered = 1.0 - fresnel(1.0, 1.0 / 1.5).reflectance;
  CHECK(1.0 - entered + entered * r.power_W[0] == Approx(0.2600).margin(4.0 * r.error_W[0]));
  CHECK(r.error_W[0] < 1.5e-3);
  CHECK(r.power_W[1] < 1e-6);
}

TEST_CASE("Thin slab: single scattering in closed form", "[scattering]") {
  // Depth τ « 1, evenly scattered, straight down: half of a τ goes up, less what is scattered or absorbed again on its
  // slanted way: R = (a/2) ∫∫ exp(−t) exp(−t/c) dt dc to first order in a, over t in (0, τ) and cosines c in (0, 1).
  const double tau = 0.02, albedo = 0.05;
  const Model m = slab(tau / 1000.0, {1.0, 1000.0, albedo, 0.0});
  double exact = 0.0;
  for (int i = 0; i < 4000; ++i) {
    const double c = (i + 0.5) / 4000.0;
    exact += 0.5 * albedo * (1.0 - std::exp(-tau * (1.0 + 1.0 / c))) / (1.0 + 1.0 / c) / 4000.0;
  }
  auto c = few_rays<ScatteringMedium, ExitPower>(1 << 14);
  c.scattered_below = c.roulette_below = 1e-4;  // what is scattered once is followed always
  const Response r = Tracer<ScatteringMedium>(c).trace(m.body, m.mesh);
  CHECK(r.power_W[0] == Approx(exact).margin(0.01 * exact + 4.0 * r.error_W[0]));
  CHECK(r.error_W[0] < 0.02 * exact);
}

TEST_CASE("Mitsuba 3 sees the same light leave a scattering box", "[scattering]") {
  std::ifstream file(LUMO_TEST_DATA "/mitsuba_scattering.csv");  // written by benchmarks/peers/mitsuba_scattering.py
  REQUIRE(file);
  int rows = 0;
  for (std::string line; std::getline(file, line);) {
    if (line.empty() || line[0] == '#' || line[0] == 'i') continue;
    std::replace(line.begin(), line.end(), ',', ' ');
    std::istringstream in(line);
    lumo::Medium medium;
    std::string face;
    double power = 0.0, error = 0.0;
    REQUIRE(in >> medium.refractive_index >> medium.extinction_per_m >> medium.scattering_albedo >> medium.anisotropy >>
            face >> power >> error);
    Model m = box({5e-3, 4e-3, 3e-3}, medium, 2);
    m.body.emitters = {RectangleEmitter{{-1e-3, 0.5e-3, -2.5e-3}, {1e-3, 0, 0}, {0, 1e-3, 0}, 1.0, 0}};
    m.body.regions = 1;
    const Vec3d seen = face == "top" ? Vec3d(0, 0, 1) : face == "side" ? Vec3d(1, 0, 0) : Vec3d(0, 0, -1);
    m.body.region = [seen](const Vec3d&, const Vec3d& n) { return n.dot(seen) > 0.5 ? 0 : -1; };
    const Response r = Tracer<ScatteringMedium>(few_rays<ScatteringMedium, ExitPower>(1 << 14)).trace(m.body, m.mesh);
    INFO(line << ": " << r.power_W[0] << " ± " << r.error_W[0]);
    CHECK(r.power_W[0] == Approx(power).margin(4.0 * std::hypot(error, r.error_W[0]) + 1e-3 * power));
    CHECK(r.error_W[0] < 0.04 * power);
    CHECK(error < 0.01 * power);
    ++rows;
  }
  CHECK(rows == 12);
}
