#include "kernel.hpp"
#include "pad.hpp"

#include "lumo/optics/bvh.hpp"
#include "lumo/optics/scattering_medium.hpp"
#include "lumo/optics/surface_optics.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/support/embree.hpp"

#include <utility>

using namespace lumo;
using namespace lumo::micro;

namespace {

OpticalScene pressed_scene(const PressedPad& pad) {
  return {pad.body, pad.mesh, {pad.state.displacement, pad.state.contact_field}, {true, true}, {}};
}

struct Ray {
  Vec3d origin, direction;
};

/// Rays as paths have them: from a point of the surface inwards, in all directions.
std::vector<Ray> inner_rays(const OpticalScene& scene, std::uint32_t count) {
  const OwenSobol u{11};
  std::vector<Ray> rays;
  for (std::uint32_t i = 0; i < count; ++i) {
    const int t = int(u(i, 0) * double(scene.triangles().size()));
    if (!scene.on_body(t)) continue;
    const auto& c = scene.triangles()[std::size_t(t)].corners;
    const Vec3d middle = (c[0] + c[1] + c[2]) / 3.0, n = scene.flat_normal(t);
    Vec3d d = (2.0 * Vec3d(u(i, 1), u(i, 2), u(i, 3)) - Vec3d::Ones()).normalized();
    if (d.dot(n) > 0.0) d = -d;
    rays.push_back({middle, d});
  }
  return rays;
}

template <class Scene> double total_length(const Scene& scene, const std::vector<Ray>& rays) {
  double sum = 0.0;
  for (const Ray& r : rays)
    if (const RayHit hit = scene.first_hit(r.origin, r.direction, true)) sum += hit.t;
  return sum;
}

/// What Tracer::trace sets up, and each of its steps alone, on a quarter of the pressed pad.
template <TransparentMedium Medium, Intersector Backend> struct Steps {
  using Scene = decltype(Backend{}.build({}));
  using Path = PathTracer<Scene, Medium, ExitPower>;
  using Gather = NextEventGather<Scene, Medium, ExitPower>;
  static constexpr Symmetry symmetry{true, true};

  const PressedPad& pad = pressed_pad();
  Medium medium;
  OpticalScene surface = pressed_scene(pad);
  Scene scene = Backend{}.build(surface.triangles());
  LightNodes nodes{surface, symmetry};
  FaceSet exits{surface, symmetry, {.whole = true, .total = 4096.0, .least = 2},
      [&](int t) { return is_dielectric(surface.optics(t)) && surface.has_region(t / surface.triangles_per_face()); }};
  ExitPower readout;
  LitBody<Scene, Medium, ExitPower> lit{surface, scene, medium, BeerLambert(pad.body.surroundings).refractive_index(),
      readout, pad.body.regions, nodes, exits, symmetry};
  Path path{lit, PathLimits{0.005, 0.25, 4096}};
  RayPattern pattern{pad.body.emitters, 512, symmetry};
  std::vector<double> sent = std::vector<double>(nodes.size(), 1.0 / double(nodes.size()));

  explicit Steps(const Medium& m) : medium(m) {}
  Steps(const Steps&) = delete;
  Steps& operator=(const Steps&) = delete;

  Tally follow() {
    for (const RayPattern::Beam& beam : pattern.beams())
      for (std::uint32_t i = 0; i < beam.rays; ++i)
        path.run({RayPattern::ray(beam, OwenSobol{5}, i), beam.mirror, beam.power_W});
    return path.accounts().take();
  }
  Tally spread() {
    Splatting splatting(path);
    for (const RayPattern::Beam& beam : pattern.beams()) splatting.run(beam, OwenSobol{5});
    return path.accounts().take();
  }
  /// Light that leaves is gathered backwards from 4,096 points of the readout's faces, mirror images included.
  double gather() {
    Tally total = path.accounts().take();
    Gather(pad.body.emitters, lit, path, pad.body.film_closes_m).run(OwenSobol{7}, sent, total);
    return total.ledger.channels[5];
  }
  std::uint32_t exit_points() const {
    std::uint32_t sum = 0;
    for (std::size_t k = 0; k < exits.size(); ++k) sum += exits[k].count;
    return sum;
  }
};

template <class S> void check_power(S& steps) {
  const Tally once = steps.follow();
  double fallen = 0.0;  // on Lambertian faces, from where it would go on
  for (const auto& [node, power] : once.arrived) fallen += power;
  REQUIRE(std::abs(once.ledger.accounted() + fallen - once.ledger.emitted) < 1e-9 * once.ledger.emitted);
}

}  // namespace

TEST_CASE("optics: the scene", "[optics]") {
  const PressedPad& pad = pressed_pad();
  const OpticalScene surface = pressed_scene(pad);
  const std::vector<SceneTriangle>& triangles = surface.triangles();
  BENCHMARK(
      named("surface as light meets it", message(pad.mesh.faces.size(), " faces, ", triangles.size(), " triangles"))) {
    return pressed_scene(pad);
  };

  const std::string size = message(triangles.size(), " triangles");
  BENCHMARK(named("tree built", size, "Bvh")) { return Bvh{}.build(triangles); };
  BENCHMARK(named("tree built", size, "Embree")) { return Embree{}.build(triangles); };

  const BvhScene own = Bvh{}.build(triangles);
  const EmbreeScene embree = Embree{}.build(triangles);
  const std::vector<Ray> rays = inner_rays(surface, 4096);
  REQUIRE(std::abs(total_length(own, rays) / total_length(embree, rays) - 1.0) < 1e-3);
  const std::string input = message(rays.size(), " rays inside, ", triangles.size(), " triangles");
  BENCHMARK(named("nearest hit", input, "Bvh")) { return total_length(own, rays); };
  BENCHMARK(named("nearest hit", input, "Embree")) { return total_length(embree, rays); };

  std::vector<std::pair<int, Vec3d>> hits;
  for (const Ray& r : rays)
    if (const RayHit hit = own.first_hit(r.origin, r.direction, true); hit && surface.on_body(hit.triangle))
      hits.emplace_back(hit.triangle, r.origin + hit.t * r.direction);
  BENCHMARK(named("place and normal of a hit", message(hits.size(), " hits"))) {
    Vec3d sum = Vec3d::Zero();
    for (const auto& [triangle, at] : hits) sum += surface.smooth_normal(surface.locate(triangle, at));
    return sum;
  };
}

TEST_CASE("optics: at an interface", "[optics]") {
  const std::vector<Vec3d> u = points_in(Vec3d::Zero(), Vec3d::Ones(), 4096, 13);
  BENCHMARK(named("Fresnel", "4096 angles", "into air")) {
    double sum = 0.0;
    for (const Vec3d& v : u) sum += fresnel(v.x(), 1.4348).reflectance;
    return sum;
  };
  BENCHMARK(named("Fresnel", "4096 angles", "into silicone")) {
    double sum = 0.0;
    for (const Vec3d& v : u) sum += fresnel(v.x(), 1.0 / 1.4348).reflectance;
    return sum;
  };
}

TEST_CASE("optics: paths", "[optics]") {
  const PressedPad& pad = pressed_pad();
  Medium turbid = pad.body.medium;
  turbid.scattering_albedo = 0.5;
  turbid.anisotropy = 0.8;
  Steps<BeerLambert, Bvh> own{BeerLambert(pad.body.medium)};
  Steps<BeerLambert, Embree> fast{BeerLambert(pad.body.medium)};
  Steps<ScatteringMedium, Bvh> scattering{ScatteringMedium(turbid)};
  check_power(own);
  check_power(fast);
  check_power(scattering);
  const std::string paths = message(own.path.rays, " paths of ", own.path.segments, " straight pieces");
  BENCHMARK(named("paths from the LEDs", paths, "Bvh")) { return own.follow(); };
  BENCHMARK(named("paths from the LEDs", paths, "Embree")) { return fast.follow(); };
  BENCHMARK(named("paths from the LEDs",
      message(scattering.path.rays, " paths of ", scattering.path.segments, " straight pieces"),
      "Bvh, a medium that scatters")) {
    return scattering.follow();
  };
  BENCHMARK(named("paths, spread between neighbours", paths, "Bvh")) { return own.spread(); };
  BENCHMARK(named("paths, spread between neighbours", paths, "Embree")) { return fast.spread(); };
  const std::string points = message(own.exit_points(), " points of the readout's faces");
  REQUIRE(std::abs(own.gather() / fast.gather() - 1.0) < 1e-3);
  BENCHMARK(named("light gathered at the exits", points, "Bvh")) { return own.gather(); };
  BENCHMARK(named("light gathered at the exits", points, "Embree")) { return fast.gather(); };
  const std::string triangles = message(own.surface.triangles().size(), " triangles");
  BENCHMARK(named("nodes of Lambertian faces", triangles)) { return LightNodes(own.surface, own.symmetry).size(); };
  BENCHMARK(named("samples of the carrier's faces numbered", triangles)) {
    return FaceSet(own.surface, own.symmetry, {.total = 4096.0}, [&](int t) { return own.nodes.of(t)[0] >= 0; }).size();
  };
}

// All steps together: scene, paths, exchange between carrier faces, gathering at the exits; one ray for 32 of an
// evaluation.
TEST_CASE("optics: responses", "[optics]") {
  const PressedPad& pad = pressed_pad();
  const auto configured = [](auto config) {
    config.rays_per_emitter /= 32;
    config.carrier_rays /= 32;
    config.exit_rays /= 32;
    return config;
  };
  using Own = Tracer<BeerLambert, ExitPower, Bvh>;
  using Fast = Tracer<BeerLambert, ExitPower, Embree>;
  const Own own(configured(Own::Config{}));
  const Fast fast(configured(Fast::Config{}));
  const Symmetry symmetry{true, true};
  const Response response = own.trace(pad.body, pad.mesh, pad.state, symmetry);
  REQUIRE(response.ledger.imbalance() < 1e-9);
  const std::string input = message(response.segments, " straight pieces, ", response.rays, " rays");
  BENCHMARK(named("exit power of a pressed pad", input, "Bvh")) {
    return own.trace(pad.body, pad.mesh, pad.state, symmetry).power_W;
  };
  BENCHMARK(named("exit power of a pressed pad", input, "Embree")) {
    return fast.trace(pad.body, pad.mesh, pad.state, symmetry).power_W;
  };
}
