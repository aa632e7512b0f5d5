#include "catch.hpp"
#include "lumo/support/embree.hpp"
#include "optics/scenes.hpp"

using namespace optics_test;

TEST_CASE("Embree's single precision agrees with the double precision tree", "[embree]") {
  PadShape s;
  s.cell = 4e-3;
  s.gap = 2e-3;
  s.medium = {1.41, 14.5063};
  const Model m = pad(s);
  const Dent d{1e-3, 1e-3, 5e-3, 4e-3, 3e-3};
  Tracer<BeerLambert>::Config c;
  Tracer<BeerLambert, ExitPower, Embree>::Config e;
  c.rays_per_emitter = e.rays_per_emitter = 1 << 12;
  c.carrier_rays = e.carrier_rays = 1 << 14;
  c.exit_rays = e.exit_rays = 1 << 18;
  const auto u = d.displacement(s, m.mesh);
  const auto phi = d.contact(s, m.mesh);
  const Response a = Tracer<BeerLambert>(c).trace(m.body, m.mesh, u, phi);
  const Response b = Tracer<BeerLambert, ExitPower, Embree>(e).trace(m.body, m.mesh, u, phi);
  CHECK((a.replicates.colwise().mean() - b.replicates.colwise().mean()).norm() < 1e-5);
  CHECK(b.ledger.lost < 1e-6);
  CHECK(b.ledger.imbalance() < 1e-9);
  const Response quarter = Tracer<BeerLambert, ExitPower, Embree>(e).trace(m.body, m.mesh);
  CHECK(std::abs(quarter.power_W[0] - quarter.power_W[10]) < 1e-6);
}

TEST_CASE("Embree far from the origin loses nothing", "[embree]") {
  const Model m = box(Vec3d::Constant(0.01), {1.41, 14.5}, 4, Vec3d(1000, -500, 30));
  const auto triangles = OpticalScene(m.body, m.mesh, {}, {}, {}).triangles();
  const EmbreeScene fast = Embree{}.build(triangles);
  const BvhScene exact = Bvh{}.build(triangles);
  const OwenSobol s{4};
  int differ = 0;
  for (std::uint32_t i = 0; i < 4096; ++i) {
    const Vec3d p = Vec3d(1000, -500, 30) + 0.0099 * (2.0 * Vec3d(s(i, 0), s(i, 1), s(i, 2)) - Vec3d::Ones());
    const Vec3d d = (Vec3d(s(i, 3), s(i, 4), s(i, 5)) - Vec3d::Constant(0.5)).normalized();
    const RayHit a = fast.first_hit(p, d, true), b = exact.first_hit(p, d, true);
    REQUIRE(bool(a));
    if (std::abs(a.t - b.t) > 1e-7) ++differ;
    CHECK(!fast.first_hit(p, d, false));
  }
  CHECK(differ == 0);
}
