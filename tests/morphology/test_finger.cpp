#include "catch.hpp"
#include "lumo/mesh/size_field.hpp"
#include "lumo/morphology/finger.hpp"
#include "morphology/closed.hpp"

#include <map>
#include <random>

using namespace lumo;

static_assert(!SurfaceShape<int>);

TEST_CASE("the closest point of an ellipse is perpendicular, idempotent and nearest") {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> u(-1, 1);
  for (double b : {1e-3, 6e-3, 14.75e-3, 20e-3}) {
    const EllipticCylinder e{{0, 0, 6e-3}, 14.75e-3, b};
    for (int k = 0; k < 300; ++k) {
      const Vec3d p(25e-3 * u(random), 30e-3 * u(random), 6e-3 + 20e-3 * (u(random) + 1));
      const Vec3d q = e.closest_point(p);
      const double on = std::pow(q.x() / 14.75e-3, 2) + std::pow((q.z() - 6e-3) / b, 2);
      CHECK(on == Approx(1.0).epsilon(1e-9));
      CHECK(q.y() == p.y());
      CHECK((e.closest_point(q) - q).norm() < 1e-12);
      double nearest = 1e9;
      for (int t = 0; t <= 2000; ++t) {
        const double a = pi * t / 2000;
        nearest = std::min(nearest, std::hypot(p.x() - 14.75e-3 * std::cos(a), p.z() - 6e-3 - b * std::sin(a)));
      }
      CHECK((p - q).norm() <= nearest + 1e-9);
      CHECK((p - q).norm() >= nearest - 2e-5);
      if ((p - q).norm() > 1e-6 && q.z() > 6e-3 + 1e-6)
        CHECK(std::abs((p - q).normalized().dot(e.normal(p))) == Approx(1.0).epsilon(1e-6));
    }
  }
}

TEST_CASE("the closest point of an ellipse lies on it for points beside the axes and far away, too") {
  for (double b : {1e-3, 6e-3, 14.75e-3, 20e-3}) {
    const EllipticCylinder e{{0, 0, 0}, 14.75e-3, b};
    for (double small = 1e-2; small > 1e-25; small *= 0.1)
      for (double large : {1e-4, 3e-3, 14e-3, 0.3, 1e3})
        for (const Vec3d& p : {Vec3d(small, 0, large), Vec3d(large, 0, small)}) {
          const Vec3d q = e.closest_point(p);
          CAPTURE(b, p.x(), p.z());
          CHECK(std::hypot(q.x() / 14.75e-3, q.z() / b) == Approx(1.0).epsilon(1e-12));
          CHECK((q - p).norm() <=
                std::min((Vec3d(14.75e-3, 0, 0) - p).norm(), (Vec3d(0, 0, b) - p).norm()) * (1.0 + 1e-12));
        }
  }
}

TEST_CASE("a finger is a closed, outward surface with the exact volume up to its chords") {
  for (Twin twin : {Twin::none, Twin::no_void, Twin::bonded_base, Twin::unsupported_base})
    for (const FingerDesign& d : plain_references()) {
      FingerOptions o = plain_finger();
      o.twin = twin;
      o.mesh.contact_edge = 0.5e-3;
      o.mesh.max_turn_rad = 0.1;
      const Body b = finger(d, solaris(), o);
      double volume = 0.0;
      for (const Facet& f : b.facets)
        for (std::size_t k = 1; k + 1 < f.loop.size(); ++k)
          volume += b.vertices[std::size_t(f.loop[0])].dot(
                        b.vertices[std::size_t(f.loop[k])].cross(b.vertices[std::size_t(f.loop[k + 1])])) /
                    6.0;
      check_closed(b);
      CHECK(4.0 * volume == Approx(b.exact_volume_m3).epsilon(2e-3));
    }
}

TEST_CASE("what is bonded, touchable, visible and lit follows the model") {
  const Body b = finger({4, 8, 8, 5, 2}, dragon_skin(), plain_finger());
  std::map<std::string, const Patch*> patch;
  for (const Patch& p : b.patches) patch[p.name] = &p;
  CHECK(patch.at("stem_top")->bonded);
  CHECK(patch.at("base")->bonded);
  CHECK_FALSE(patch.at("void_roof")->bonded);
  CHECK(patch.at("void_roof")->meets_carrier);
  CHECK(patch.at("void_wall")->meets_carrier);
  CHECK(patch.at("dome")->contactable);
  CHECK(patch.count("stem_side") == 0);
  CHECK_FALSE(patch.at("end")->bonded);
  CHECK(std::holds_alternative<Lambertian>(patch.at("base")->optics));
  CHECK(std::holds_alternative<Dielectric>(patch.at("void_wall")->optics));
  CHECK(b.rigid_faces.size() == 4);
  for (const Patch& q : b.patches)
    CHECK(q.visible == !q.name.starts_with("void_"));  // only the outer surface is read out

  CHECK(b.emitters.size() == 5);
  double power = 0.0;
  for (const auto& e : b.emitters) {
    power += e.power_W();
    CHECK(e.center().z() == 5e-3);
    CHECK(e.axis().z() == 1.0);
  }
  CHECK(power == Approx(1.0));
  CHECK(b.emitters.front().center().y() == -22e-3);

  CHECK(b.regions == 11);
  CHECK(b.region(Vec3d(14.75e-3, 0, 2e-3), Vec3d::UnitX()) == 5);
  CHECK(b.region(Vec3d(-14.75e-3, -27.4e-3, 2e-3), -Vec3d::UnitX()) == 0);
  CHECK(b.region(Vec3d(14.75e-3, 27.4e-3, 2e-3), Vec3d::UnitX()) == 10);
  CHECK(b.region(Vec3d(14.75e-3, 28e-3, 2e-3), Vec3d::UnitX()) == -1);
  CHECK(b.region(Vec3d(1e-3, 0, 12e-3), Vec3d(0.1, 0, 0.99)) == -1);
  for (int k = 0; k < 11; ++k) CHECK((*b.region_image_y)[std::size_t(k)] == 10 - k);
  const int dome = int(patch.at("dome") - b.patches.data());
  const Vec3d p(-12e-3, -10e-3, 9e-3);
  CHECK(outward_normal(b, dome, p).x() < 0.0);
  CHECK(outward_normal(b, dome, Vec3d(-p.x(), p.y(), p.z())).x() == -outward_normal(b, dome, p).x());

  const Body plain = finger({4, 8, 8, 5, 0}, dragon_skin(), plain_finger());
  bool side = false;
  for (const Patch& q : plain.patches) side = side || (q.name == "stem_side" && q.bonded);
  CHECK(side);
  FingerOptions soft = plain_finger();
  soft.twin = Twin::unsupported_base;
  const Body twin = finger({4, 8, 8, 5, 2}, dragon_skin(), soft);
  CHECK(twin.carrier.empty());
  CHECK(twin.emitters.empty());
  for (const Patch& q : twin.patches) CHECK(q.bonded == (q.name == "end"));
}

TEST_CASE("material cards are the paper's") {
  CHECK(silicone("DS").mu_Pa == Approx(106e3));
  CHECK(silicone("Sol").lambda_Pa == Approx(9.75e6));
  for (const char* name : {"DS", "Sol"}) {
    const Silicone s = silicone(name);
    CHECK(0.5 * s.lambda_Pa / (s.lambda_Pa + s.mu_Pa) == Approx(0.495).epsilon(1e-4));  // Poisson's ratio
  }
  CHECK_THROWS_WITH(silicone("Dragon"), Catch::Contains("Dragon") && Catch::Contains("DS or Sol"));
}

TEST_CASE("a scaled mesh wants edges that are longer by its factor everywhere, also where a tool touches") {
  const FingerDesign design{5, 10, 10, 6, 3};
  FingerOptions coarse = plain_finger();
  coarse.mesh = coarse.mesh.scaled(1.4);
  CHECK(FingerOptions::Mesh{}.scaled(1.0) == FingerOptions::Mesh{});
  const std::vector<Vec3d> touches = {{0, 5e-3, 15e-3}};
  const Body usual = focused(finger(design, dragon_skin(), plain_finger()), touches),
             scaled = focused(finger(design, dragon_skin(), coarse), touches, Focus{}.scaled(1.4));
  for (const Vec3d& p :
      {Vec3d(0, 5e-3, 15e-3), Vec3d(1e-3, 6e-3, 14.9e-3), Vec3d(8e-3, -20e-3, 10e-3), Vec3d(6e-3, 25e-3, 1e-3)})
    CHECK(scaled.sizing.edge(p) == Approx(1.4 * usual.sizing.edge(p)));
}

TEST_CASE("light seen by its direction is seen wherever it leaves") {
  FingerOptions o;
  const FingerDesign design{8, 4, 6, 4, 2};
  CHECK(finger(design, dragon_skin(), o).seen_towards == Vec3d::Zero());
  o.readout.by_direction = true;
  const Body body = finger(design, dragon_skin(), o);
  CHECK(body.seen_towards == Vec3d::UnitX());
  CHECK(body.region(Vec3d(-15e-3, 0, 2e-3), -Vec3d::UnitX()) == 5);
  CHECK(body.region(Vec3d(0, 28e-3, 8e-3), Vec3d::UnitZ()) == -1);
  CHECK_FALSE(body.region_image_x);
  for (const Patch& p : body.patches) CHECK((p.visible || p.bonded));
  o.readout.one_side = false;
  CHECK(finger(design, dragon_skin(), o).seen_towards == Vec3d::Zero());
}

TEST_CASE("other assumptions on the finger: held ends, LEDs at the sides, one side seen, a narrow pad") {
  const FingerDesign design{8, 4, 6, 4, 2};
  FingerOptions o = plain_finger();
  o.bonded_ends = true;
  o.leds.place = FingerOptions::Leds::Place::sides;
  o.readout.one_side = o.readout.in_space = true;
  o.touched = Absorber{};
  Silicone cloudy = dragon_skin();
  cloudy = scattering_the_rest(cloudy, 0.5 * cloudy.absorption_per_m, 0.9);
  const Body b = finger(design, cloudy, o);
  for (const Patch& p : b.patches)
    if (p.name == "end") CHECK(p.bonded);
  CHECK(b.medium.scattering_albedo == 0.5);
  CHECK(b.medium.anisotropy == 0.9);
  CHECK(b.medium.extinction_per_m == dragon_skin().extinction_per_m());
  CHECK(b.regions_in_space);
  CHECK(std::holds_alternative<Absorber>(b.touched));
  CHECK_FALSE(b.region_image_x);
  CHECK(b.region(Vec3d(14.75e-3, 0, 2e-3), Vec3d::UnitX()) == 5);
  CHECK(b.region(Vec3d(-14.75e-3, 0, 2e-3), -Vec3d::UnitX()) == -1);

  REQUIRE(b.emitters.size() == 10);
  double power = 0.0, sideways = 0.0;
  for (const Emitter& e : b.emitters) {
    power += e.power_W();
    sideways += e.axis().x();
    CHECK(e.in_air());
    CHECK(e.center().z() == 2e-3);
    CHECK(e.center().x() * e.axis().x() ==
          Approx(3e-3 - 10e-6));  // it looks away from the stem, and stands back with its face
  }
  CHECK(power == Approx(1.0));
  CHECK(sideways == 0.0);
  for (const Emitter& e : finger({8, 4, 6, 4, 0}, cloudy, o).emitters) {
    CHECK_FALSE(e.in_air());
    CHECK(std::abs(e.center().x()) == 3e-3);
  }

  o.leds.width_x = 5e-3;
  CHECK_THROWS_WITH(finger(design, cloudy, o),
      Catch::Contains("LEDs on the stem's sides") && Catch::Contains("is 5 mm") && Catch::Contains("4] mm"));
  o.leds.width_x = 1e-3;
  o.touched = Lambertian{1.2};
  CHECK_THROWS_WITH(finger(design, cloudy, o), Catch::Contains("wets the pad"));
  o.touched = Absorber{};
  cloudy.scattering_per_m = -1.0;
  CHECK_THROWS_WITH(finger(design, cloudy, o), Catch::Contains("scattering of the silicone"));

  PadDimensions narrow;
  narrow.width = 20.0;
  CHECK_FALSE(finger_space(narrow).contains(std::vector<double>{8, 4, 8, 4, 2}));  // 4 mm beside the voids
  narrow.thickness = Thickness::above;
  CHECK(finger_space(narrow).contains(std::vector<double>{8, 4, 8, 4, 2}));
  CHECK_FALSE(finger_space(narrow).contains(std::vector<double>{4, 2, 8, 5, 0}));  // still 5 mm above
}
