#include "catch.hpp"
#include "lumo/optics/tracer.hpp"
#include "optics/scenes.hpp"

#include <cmath>

using namespace lumo;
using namespace optics_test;

namespace {

// A clear slab 40 × 40 × 4 mm, its top at z = 2 mm, black but for it.
Model slab() {
  Model m = box(Vec3d(20e-3, 20e-3, 2e-3), {1.41, 0.0}, 4);
  for (std::size_t k = 0; k < m.body.patches.size(); ++k)
    m.body.patches[k].optics = k == 5 ? SurfaceOptics(Dielectric{}) : SurfaceOptics(Absorber{});
  m.body.regions = 1;
  m.body.region = [](const Vec3d&, const Vec3d& n) { return n.z() > 0.5 ? 0 : -1; };
  return m;
}

Tracer<BeerLambert> forward() {
  return Tracer<BeerLambert>({.rays_per_emitter = 1 << 12, .carrier_rays = 1 << 6, .exit_rays = 0});
}

Response lit_by(const Emitter& lamp) {
  Model m = slab();
  m.body.emitters = {lamp};
  return forward().trace(m.body, m.mesh);
}

const double top = 2e-3;

}  // namespace

TEST_CASE("a lamp out of the medium is refused with its place and how far out it is", "[lamps]") {
  for (const double below_mm : {-0.01, -1.0, -3000.0, 4.01, 5.0}) {  // above the top, mm for m, under the black floor
    const Vec3d at(0.3e-3, 0.2e-3, top - 1e-3 * below_mm);
    INFO(below_mm);
    const std::string apart = message(below_mm < 0.0 ? -below_mm : below_mm - 4.0, " mm outside");
    for (const Emitter& lamp : {Emitter(PointEmitter{at}), Emitter(DiscEmitter{at, Vec3d::UnitZ(), 0.4e-3}),
             Emitter(DiscEmitter{at, -Vec3d::UnitZ(), 0.4e-3}), Emitter(DiscEmitter{at, Vec3d::UnitX(), 1e-6}),
             Emitter(RectangleEmitter{at, {1e-3, 0, 0}, {0, 1e-3, 0}})}) {
      if (lamp.as<DiscEmitter>() && lamp.axis().x() == 1.0 && std::abs(below_mm) < 0.1) continue;  // half a radius off
      CHECK_THROWS_WITH(lit_by(lamp), Catch::Contains("emitter 0 at (0.3, 0.2, ") &&
                                          Catch::Contains(apart.substr(0, 4)) && Catch::Contains("mm outside of it"));
    }
  }
}

TEST_CASE("a lamp of which only a part is outside is refused, the second by its number", "[lamps]") {
  Model m = slab();
  m.body.emitters = {PointEmitter{{0, 0, 0}}, DiscEmitter{{19.7e-3, 0, 0}, Vec3d::UnitZ(), 0.4e-3}};
  CHECK_THROWS_WITH(forward().trace(m.body, m.mesh), Catch::Contains("emitter 1") && Catch::Contains("0.1 mm outside"));
  m.body.emitters = {RectangleEmitter{{0, 0, 1.5e-3}, {0, 1e-3, 0}, {0, 0, 1e-3}}};
  CHECK_THROWS_WITH(forward().trace(m.body, m.mesh), Catch::Contains("0.5 mm outside"));
}

TEST_CASE("a lamp inside or on the surface is lit, however near", "[lamps]") {
  for (const double below_mm : {3.99, 2.0, 0.1, 0.01, 1e-4}) {
    const Vec3d at(0.3e-3, 0.2e-3, top - 1e-3 * below_mm);
    CHECK(lit_by(PointEmitter{at}).power_W[0] == Approx(0.1349).epsilon(0.05));  // Fresnel over the hemisphere
    CHECK(lit_by(DiscEmitter{at, Vec3d::UnitZ(), 0.4e-3}).power_W[0] == Approx(0.4636).epsilon(0.02));
  }
  // On the black floor, looking up: as lamps are on a stem.
  CHECK(lit_by(DiscEmitter{{0, 0, -top}, Vec3d::UnitZ(), 0.4e-3}).power_W[0] == Approx(0.4636).epsilon(0.02));
  CHECK(lit_by(RectangleEmitter{{0, 0, -top}, {1e-3, 0, 0}, {0, 1e-3, 0}}).power_W[0] == Approx(0.4636).epsilon(0.02));
}

TEST_CASE("a lamp in air starts out of the body", "[lamps]") {
  const auto lamp = [](double z, bool up) {
    return RectangleEmitter{{0, 0, z}, {1e-3, 0, 0}, {0, up ? 1e-3 : -1e-3, 0}, 1.0, 0, true};
  };
  CHECK_THROWS_WITH(
      lit_by(lamp(0.0, false)), Catch::Contains("radiates into the air") && Catch::Contains("2 mm inside the body"));
  CHECK_THROWS_WITH(lit_by(lamp(top - 1e-4, false)), Catch::Contains("0.1 mm inside the body"));
  CHECK_NOTHROW(lit_by(lamp(top + 1e-3, false)));
  CHECK_NOTHROW(lit_by(lamp(top, false)));
}

TEST_CASE("a body that moved away from a lamp is not blamed for more than it moved", "[lamps]") {
  Model m = slab();
  m.body.emitters = {PointEmitter{{0, 0, 1e-3}}};
  std::vector<Vec3d> down(m.mesh.nodes.size(), Vec3d(0, 0, -1e-4));
  CHECK_NOTHROW(forward().trace(m.body, m.mesh, down, {}));
  m.body.emitters = {PointEmitter{{0, 0, 3.0}}};  // mm for m
  CHECK_THROWS_WITH(forward().trace(m.body, m.mesh, down, {}), Catch::Contains("outside of it"));
  // Light that starts outside of what is left by the body is lost, which is an error.
  m.body.emitters = {PointEmitter{{0, 0, 1e-3}}};
  down.assign(down.size(), Vec3d(0, 0, -1.5e-3));
  CHECK_THROWS_WITH(forward().trace(m.body, m.mesh, down, {}), Catch::Contains("is lost"));
}

TEST_CASE("light that is lost beyond a millionth is no result, also of what is joined", "[lamps]") {
  Model m = slab();
  for (Patch& p : m.body.patches) p.optics = Dielectric{};  // light is caught in the slab for good
  m.body.emitters = {PointEmitter{{0, 0, 0}}};
  Tracer<BeerLambert>::Config config{.rays_per_emitter = 1 << 8, .carrier_rays = 1 << 6, .exit_rays = 0};
  config.roulette_below = 0.0;
  config.max_events = 4;
  const Tracer<BeerLambert> hasty(config);
  CHECK_THROWS_WITH(
      hasty.trace(m.body, m.mesh), Catch::Contains("of the emitted power is lost") && Catch::Contains("max_events"));
  std::vector<Response> parts;
  for (int k = 0; k < 4; ++k) parts.push_back(hasty.portion(2 * k, 2).trace(m.body, m.mesh));
  CHECK_THROWS_AS(require_closed(Tracer<BeerLambert>::joined(parts).ledger), NumericalError);
  config.largest_lost = 1.0;
  CHECK(Tracer<BeerLambert>(config).trace(m.body, m.mesh).ledger.lost > 0.1);
  for (const double bad : {std::nan(""), -1.0, 2.0}) {
    config.largest_lost = bad;
    CHECK_THROWS_AS(Tracer<BeerLambert>(config).trace(m.body, m.mesh), InvalidArgument);
  }

  EnergyLedger ledger;
  ledger.emitted = 2.0;
  ledger.elsewhere = 2.0;
  CHECK_NOTHROW(require_closed(ledger));
  ledger.elsewhere = 2.0 - 1e-6;
  ledger.lost = 1e-6;
  CHECK_NOTHROW(require_closed(ledger));
  ledger.lost = 3e-6;
  CHECK_THROWS_AS(require_closed(ledger), NumericalError);
  ledger.lost = 0.0;
  CHECK_THROWS_WITH(require_closed(ledger), Catch::Contains("unaccounted"));
  ledger.elsewhere = std::nan("");
  CHECK_THROWS_AS(require_closed(ledger), NumericalError);
}

TEST_CASE("a patch of the wrong shape is refused", "[lamps]") {
  Model m = sphere(10e-3, {1.41, 0.0});
  m.body.regions = 1;
  m.body.region = [](const Vec3d&, const Vec3d&) { return 0; };
  m.body.emitters = {PointEmitter{{0, 0, 0}}};
  CHECK_NOTHROW(forward().trace(m.body, m.mesh));
  m.body.patches[0] = {};  // a plane
  m.body.patches[0].name = "skin";
  CHECK_THROWS_WITH(forward().trace(m.body, m.mesh), Catch::Contains("patch \"skin\" has nodes up to 10 mm off"));
  m.body.patches[0].shape = SphereShape{Vec3d::Zero(), 10.01e-3};
  CHECK_THROWS_AS(forward().trace(m.body, m.mesh), MeshError);
}
