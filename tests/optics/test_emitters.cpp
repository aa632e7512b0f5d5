#include "catch.hpp"
#include "optics/policies.hpp"

using namespace optics_test;

TEST_CASE(
    "Emitters: places and directions follow their laws, and intensity is the density of the directions", "[emitter]") {
  const Vec3d at{1e-3, -2e-3, 0.5e-3};
  const OwenSobol s{5};
  const std::uint32_t n = 1 << 14;
  for (const NamedEmitter& named : all_emitters(at)) {
    INFO(named.name);
    const Emitter& e = named.emitter;
    Vec3d middle = Vec3d::Zero();
    double drawn[3] = {0, 0, 0}, last = 2.0;
    for (std::uint32_t i = 0; i < n; ++i) {
      middle += e.point(s(i, 0), s(i, 1)) / n;
      const Vec3d one = e.point(s(i, 0), s(i, 1)) - at, other = e.point(1.0 - s(i, 0), 1.0 - s(i, 1)) - at;
      CHECK((one + other).norm() < 1e-15);
      const Polar p = e.polar(s(i, 2));
      CHECK(p.sine * p.sine + p.cosine * p.cosine == Approx(1.0));
      CHECK(p.sine >= 0.0);
      for (int k = 0; k < 3; ++k) drawn[k] += std::pow(p.cosine, k + 1) / n;
      CHECK(e.polar((i + 0.5) / n).cosine <= last);
      last = e.polar((i + 0.5) / n).cosine;
    }
    CHECK((middle - e.center()).norm() < 1e-6);
    double all = 0.0, expected[3] = {0, 0, 0};
    for (int i = 0; i < 20000; ++i) {
      const double c = -1.0 + (i + 0.5) / 10000.0, share = 2.0 * pi * 1e-4 * e.intensity(c);
      all += share;
      for (int k = 0; k < 3; ++k) expected[k] += share * std::pow(c, k + 1);
    }
    CHECK(all == Approx(e.power_W()).epsilon(1e-4));
    for (int k = 0; k < 3; ++k) CHECK(drawn[k] == Approx(expected[k]).margin(2e-4));
    for (const Vec3d& m : {Vec3d(-1, 1, 1), Vec3d(1, -1, 1), Vec3d(-1, -1, 1)}) {
      const Emitter image = e.mirrored(m), again = image.mirrored(m);
      CHECK((image.center() - m.cwiseProduct(e.center())).norm() < 1e-15);
      CHECK((image.axis() - m.cwiseProduct(e.axis())).norm() < 1e-15);
      CHECK((again.point(0.2, 0.6) - e.point(0.2, 0.6)).norm() < 1e-15);
      CHECK(image.power_W() == e.power_W());
    }
  }
}

TEST_CASE("A point shines evenly on a box: solid angles of its faces", "[emitter]") {
  Model m = box(Vec3d::Constant(4e-3), {1.0, 0.0}, 2);
  const Vec3d at{1e-3, 0, 0};
  m.body.emitters = {PointEmitter{at, 3.0, 0}};
  m.body.regions = 6;
  m.body.region = [](const Vec3d&, const Vec3d& n) {
    for (int a = 0; a < 3; ++a)
      if (std::abs(n[a]) > 0.5) return 2 * a + (n[a] > 0.0 ? 1 : 0);
    return -1;
  };
  Tracer<BeerLambert>::Config c = few_rays<BeerLambert, ExitPower>(1 << 13);
  for (int exit_rays : {0, 1 << 14}) {
    c.exit_rays = exit_rays;
    const Response r = Tracer<BeerLambert>(c).trace(m.body, m.mesh);
    // A face of half edge h seen from its axis at distance d: Ω = 4 atan(h²/(d √(d² + 2h²))).
    const auto share = [](double d) { return std::atan(16.0 / (d * std::sqrt(d * d + 32.0))) / pi; };
    CHECK(r.power_W[0] == Approx(3.0 * share(5.0)).margin(4.0 * r.error_W[0]));
    CHECK(r.power_W[1] == Approx(3.0 * share(3.0)).margin(4.0 * r.error_W[1]));
    CHECK(std::max(r.error_W[0], r.error_W[1]) < 5e-3);
    double sum = 0.0;
    for (double p : r.power_W) sum += p;
    CHECK(sum == Approx(3.0).epsilon(2e-3));
  }
}

TEST_CASE("A lobe table: exact inversion, normalised, and broken tables are refused", "[emitter]") {
  const LobeTable lambert({0.0, pi / 2}, {1.0, 0.0});  // linear in the cosine: Lambert's law
  for (double u : {0.01, 0.3, 0.77, 0.99}) CHECK(lambert.cosine(u) == Approx(std::sqrt(1.0 - u)));
  CHECK(lambert.density(0.6) == Approx(0.6 / pi));
  CHECK(lambert.density(-0.1) == 0.0);
  const LobeTable even({0.0, 1.0, pi}, {2.0, 2.0, 2.0});
  for (double u : {0.01, 0.3, 0.77, 0.99}) CHECK(even.cosine(u) == Approx(1.0 - 2.0 * u));
  CHECK(even.density(-0.4) == Approx(0.25 / pi));
  const LobeTable ring({0.0, 0.5, 0.6, 0.7}, {0.0, 0.0, 1.0, 0.0});  // dark in the middle
  CHECK(ring.cosine(1e-9) <= std::cos(0.5));
  CHECK(ring.cosine(1.0 - 1e-9) >= std::cos(0.7) - 1e-12);
  CHECK_THROWS_AS(LobeTable({0.0}, {1.0}), InvalidArgument);
  CHECK_THROWS_AS(LobeTable({0.1, 0.5}, {1.0, 1.0}), InvalidArgument);
  CHECK_THROWS_AS(LobeTable({0.0, 0.5, 0.4}, {1.0, 1.0, 1.0}), InvalidArgument);
  CHECK_THROWS_AS(LobeTable({0.0, 0.5}, {0.0, 0.0}), InvalidArgument);
  CHECK_THROWS_AS(LobeTable({0.0, 0.5}, {1.0, std::nan("")}), InvalidArgument);
}

TEST_CASE("Symmetric emitters of every kind: quarter, half and full pattern agree", "[emitter]") {
  const LobeTable lobe({0.0, 0.5, 1.0}, {1.0, 0.6, 0.0});
  const auto pair = [](auto e, const Vec3d& m) { return std::vector<Emitter>{e, e.mirrored(m)}; };
  const Vec3d flip(-1, 1, 1);
  for (const std::vector<Emitter>& emitters : {std::vector<Emitter>{DiscEmitter{{0, 0, -1e-3}, Vec3d::UnitZ(), 1e-3}},
           std::vector<Emitter>{PointEmitter{{0, 0, 1e-3}}},
           pair(DiscEmitter{{0.4e-3, 0, 0}, Vec3d(0.6, 0, 0.8), 1e-3}, flip),
           pair(MeasuredLobe{lobe, {2e-3, 0, 0}, Vec3d(-0.6, 0, 0.8), 0.3e-3}, flip),
           pair(PointEmitter{{1e-3, 0, 0}}, flip)}) {
    Model m = box({5e-3, 4e-3, 3e-3}, {1.41, 50.0}, 4);
    m.body.symmetry = m.mesh.symmetry = {true, true};
    m.body.emitters = emitters;
    m.body.regions = 1;
    for (std::size_t k : {0u, 2u})
      m.body.patches[k].shape = m.body.patches[k + 1].shape;  // shapes are those of the sector x ≥ 0, y ≥ 0
    m.body.region = [](const Vec3d&, const Vec3d& n) { return n.z() > 0.5 ? 0 : -1; };
    REQUIRE(symmetry_of(m.body, m.mesh) == Symmetry{true, true});
    const Tracer<BeerLambert> tracer(few_rays<BeerLambert, ExitPower>(1 << 10));
    const Response quarter = tracer.trace(m.body, m.mesh),
                   half = tracer.trace(m.body, m.mesh, std::vector<Vec3d>{}, {}, Symmetry{true, false}),
                   full = tracer.trace(m.body, m.mesh, std::vector<Vec3d>{}, {});
    CHECK(quarter.power_W[0] == Approx(full.power_W[0]).epsilon(1e-6));
    CHECK(half.power_W[0] == Approx(full.power_W[0]).epsilon(1e-6));
    CHECK(quarter.rays * 3 < full.rays);
  }
}

TEST_CASE("Colours: each has its own channels, and the sum of all is the light of all", "[emitter]") {
  Model m = lit_box(Lambertian{0.8}, {1.41, 50.0}, PointEmitter{{-2e-3, 0, 0}, 1.0, 0});
  const Tracer<BeerLambert> tracer(few_rays<BeerLambert, ExitPower>(1 << 10));
  const Emitter second = PointEmitter{{2e-3, 1e-3, 0}, 2.0, 0}, other = PointEmitter{{2e-3, 1e-3, 0}, 2.0, 1};
  const Response one = tracer.trace(m.body, m.mesh);
  m.body.emitters.push_back(other);
  const Response colored = tracer.trace(m.body, m.mesh);
  REQUIRE(colored.power_W.size() == 4);
  CHECK(tracer.channels(m.body) == 4);
  CHECK(colored.power_W[0] == one.power_W[0]);  // the same rays
  CHECK(colored.power_W[1] == one.power_W[1]);
  CHECK(colored.ledger.emitted == Approx(3.0));
  CHECK(colored.ledger.imbalance() < 1e-9);
  m.body.emitters.back() = second;
  const Response sum = tracer.trace(m.body, m.mesh);
  CHECK(sum.power_W[0] == Approx(colored.power_W[0] + colored.power_W[2]).epsilon(0.02));
  m.body.emitters.back() = PointEmitter{{2e-3, 1e-3, 0}, 2.0, 2};
  CHECK_THROWS_AS(tracer.trace(m.body, m.mesh), InvalidArgument);  // nothing has channel 1
}

TEST_CASE("Broken emitters are refused by name", "[emitter]") {
  const auto refused = [](const Emitter& e) { CHECK_THROWS_AS(validate(std::vector<Emitter>{e}), InvalidArgument); };
  const LobeTable lobe({0.0, 0.5}, {1.0, 0.0});
  refused(DiscEmitter{Vec3d::Zero(), Vec3d::UnitZ(), 0.0});
  refused(DiscEmitter{Vec3d::Zero(), 2.0 * Vec3d::UnitZ(), 1e-3});
  refused(DiscEmitter{Vec3d::Zero(), Vec3d::UnitZ(), 1e-3, -1.0});
  refused(PointEmitter{{std::nan(""), 0, 0}});
  refused(PointEmitter{Vec3d::Zero(), 1.0, -1});
  refused(MeasuredLobe{lobe, Vec3d::Zero(), Vec3d::UnitZ(), -1e-3});
}

TEST_CASE("An emitter in air: what does not meet the body is lost to it, and what does goes in as Fresnel says",
    "[emitter]") {
  const double n = 1.41, half = 5e-3;
  Model m = box({half, half, half}, {n, 1e5}, 4);  // what goes in stays in
  const auto run = [&](const Vec3d& center, double side) {
    m.body.emitters = {RectangleEmitter{center, {1e-6, 0, 0}, {0, side * 1e-6, 0}, 1.0, 0, true}};
    return Tracer<BeerLambert>(few_rays<BeerLambert, ExitPower>(1 << 12)).trace(m.body, m.mesh, {}, {}, Symmetry{});
  };
  const Response away = run({0, 0, 8e-3}, 1.0);
  CHECK(away.ledger.elsewhere == Approx(1.0));
  CHECK(away.ledger.absorbed_in_medium == 0.0);

  const double gap = 20e-6;
  double in = 0.0;  // ∫ (1 − R) 2 sin θ cos θ dθ over directions that meet the face
  for (int k = 0; k < 20000; ++k) {
    const double sine2 = (k + 0.5) / 20000.0;
    in += (1.0 - fresnel(std::sqrt(1.0 - sine2), 1.0 / n).reflectance) / 20000.0;
  }
  const Response close = run({0, 0, half + gap}, -1.0);
  CHECK(close.ledger.absorbed_in_medium == Approx(in).margin(1e-3));
  CHECK(close.ledger.elsewhere == Approx(1.0 - in).margin(1e-3));
  CHECK(close.ledger.imbalance() < 1e-9);
}
