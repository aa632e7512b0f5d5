#include "catch.hpp"

#include "mechanics/contact/contact_laws.hpp"
#include "mechanics/indenters/indenter_laws.hpp"
#include "mechanics/materials/material_laws.hpp"
#include "mesh/mesher_laws.hpp"
#include "optics/scenes.hpp"
#include "own/actuator.hpp"
#include "own/camera.hpp"
#include "own/contact.hpp"
#include "own/emitter.hpp"
#include "own/intersector.hpp"
#include "own/material.hpp"
#include "own/mesher.hpp"
#include "own/objective.hpp"
#include "own/readout.hpp"
#include "own/tool.hpp"
#include "temporary_folder.hpp"

#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mesh/swept_mesher.hpp"
#include "lumo/optics/bvh.hpp"

// What the pages show as a user's own must keep the laws of the concepts.
using namespace lumo;

namespace {

// 20 × 40 × 10 mm, with a lamp in the middle; its side x > 0 is seen, in two halves.
optics_test::Model box_with_a_lamp() {
  auto m = optics_test::box(Vec3d(0.01, 0.02, 0.005), {1.41, 14.5}, 3);
  m.body.emitters = {RectangleEmitter{{0, 0, 0}, {1e-3, 0, 0}, {0, 1e-3, 0}}};
  m.body.regions = 2;
  m.body.region = [](const Vec3d& p, const Vec3d& n) { return n.x() > 0.5 ? (p.y() > 0.0 ? 1 : 0) : -1; };
  return m;
}

}  // namespace

TEST_CASE("a user's material obeys the laws of a hyperelastic material") {
  test::check_material_laws(own::Demiray{});
  test::check_material_laws(own::Demiray{.mu = 9.0e4, .b = 0.3, .lambda = 1.0e6});
}

TEST_CASE("a user's material has its closed form in tension, and is Neo-Hookean where it does not stiffen") {
  const own::Demiray skin{.mu = 1.0e5, .b = 0.7, .lambda = 0.0};
  for (const double stretch : {0.7, 1.2, 1.6}) {
    // Volume is kept, and the sides are free: what pressure adds at the sides is taken off along the axis (Demiray
    // 1972).
    const double side = 1.0 / std::sqrt(stretch);
    const Mat3d F = Vec3d(stretch, side, side).asDiagonal(), P = skin.distortion_stress(F);
    const double nominal = P(0, 0) - P(1, 1) * side / stretch;
    const double closed =
        1.0e5 * std::exp(0.7 * (stretch * stretch + 2.0 / stretch - 3.0)) * (stretch - 1.0 / (stretch * stretch));
    CHECK(nominal == Approx(closed).epsilon(1e-12));
  }
  const own::Demiray plain{.mu = 1.0e5, .b = 1e-6, .lambda = 1.0e6};
  const NeoHookean neo{.mu = 1.0e5, .lambda = 1.0e6};
  std::mt19937 random(3);
  for (int k = 0; k < 10; ++k) {
    const Mat3d F = test::random_deformation(random, 0.3);
    CHECK((first_piola(plain, F) - first_piola(neo, F)).norm() < 1e-4 * 1.0e5);
  }
}

TEST_CASE("a user's contact law obeys the laws of a contact handler") {
  test::check_contact_laws(own::SoftSkin{}, 50e-6);
  test::check_contact_laws(own::SoftSkin{.thickness_m = 1e-3, .friction = 0.5});
  CHECK_THROWS_AS(validate(own::SoftSkin{.thickness_m = 0.0}), InvalidArgument);
}

TEST_CASE("a user's emitter sends all of its power, as densely as it draws directions") {
  const own::LensedLed led{.exponent = 3.0, .power_W = 2.0};
  double power = 0.0;
  for (int k = 0; k < 20000; ++k) power += 2.0 * pi * led.intensity((k + 0.5) / 20000.0) / 20000.0;
  CHECK(power == Approx(2.0).epsilon(1e-6));
  double before = 1.0;
  for (int k = 1; k < 100; ++k) {
    const double u = 0.01 * k, cosine = led.polar(u).cosine;
    CHECK(cosine < before);
    CHECK(1.0 - std::pow(cosine, 4.0) == Approx(u).epsilon(1e-12));  // ∫ of 4 c³ from the cosine to 1
    CHECK(led.polar(u).sine == Approx(std::sqrt(1.0 - cosine * cosine)).epsilon(1e-12));
    before = cosine;
  }
  const Emitter any = led, image = any.mirrored({-1.0, 1.0, 1.0});
  CHECK(any.has_intensity());
  CHECK(image.as<own::LensedLed>() != nullptr);
}

TEST_CASE("a user's objective is the ratio that it names, and nullopt if there is none") {
  const auto scenario = [](double size, double noise) {
    ScenarioRecord s;
    StateRecord state;
    state.load_N = 2.0;
    state.change.resize(4, 2);  // replicates × channels: (3, 4) size, and noise that has no mean
    for (int r = 0; r < 4; ++r) state.change.row(r) << size * 3.0 + (r % 2 ? noise : -noise), size * 4.0;
    s.states = {state};
    return s;
  };
  Observations all;
  all.scenarios = {scenario(2.0, 0.0), scenario(0.5, 0.0), scenario(1.0, 0.0)};
  const auto even = own::EvenSight{.load_N = 2.0}(all);
  REQUIRE(even);
  CHECK(even->value == Approx(0.25).epsilon(1e-12));
  CHECK(even->error < 1e-12);
  all.scenarios[1] = scenario(0.5, 0.1);
  const auto noisy = own::EvenSight{.load_N = 2.0}(all);
  // Along (3, 4)/5 the replicates differ from their mean by 0.06; two standard errors of the mean of four, over the
  // largest change, 10.
  CHECK(noisy->error == Approx(2.0 * std::sqrt(4 * 0.06 * 0.06 / 12.0) / 10.0).epsilon(0.01));
  CHECK(!own::EvenSight{.load_N = 5.0}(all));
  CHECK(!own::EvenSight{.load_N = 2.0}(Observations{}));
  all.scenarios = {scenario(0.0, 0.0)};
  CHECK(!own::EvenSight{.load_N = 2.0}(all));
}

TEST_CASE("a user's tool obeys the laws of an indenter") {
  test::check_distance_laws(own::Ring{}, 12e-3);
  const own::Ring ring{.diameter_m = 20e-3, .cord_m = 4e-3};
  test::check_distance_laws(ring, 20e-3);
  CHECK(ring.distance({0, 0, 0}) == Approx(8e-3));
  CHECK(ring.distance({0, 10e-3, 5e-3}) == Approx(3e-3));
  CHECK(ring.distance({10e-3, 0, 0}) == Approx(-2e-3));
  CHECK(ring.sample({0, 0, 0}).gradient.allFinite());
  CHECK_THROWS_AS(validate(own::Ring{.diameter_m = 2e-3, .cord_m = 3e-3}), InvalidArgument);
}

TEST_CASE("a user's mesher fills what it is given, with rounder tetrahedra than the one within it") {
  MeshInput block;
  for (int k = 0; k < 8; ++k) block.vertices.emplace_back(k & 1 ? 1.0 : 0.0, k & 2 ? 2.0 : 0.0, k & 4 ? 3.0 : 0.0);
  block.facets = {
      {{0, 2, 3, 1}, 0}, {{4, 5, 7, 6}, 1}, {{0, 1, 5, 4}, 2}, {{2, 6, 7, 3}, 3}, {{0, 4, 6, 2}, 4}, {{1, 3, 7, 5}, 5}};
  block.edge = [](const Vec3d& p) { return 0.3 + 0.1 * p.z(); };
  using Within = SweptMesher;
  const own::Relaxed<Within> relaxed;
  const LinearTets before = Within{}.fill(block), after = relaxed.fill(block);
  mesher_laws::check_laws(after, block);
  mesher_laws::check_same_bits(relaxed, own::Relaxed<Within>{}, block);
  const auto least = [](const LinearTets& mesh) {
    double v = 1e300;
    for (const auto& t : mesh.tets) v = std::min(v, mesher_laws::volume(mesh, t));
    return v;
  };
  CHECK(least(after) >= least(before));
  CHECK(after.tets == before.tets);
  CHECK(after.vertices != before.vertices);
}

TEST_CASE("a user's intersector meets the triangles that the built one meets") {
  const auto model = box_with_a_lamp();
  const auto triangles = OpticalScene(model.body, model.mesh, {}, {}, {}).triangles();
  const auto every = own::EveryTriangle{}.build(triangles);
  const auto tree = Bvh{}.build(triangles);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> u(-0.03, 0.03);
  int met = 0;
  for (int k = 0; k < 2000; ++k) {
    const Vec3d from(u(random), u(random), u(random)), direction = Vec3d(u(random), u(random), u(random)).normalized();
    for (const bool inside : {false, true}) {
      const RayHit a = every.first_hit(from, direction, inside), b = tree.first_hit(from, direction, inside);
      REQUIRE(bool(a) == bool(b));
      if (!a) continue;
      ++met;
      CHECK(a.t == Approx(b.t).epsilon(1e-9).margin(1e-12));
    }
  }
  CHECK(met > 200);
  Tracer<BeerLambert, ExitPower, own::EveryTriangle>::Config few;
  few.rays_per_emitter = 1 << 10;
  few.exit_rays = 0;
  Tracer<BeerLambert>::Config same;
  same.rays_per_emitter = few.rays_per_emitter;
  same.exit_rays = 0;
  const Response slow = Tracer<BeerLambert, ExitPower, own::EveryTriangle>(few).trace(model.body, model.mesh),
                 fast = Tracer<BeerLambert>(same).trace(model.body, model.mesh);
  for (const std::size_t half : {0u, 1u}) {
    REQUIRE(fast.power_W[half] > 0.0);
    CHECK(slow.power_W[half] == Approx(fast.power_W[half]).epsilon(1e-9));
  }
}

TEST_CASE("a user's readout takes what comes within its cones, and its mirror images are the other half") {
  const auto model = box_with_a_lamp();
  using Light = Tracer<BeerLambert, own::FibreRow>;
  Light::Config rays;
  rays.rays_per_emitter = 1 << 14;
  const auto power = [&](double aperture) {
    const Light light(rays, own::FibreRow{.count = 4, .half_range_m = 20e-3, .numerical_aperture = aperture});
    return light.trace(model.body, model.mesh).power_W;
  };
  const auto narrow = power(0.3), wide = power(1.0);
  REQUIRE(narrow.size() == 4);
  const own::FibreRow row;
  const auto images = *row.image_channels(model.body, 1);
  for (int k = 0; k < row.count; ++k) CHECK(images[std::size_t(images[std::size_t(k)])] == k);
  CHECK_FALSE(row.image_channels(model.body, 0));
  for (std::size_t k = 0; k < 4; ++k) {
    CHECK(narrow[k] > 0.0);
    CHECK(narrow[k] < 0.5 * wide[k]);
    CHECK(narrow[k] == Approx(narrow[3 - k]).epsilon(0.05));
  }
}

TEST_CASE("a user's camera gives each picture once, ends, and fails on what is no picture") {
  const TemporaryFolder folder;
  const auto write = [&](int number, const std::string& bytes) {
    folder.write(std::to_string(number) + ".pgm", bytes);
  };
  write(0, "P5\n3 2\n255\nabcdef");
  write(1, "P5\n3 2\n255\nghijkl");
  own::PgmCamera camera(folder.path.string(), 0.5);
  for (const int k : {0, 1}) {
    const auto frame = camera.next();
    REQUIRE(frame);
    CHECK((frame->stamp_ns == k * 500'000'000 && frame->index == k));
    CHECK(frame->image.green(1, 1) == (k == 0 ? 'e' : 'k'));
  }
  CHECK(camera.state() == sense::StreamState::open);
  CHECK((!camera.next() && camera.state() == sense::StreamState::ended));
  write(1, "P5\n3 2\n255\nghi");
  own::PgmCamera torn(folder.path.string(), 0.5);
  CHECK(torn.next());
  CHECK((!torn.next() && torn.state() == sense::StreamState::failed && !torn.next()));
}

TEST_CASE("a user's actuator gives each sample once, ends, and fails on what is no sample") {
  std::istringstream text("0 0.1 0.2 0.3\n0.001 0.4 0.5 0.6\n"), broken("0 0.1 0.2 0.3\n0.001 x\n0.002 0 0 0\n");
  own::TextActuator actuator(text), bad(broken);
  CHECK(actuator.next()->effort[0] == 0.3);
  const auto second = actuator.next();
  CHECK((second->stamp_ns == 1'000'000 && second->position_rad[0] == 0.4 && second->velocity_rad_per_s[0] == 0.5));
  CHECK((!actuator.next() && actuator.state() == sense::StreamState::ended));
  CHECK(bad.next());
  CHECK((!bad.next() && bad.state() == sense::StreamState::failed && !bad.next()));
}
