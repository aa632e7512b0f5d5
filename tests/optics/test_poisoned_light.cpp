#include "catch.hpp"
#include "optics/scenes.hpp"
#include "random_poison.hpp"

using namespace optics_test;

namespace {

struct LightInputs {
  Model lit = box({5e-3, 4e-3, 3e-3}, {1.41, 20.0, 0.3, 0.5}, 2);
  RectangleEmitter lamp{{0, 0, -1e-3}, {1e-3, 0, 0}, {0, 1e-3, 0}};
  Tracer<ScatteringMedium>::Config rays;
  std::vector<Vec3d> displacement;

  LightInputs() {
    lit.body.patches[4].optics = Lambertian{0.7};
    lit.body.patches[0].optics = Mirror{0.5};
    lit.body.surroundings = {1.0};
    lit.body.regions = 2;
    lit.body.region = [](const Vec3d& p, const Vec3d& n) { return n.x() > 0.5 ? int(p.y() > 0.0) : -1; };
    rays.rays_per_emitter = rays.carrier_rays = rays.exit_rays = 64;
    displacement.assign(lit.mesh.nodes.size(), Vec3d(1e-5, 0.0, -1e-5));
  }
};

lumo::test::Poisonable numbers_of(LightInputs& in) {
  lumo::test::Poisonable at;
  for (int weight = 0; weight < 10; ++weight) {
    for (Medium* m : {&in.lit.body.medium, &in.lit.body.surroundings})
      for (double* x : {&m->refractive_index, &m->extinction_per_m, &m->scattering_albedo, &m->anisotropy})
        at.numbers.push_back(x);
    auto& c = in.rays;
    for (double* x : {&in.lamp.power_W, &std::get<Lambertian>(in.lit.body.patches[4].optics).albedo,
             &std::get<Mirror>(in.lit.body.patches[0].optics).reflectance, &c.roulette_below, &c.scattered_below,
             &c.largest_lost, &c.scene.carrier_gap_m, &c.scene.carrier_cell_m})
      at.numbers.push_back(x);
    for (Vec3d* v : {&in.lamp.center, &in.lamp.half_u, &in.lamp.half_v, &in.lit.body.seen_towards}) at.add(*v);
    for (Patch& p : in.lit.body.patches) {
      at.add(std::get<Plane>(p.shape).point);
      at.add(std::get<Plane>(p.shape).direction);
    }
    at.indices.insert(
        at.indices.end(), {&in.lamp.channel, &in.lit.body.regions, &c.rays_per_emitter, &c.replicates, &c.carrier_rays,
                              &c.exit_rays, &c.max_events, &c.scene.sub_facets, &in.lit.mesh.order});
  }
  for (Vec3d& n : in.lit.mesh.nodes) at.add(n);
  for (Vec3d& u : in.displacement) at.add(u);
  for (BoundaryFace& f : in.lit.mesh.faces) {
    for (int& n : f.nodes) at.indices.push_back(&n);
    at.indices.push_back(&f.patch);
  }
  return at;
}

bool finite_light(const LightInputs& in) {
  Body body = in.lit.body;
  body.emitters = {in.lamp};
  const Response r = Tracer<ScatteringMedium>(in.rays).trace(body, in.lit.mesh, in.displacement, {});
  const EnergyLedger& l = r.ledger;
  for (const double x : {l.emitted, l.to_indenter, l.elsewhere, l.absorbed_in_medium, l.absorbed_at_surfaces,
           l.roulette, l.refinement, l.lost})
    if (!std::isfinite(x)) return false;
  for (std::size_t k = 0; k < r.power_W.size(); ++k)
    if (!std::isfinite(r.power_W[k]) || !std::isfinite(r.error_W[k])) return false;
  return r.replicates.allFinite();
}

void check_poisoned_light(int count, unsigned seed) {
  const LightInputs sound;
  REQUIRE(finite_light(sound));
  const auto ended = lumo::test::poison_at_random(sound, count, seed, numbers_of, finite_light);
  INFO(ended.refused << " refused, " << ended.answered << " answered");
  CHECK(ended.not_finite == 0);
  CHECK(ended.odd == 0);
  CHECK(ended.refused > count / 4);
}

}  // namespace

TEST_CASE("poisoned inputs of a trace are refused, or answered by finite numbers") { check_poisoned_light(1000, 1); }

TEST_CASE("ten thousand poisoned traces", "[long]") { check_poisoned_light(10'000, 2); }
