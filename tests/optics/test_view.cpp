#include "catch.hpp"
#include "lumo/optics/camera_cone.hpp"
#include "optics/policies.hpp"

#include <algorithm>

using namespace optics_test;

namespace {

struct OneLine {
  Vec3d origin, direction;
  int pixels() const { return 1; }
  SightLine line(int, const std::array<double, 4>&) const { return {origin, direction.normalized(), 1.0}; }
};
static_assert(View<OneLine>);

// Power that leaves each region, from radiance: points all over the faces of the body and cosine-distributed
// directions. A line whose way out is blocked counts nothing, as light on it does not leave for good there.
class RegionPower {
 public:
  RegionPower(const Body& body, const TetMesh& mesh, const SurfaceState& state, Symmetry images)
      : surface_(body, mesh, state, images, {.sub_facets = 1}),
        scene_(Bvh{}.build(surface_.triangles())),
        regions_(std::size_t(body.regions)) {
    for (int t = 0; t < int(surface_.triangles().size()); ++t)
      for (Region& r : regions_) {
        if (!surface_.on_body(t) || !surface_.has_region(t / surface_.triangles_per_face())) continue;
        r.triangles.push_back(t);
        r.area.push_back((r.area.empty() ? 0.0 : r.area.back()) + surface_.triangle_area(t));
      }
  }
  int pixels() const { return int(regions_.size()); }
  SightLine line(int region, const std::array<double, 4>& u) const {
    const Region& r = regions_[std::size_t(region)];
    const double at = u[0] * r.area.back();
    const auto k = std::size_t(std::upper_bound(r.area.begin(), r.area.end(), at) - r.area.begin());
    const double low = k == 0 ? 0.0 : r.area[k - 1], v = (at - low) / (r.area[k] - low), s = std::sqrt(u[1]);
    const int t = r.triangles[k];
    const auto& c = surface_.triangles()[std::size_t(t)].corners;
    const Vec3d p = (1.0 - s) * c[0] + s * (1.0 - v) * c[1] + s * v * c[2], n = surface_.flat_normal(t);
    const Vec3d out = reflected(Lambertian{}, n, n, u[2], u[3], Vec3d::Ones());
    const ScenePoint place = surface_.locate(t, p);
    const bool leaves =
        surface_.region(place, 0) == region && !surface_.in_contact(place) && !scene_.first_hit(p, out, false);
    return {p + 1e-7 * out, -out, leaves ? pi * r.area.back() : 0.0};
  }

 private:
  Vec3d centre(int t) const {
    const auto& c = surface_.triangles()[std::size_t(t)].corners;
    return (c[0] + c[1] + c[2]) / 3.0;
  }
  OpticalScene surface_;
  decltype(Bvh{}.build(std::vector<SceneTriangle>{})) scene_;
  struct Region {
    std::vector<int> triangles;
    std::vector<double> area;  // up to and with each [m²]
  };
  std::vector<Region> regions_;
};
static_assert(View<RegionPower>);

// A clear floor without refractive step, in a black box with an open top, which a lamp of 2 W above it lights.
Model lit_floor_seen(double albedo) {
  Model m = box({6e-3, 6e-3, 0.1e-3}, {1.0, 0.0}, 6);
  for (std::size_t k : {0u, 1u, 2u, 3u}) m.body.patches[k].optics = Dielectric{};
  m.body.patches[4].optics = Lambertian{albedo};
  m.body.regions = 1;
  m.body.region = [](const Vec3d&, const Vec3d&) { return 0; };
  m.body.emitters = {DiscEmitter{{0, 0, 0}, -Vec3d::UnitZ(), 4e-3, 2.0}};
  return m;
}

// Both by the same numbers of rays, and how far apart they are at most.
struct Compared {
  double ratio, error;
};
template <class Medium> Compared compared(const Model& m, int region, int samples, const SeenState& state = {}) {
  constexpr int rays = 1 << 15;
  auto c = few_rays<Medium, ExitPower>(rays);
  c.carrier_rays = rays;
  c.exit_rays = m.body.emitters.front().in_air() ? 0 : 8 * rays;  // the light of lamps in air is followed forwards
  c.roulette_below = 0.01;
  const Tracer<Medium> light(c);
  const Response r = light.trace(m.body, m.mesh, state.surface, state.symmetry);
  const RegionPower view(m.body, m.mesh, state.surface, state.symmetry);
  const ViewLight seen = light.look(m.body, m.mesh, state, view, {.samples = samples}, Serial{});
  const double power = r.power_W[std::size_t(region)], looked = seen.radiance()[std::size_t(region)];
  return {looked / power, std::hypot(r.error_W[std::size_t(region)], seen.error()[std::size_t(region)]) / power};
}

// A box whose white floor is lit by a disc that looks down on it: what leaves has met the floor.
Model lit_from_above(const lumo::Medium& medium) {
  return lit_box(Lambertian{0.8}, medium, DiscEmitter{{0, 0, -1e-3}, -Vec3d::UnitZ(), 1e-3, 1.0});
}

}  // namespace

TEST_CASE("View: radiance over n^2 of a lamp behind a plane face, less Fresnel's part and the medium's", "[view]") {
  const double n = 1.41, mu = 60.0, power = 0.7, deep = 5e-3;
  Model m = box({20e-3, 20e-3, 3e-3}, {n, mu}, 2);
  for (std::size_t k = 0; k < 5; ++k) m.body.patches[k].optics = Absorber{};
  m.body.emitters = {RectangleEmitter{{0, 0, 3e-3 - deep}, {15e-3, 0, 0}, {0, 15e-3, 0}, power}};
  const Tracer<BeerLambert> light(few_rays<BeerLambert, ExitPower>());
  for (const double angle : {0.0, 0.4, 0.9, 1.3}) {
    const OneLine line{{-0.01 * std::tan(angle), 0, 13e-3}, {std::sin(angle), 0, -std::cos(angle)}};
    const ViewLight seen = light.look(m.body, m.mesh, {}, line, {.samples = 8}, Serial{});
    const FresnelSplit<double> split = fresnel(std::cos(angle), 1.0 / n);
    const double exact =
        (1.0 - split.reflectance) / (n * n) * power / (pi * 30e-3 * 30e-3) * std::exp(-mu * deep / split.cosine_behind);
    INFO(angle);
    CHECK(seen.radiance()[0] == Approx(exact).epsilon(1e-9));
    CHECK(seen.ledger.imbalance() < 1e-9);
  }
}

TEST_CASE("View: a lit Lambertian face that is seen directly sends its albedo times what it gets, over pi", "[view]") {
  Model m = lit_floor_seen(0.8);
  const Tracer<BeerLambert> light(few_rays<BeerLambert, ExitPower>(1 << 14));
  const RegionPower all(m.body, m.mesh, {}, {});
  const ViewLight seen = light.look(m.body, m.mesh, {}, all, {.samples = 1 << 17}, Serial{});
  CHECK(seen.radiance()[0] == Approx(0.8 * 2.0).epsilon(5e-3));  // [W], all of it leaves through the top
  CHECK(seen.error()[0] < 5e-3 * 1.6);
}

TEST_CASE("View: radiance over all directions and a face is the power that the tracer says leaves it", "[view]") {
  const Compared clear = compared<BeerLambert>(lit_from_above({1.41, 60.0}), 0, 1 << 15);
  CHECK(clear.error < 3e-3);
  CHECK(clear.ratio == Approx(1.0).epsilon(5e-3));
  const Compared turbid = compared<ScatteringMedium>(lit_from_above({1.41, 60.0, 0.8, 0.7}), 0, 1 << 14);
  CHECK(turbid.error < 1e-2);
  CHECK(turbid.ratio == Approx(1.0).margin(3.0 * turbid.error));
}

TEST_CASE("View: the sides of a finger's section, undeformed, dented under a tool, and turbid", "[view][long]") {
  const PadShape shape{.cell = 3e-3, .medium = {1.41, 20.0}};
  Model m = pad(shape);
  // Larger lamps than real ones, which one line of sight in a thousand meets.
  for (Emitter& e : m.body.emitters) e = RectangleEmitter{e.center(), {3.5e-3, 0, 0}, {0, 5e-3, 0}, 0.2, 0};
  m.body.regions = 1;
  m.body.region = [](const Vec3d&, const Vec3d& n) { return std::abs(n.x()) < 0.5 || std::abs(n.y()) > 0.5 ? -1 : 0; };
  const Dent dent{.depth = 1e-3, .radius = 2e-3};
  const std::vector<Vec3d> moved = dent.displacement(shape, m.mesh);
  const std::vector<double> field = dent.contact(shape, m.mesh);
  const auto agrees = [&](const Compared& c) {
    INFO(c.ratio << " +- " << c.error);
    CHECK(c.error < 1e-2);
    CHECK(c.ratio == Approx(1.0).margin(std::max(5e-3, 3.0 * c.error)));
  };
  agrees(compared<BeerLambert>(m, 0, 1 << 19, {{}, {true, true}}));
  agrees(compared<BeerLambert>(m, 0, 1 << 19, {{moved, field}, {true, true}}));
  m.body.medium.scattering_albedo = 0.5;
  m.body.medium.anisotropy = 0.8;
  agrees(compared<ScatteringMedium>(m, 0, 1 << 19, {{}, {true, true}}));
}

TEST_CASE("View: lamps in air light through their film, open, half closed or pressed shut", "[view]") {
  struct Case {
    double height_m;
    std::optional<double> closes_m;
  };
  // A slab whose underside lies so high over a lamp on a black floor.
  for (const auto& [height, closes] :
      {Case{0.2e-3, {}}, Case{0.04e-3, 0.1e-3}, Case{-0.05e-3, {}}, Case{-0.05e-3, 0.0}}) {
    Model m = box({10e-3, 10e-3, 0.5e-3}, {1.41, 60.0}, 2, {0, 0, 0.5e-3 + std::max(height, 1e-6)});
    m.body.rigid_faces = {{"floor",
        {{-9e-3, -9e-3, -1e-4}, {9e-3, -9e-3, -1e-4}, {9e-3, 9e-3, -1e-4}, {-9e-3, 9e-3, -1e-4}}, Absorber{}}};
    m.body.regions = 1;
    m.body.region = [](const Vec3d&, const Vec3d& n) { return n.z() > 0.5 ? 0 : -1; };
    m.body.emitters = {RectangleEmitter{{0, 0, 0}, {4e-3, 0, 0}, {0, 5e-3, 0}, 1.0, 0, true}};
    m.body.film_closes_m = closes;
    const std::vector<Vec3d> moved(m.mesh.nodes.size(), Vec3d(0, 0, std::min(0.0, height - 1e-6)));
    const Compared c = compared<BeerLambert>(m, 0, 1 << 12, {{moved}, {}});
    INFO(height << ": " << c.ratio << " +- " << c.error);
    CHECK(c.error < 2e-2);
    CHECK(c.ratio == Approx(1.0).margin(3.0 * c.error));
  }
}

TEST_CASE("View: mirror images traced once and any number of threads give the same picture", "[view]") {
  const PadShape shape{.cell = 4e-3};
  const Model m = pad(shape);
  const PinholeCamera camera({.position = {80e-3, 0, 10e-3},
      .view = -Vec3d::UnitX(),
      .up = Vec3d::UnitZ(),
      .field_of_view_rad = 0.8,
      .columns = 24,
      .rows = 8,
      .focus_m = 65e-3});
  const Tracer<BeerLambert> light(few_rays<BeerLambert, ExitPower>(1 << 12));
  const ViewLight one = light.look(m.body, m.mesh, {{}, {true, true}}, camera, {.samples = 8}, Serial{}),
                  other = light.look(m.body, m.mesh, {{}, {true, true}}, camera, {.samples = 8}, Threads{3}),
                  whole = light.look(m.body, m.mesh, {}, camera, {.samples = 8}, Threads{2});
  CHECK(one.replicates == other.replicates);
  double first = 0.0, second = 0.0;
  for (std::size_t k = 0; k < 24 * 8; ++k) {
    first += one.radiance()[k];
    second += whole.radiance()[k];
  }
  CHECK(first > 0.0);
  CHECK(second == Approx(first).epsilon(0.02));
}

TEST_CASE("View: a pixel's radiance times its etendue is the power that passes the opening into it", "[view]") {
  const Model m = lit_from_above({1.41, 60.0});
  const PinholeCamera camera({.position = {2e-3, -1e-3, 23e-3},
      .view = -Vec3d::UnitZ(),
      .field_of_view_rad = 0.6,
      .columns = 2,
      .rows = 2,
      .aperture_m = 0.5e-3,
      .focus_m = 20e-3});
  auto c = few_rays<BeerLambert, PinholeCamera>(1 << 14);
  c.exit_rays = 1 << 17;
  const Tracer<BeerLambert, PinholeCamera> light(c, camera);
  const Response through = light.trace(m.body, m.mesh);
  const ViewLight seen = light.look(m.body, m.mesh, {}, camera, {.samples = 1 << 13}, Serial{});
  for (std::size_t k = 0; k < 4; ++k) {
    const double power = camera.etendue_m2_sr() * seen.radiance()[k];
    INFO(k << ": " << through.power_W[k] << " +- " << through.error_W[k] << ", seen " << power);
    CHECK(power > 0.0);
    CHECK(power == Approx(through.power_W[k]).epsilon(0.02));
  }
}

TEST_CASE("View: what cannot be looked at is refused", "[view]") {
  const Tracer<BeerLambert> light(few_rays<BeerLambert, ExitPower>());
  const OneLine line{{0, 0, 10e-3}, {0, 0, -1}};
  const Model m = lit_from_above({1.41, 60.0});
  const auto look = [&](const Model& at, const ViewEffort& effort) {
    return light.look(at.body, at.mesh, {}, line, effort, Serial{});
  };
  CHECK_NOTHROW(look(m, {.samples = 4}));
  CHECK_THROWS_AS(look(m, {.samples = 0}), InvalidArgument);
  CHECK_THROWS_AS(look(m, {.samples = 12}), InvalidArgument);
  CHECK_THROWS_AS(look(m, {.samples = 8, .roulette_below = 2.0}), InvalidArgument);
  CHECK_THROWS_AS(look(lit_box(Dielectric{}, {1.41, 60.0}, PointEmitter{}), {.samples = 8}), InvalidArgument);
}

TEST_CASE("View: emitters that can be seen cover their points, and as large an area as they say", "[view]") {
  const Vec3d at{1e-3, 2e-3, 3e-3};
  const OwenSobol s{3};
  int seen = 0;
  for (const NamedEmitter& e : all_emitters(at)) {
    if (!e.emitter.can_be_seen()) continue;
    ++seen;
    INFO(e.name);
    const double half = 2e-3;
    int inside = 0;
    for (std::uint32_t i = 0; i < 4096; ++i) {
      CHECK(e.emitter.covers(e.emitter.point(s(i, 0), s(i, 1))));
      inside += e.emitter.covers(at + half * Vec3d(2.0 * s(i, 0) - 1.0, 2.0 * s(i, 1) - 1.0, 0.0));
    }
    CHECK(4.0 * half * half * inside / 4096.0 == Approx(e.emitter.area_m2()).epsilon(0.02));
  }
  CHECK(seen == 3);  // not points
}

TEST_CASE("View: the phase function is a density whose mean cosine is the anisotropy", "[view]") {
  for (const double g : {-0.5, 0.0, 0.3, 0.9}) {
    const ScatteringMedium medium({1.41, 100.0, 0.8, g});
    double all = 0.0, mean = 0.0;
    const int steps = 400000;
    for (int i = 0; i < steps; ++i) {
      const double c = 2.0 * (i + 0.5) / steps - 1.0, part = 2.0 * pi * medium.phase(c) * 2.0 / steps;
      all += part;
      mean += c * part;
    }
    CHECK(all == Approx(1.0).epsilon(1e-5));
    CHECK(mean == Approx(g).margin(1e-5));
  }
}

TEST_CASE("View: a camera's cone takes in of each region what its picture shows of it", "[view]") {
  // A lamp under the top of a box, which is all that the camera sees; sides are black.
  Model m = box({5e-3, 4e-3, 3e-3}, {1.41, 60.0}, 2);
  for (std::size_t k = 0; k < 5; ++k) m.body.patches[k].optics = Absorber{};
  m.body.emitters = {RectangleEmitter{{1e-3, 0, -1e-3}, {2e-3, 0, 0}, {0, 3e-3, 0}, 1.0}};
  m.body.regions = 2;
  m.body.region = [](const Vec3d& p, const Vec3d& n) { return n.z() < 0.5 ? -1 : p.y() > 0.0; };
  const Vec3d eye{12e-3, 1e-3, 23e-3}, view = Vec3d(-0.45, 0.0, -1.0).normalized();
  auto c = few_rays<BeerLambert, CameraCone>(1 << 12);
  c.exit_rays = 1 << 18;
  const CameraCone cone({.position = eye, .view = view, .aperture_m = 0.5e-3});
  const Response through = Tracer<BeerLambert, CameraCone>(c, cone).trace(m.body, m.mesh);
  const PinholeCamera camera({.position = eye,
      .view = view,
      .field_of_view_rad = 0.9,
      .columns = 8,
      .rows = 8,
      .aperture_m = 0.5e-3,
      .focus_m = 22e-3});
  const ViewLight seen = Tracer<BeerLambert>(few_rays<BeerLambert, ExitPower>(1 << 12))
                             .look(m.body, m.mesh, {}, camera, {.samples = 1 << 12}, Serial{});
  double picture = 0.0;
  for (const double radiance : seen.radiance()) picture += camera.etendue_m2_sr() * radiance;
  INFO(through.power_W[0] << " + " << through.power_W[1] << ", picture " << picture);
  CHECK(through.power_W[0] > 0.0);
  CHECK(through.power_W[0] + through.power_W[1] == Approx(picture).epsilon(5e-3));
  CHECK(std::hypot(through.error_W[0], through.error_W[1]) < 5e-3 * picture);
  CHECK(through.ledger.imbalance() < 1e-9);
  CHECK(cone.image_channels(m.body, 1) == std::nullopt);  // it stands beside the plane
  CHECK_THROWS_AS(CameraCone({.aperture_m = 0.0}), InvalidArgument);
  CHECK_THROWS_AS(CameraCone({.view = Vec3d::Zero()}), InvalidArgument);
}

TEST_CASE("View: a wide cone has the same light gathered backwards and traced forwards, of every emitter", "[view]") {
  const CameraCone cone({.position = {1e-3, -1e-3, 9e-3}, .view = -Vec3d::UnitZ(), .aperture_m = 1.5e-3});
  for (const lumo::Medium& medium : {lumo::Medium{1.3, 60.0}, lumo::Medium{1.3, 100.0, 0.9, 0.0}})
    for (const NamedEmitter& e : all_emitters({-1e-3, 0.5e-3, -1.5e-3})) {
      const Model m = lit_box(Lambertian{0.9}, medium, e.emitter);
      auto config = few_rays<ScatteringMedium, CameraCone>(1 << 12);
      config.exit_rays = 1 << 17;  // a lamp is met by one way in hundreds
      const Response gathered = Tracer<ScatteringMedium, CameraCone>(config, cone).trace(m.body, m.mesh);
      config.exit_rays = 0;
      config.carrier_rays = config.rays_per_emitter = 1 << 14;
      const Response forward = Tracer<ScatteringMedium, CameraCone>(config, cone).trace(m.body, m.mesh);
      INFO(e.name << ", albedo " << medium.scattering_albedo);
      for (std::size_t b = 0; b < 2; ++b) {
        INFO(gathered.power_W[b] << " +- " << gathered.error_W[b] << ", " << forward.power_W[b] << " +- "
                                 << forward.error_W[b]);
        CHECK(gathered.power_W[b] ==
              Approx(forward.power_W[b]).margin(4.0 * std::hypot(gathered.error_W[b], forward.error_W[b])));
        CHECK(gathered.error_W[b] <= 0.1 * gathered.power_W[b]);
      }
      CHECK(gathered.ledger.imbalance() < 1e-9);
    }
}

TEST_CASE("Photodiodes know their mirror images", "[readout]") {
  const auto row = [](double off) {
    std::vector<Photodiode> diodes;
    for (const double y : {-5e-3, 0.0, 5e-3 + off}) diodes.push_back({{20e-3, y, 4e-3}, {0, 0, 1e-3}, {0, 1e-3, 0}});
    return Photodiodes(diodes);
  };
  const Body body;
  CHECK(row(0.0).image_channels(body, 1) == std::vector<int>{2, 1, 0});
  CHECK(row(0.0).image_channels(body, 0) == std::nullopt);
  CHECK(row(1e-6).image_channels(body, 1) == std::nullopt);
}
