#include "catch.hpp"
#include "optics/scenes.hpp"

#include <thread>

using namespace optics_test;

namespace {

using Config = Tracer<BeerLambert>::Config;

Config quick() {
  Config c;
  c.rays_per_emitter = 1 << 11;
  c.carrier_rays = 1 << 13;
  c.exit_rays = 1 << 18;
  c.scene.sub_facets = 2;
  return c;
}

PadShape coarse(double gap = 2e-3) {
  PadShape s;
  s.cell = 4e-3;
  s.gap = gap;
  return s;
}

double distance(const std::vector<double>& a, const std::vector<double>& b) {
  double worst = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) worst = std::max(worst, std::abs(a[i] - b[i]));
  return worst;
}

std::vector<double> reversed(std::vector<double> a) {
  std::reverse(a.begin(), a.end());
  return a;
}

}  // namespace

TEST_CASE("The ledger closes and nothing is lost, for dents, contact, voids and both silicones", "[tracer]") {
  for (const lumo::Medium& medium : {lumo::Medium{1.4348, 71.3801}, lumo::Medium{1.41, 14.5063}})
    for (double gap : {0.0, 3e-3}) {
      PadShape s = coarse(gap);
      s.medium = medium;
      const Model m = pad(s);
      const Dent d{1.5e-3, 2e-3, 4e-3, 4e-3, 3e-3};
      const Response r =
          Tracer<BeerLambert>(quick()).trace(m.body, m.mesh, d.displacement(s, m.mesh), d.contact(s, m.mesh));
      CHECK(r.ledger.emitted == Approx(1.0));
      CHECK(r.ledger.imbalance() < 1e-9);
      CHECK(r.ledger.lost <= 1e-6);
      CHECK(r.ledger.to_indenter > 0.01);
      CHECK(std::abs(r.ledger.roulette) < 0.02);
      CHECK(r.power_W.size() == 11);
      for (std::size_t b = 0; b < 11; ++b)
        CHECK((r.power_W[b] > 0.0 && r.error_W[b] > 0.0 && r.error_W[b] < r.power_W[b]));
    }
}

TEST_CASE("The unloaded response is symmetric: patterns from a quarter, a half and the whole pad agree", "[tracer]") {
  const PadShape s = coarse();
  const Model m = pad(s);
  const Tracer<BeerLambert> tracer(quick());
  const Response quarter = tracer.trace(m.body, m.mesh);
  const Response full = tracer.trace(m.body, m.mesh, std::vector<Vec3d>{}, {});
  const Response half = tracer.trace(m.body, m.mesh, std::vector<Vec3d>{}, {}, Symmetry{true, false});
  CHECK(distance(full.power_W, reversed(full.power_W)) < 1e-6);
  CHECK(distance(full.power_W, quarter.power_W) < 1e-6);
  CHECK(distance(full.power_W, half.power_W) < 1e-6);
  CHECK(quarter.rays * 3 < full.rays);
  CHECK(quarter.ledger.imbalance() < 1e-9);
  CHECK(quarter.ledger.absorbed_at_surfaces == Approx(full.ledger.absorbed_at_surfaces).margin(1e-6));
}

TEST_CASE("A mirrored state has the mirrored response, replicate by replicate", "[tracer]") {
  const PadShape s = coarse();
  const Model m = pad(s);
  const Tracer<BeerLambert> tracer(quick());
  const auto run = [&](double x, double y) {
    const Dent d{1e-3, x, y, 4e-3, 2e-3};
    return tracer.trace(m.body, m.mesh, d.displacement(s, m.mesh), d.contact(s, m.mesh));
  };
  const Response here = run(3e-3, 7e-3), y_image = run(3e-3, -7e-3), x_image = run(-3e-3, 7e-3);
  CHECK(distance(here.power_W, reversed(y_image.power_W)) < 1e-6);
  CHECK(distance(here.power_W, x_image.power_W) < 1e-6);
  CHECK((here.replicates - y_image.replicates.rowwise().reverse()).cwiseAbs().maxCoeff() < 1e-6);
  CHECK(distance(here.power_W, y_image.power_W) > 1e-5);
}

TEST_CASE("Same arguments, same bits, on any thread", "[tracer]") {
  const PadShape s = coarse();
  const Model m = pad(s);
  const Tracer<BeerLambert> tracer(quick());
  MechanicalState state;
  const Dent d{1e-3, 1e-3, 5e-3, 4e-3, 2e-3};
  state.displacement = d.displacement(s, m.mesh);
  state.contact_field = d.contact(s, m.mesh);
  const Response once = tracer.trace(m.body, m.mesh, state);
  std::vector<Response> again(2);
  std::vector<std::thread> threads;
  for (Response& r : again) threads.emplace_back([&] { r = tracer.trace(m.body, m.mesh, state); });
  for (std::thread& t : threads) t.join();
  for (const Response& r : again) CHECK((r.replicates.array() == once.replicates.array()).all());
}

TEST_CASE("The stated error covers the scatter over seeds", "[tracer]") {
  const PadShape s = coarse(0.0);
  const Model m = pad(s);
  Config c = quick();
  c.rays_per_emitter = 1 << 11;
  std::vector<Response> runs;
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(11);
  const int seeds = 24;
  for (int seed = 0; seed < seeds; ++seed) {
    c.seed = std::uint64_t(seed + 1);
    runs.push_back(Tracer<BeerLambert>(c).trace(m.body, m.mesh));
    mean += Eigen::Map<const Eigen::VectorXd>(runs.back().power_W.data(), 11) / seeds;
  }
  double scatter = 0.0, stated = 0.0, covered = 0.0, absorbed = 0.0, of_absorbed = 0.0;
  for (const Response& r : runs) absorbed += r.ledger.absorbed_in_medium / seeds;
  for (const Response& r : runs) {
    const EnergyLedger error = ledger_error(r);
    CHECK(error.emitted < 1e-12);
    CHECK(std::abs(r.ledger.refinement) < 6.0 * error.refinement);  // expectation 0; Student's t, 7 degrees of freedom
    CHECK(std::abs(r.ledger.roulette) < 6.0 * error.roulette);
    of_absorbed += std::pow((r.ledger.absorbed_in_medium - absorbed) / error.absorbed_in_medium, 2) / (seeds - 1.0);
    for (std::size_t b = 0; b < 11; ++b) {
      const double off = r.power_W[b] - mean[Eigen::Index(b)];
      scatter += off * off * seeds / (seeds - 1.0);
      stated += r.error_W[b] * r.error_W[b];
      covered +=
          std::abs(off) < 2.36 * r.error_W[b] ? 1.0 / (11.0 * seeds) : 0.0;  // Student's t, 7 degrees of freedom: 95 %
    }
  }
  CHECK(of_absorbed > 0.5);
  CHECK(of_absorbed < 3.0);
  CHECK(scatter / stated > 0.5);
  CHECK(scatter / stated < 2.0);
  CHECK(covered > 0.87);
}

TEST_CASE("Gathering backwards and tracing forwards agree within their errors", "[tracer]") {
  for (double gap : {0.0, 3e-3}) {
    PadShape s = coarse(gap);
    s.medium = {1.41, 14.5063};
    const Model m = pad(s);
    const Dent d{1.5e-3, 2e-3, 4e-3, 3e-3, 2e-3};
    Config c = quick();
    c.rays_per_emitter = c.carrier_rays = 1 << 15;
    c.exit_rays = 1 << 16;
    const auto u = d.displacement(s, m.mesh);
    const auto phi = d.contact(s, m.mesh);
    const Response gathered = Tracer<BeerLambert>(c).trace(m.body, m.mesh, u, phi);
    c.exit_rays = 0;
    c.seed = 1;
    c.carrier_rays = 1 << 18;
    const Response forward = Tracer<BeerLambert>(c).trace(m.body, m.mesh, u, phi);
    double square = 0.0, sum = 0.0, error = 0.0;
    for (std::size_t b = 0; b < 11; ++b) {
      const double off = gathered.power_W[b] - forward.power_W[b];
      const double e2 = std::pow(gathered.error_W[b], 2) + std::pow(forward.error_W[b], 2);
      square += off * off / e2 / 11.0;
      sum += off;
      error += e2;
    }
    CHECK(square < 3.0);
    CHECK(std::abs(sum) < 5.0 * std::sqrt(error) + 0.002 * forward.replicates.sum() / 8.0);
    CHECK(forward.ledger.refinement == 0.0);
    CHECK(std::abs(gathered.ledger.refinement) < 0.05 * forward.replicates.sum() / 8.0);
    const double direct = gathered.direct.sum() / 8.0;
    CHECK(direct == Approx(forward.direct.sum() / 8.0).epsilon(0.01));
  }
}

TEST_CASE("Common rays: neighbouring states differ by far less noise than independent ones", "[tracer]") {
  const PadShape s = coarse(0.0);
  const Model m = pad(s);
  const Tracer<BeerLambert> tracer(quick());
  const auto run = [&](double depth) {
    return tracer.trace(m.body, m.mesh, Dent{depth, 0, 5e-3, 4e-3, 0}.displacement(s, m.mesh), {});
  };
  const Response a = run(0.2e-3), b = run(0.25e-3);
  const auto norm = [](const std::vector<double>& v) {
    return Eigen::Map<const Eigen::VectorXd>(v.data(), Eigen::Index(v.size())).norm();
  };
  CHECK(norm(standard_error(a.replicates - b.replicates)) < 0.3 * norm(a.error_W));
}

TEST_CASE("Rays focussed on a dent know its change better, and it is the same change", "[tracer]") {
  const PadShape s = coarse(0.0);
  const Model m = pad(s);
  std::vector<Vec3d> dent = Dent{0.3e-3, 0, 16e-3, 4e-3, 0}.displacement(s, m.mesh);
  for (std::size_t i = 0; i < dent.size(); ++i)
    dent[i] *= std::exp(-std::abs(m.mesh.nodes[i].y() - 16e-3) / 4e-3);  // a bonded pad is still a thickness away
  const Symmetry across{true, false};
  double noise[2] = {0.0, 0.0}, rays[2] = {0.0, 0.0};
  Eigen::VectorXd mean[2] = {Eigen::VectorXd::Zero(11), Eigen::VectorXd::Zero(11)}, square = Eigen::VectorXd::Zero(11);
  for (std::uint64_t seed = 1; seed <= 6; ++seed)
    for (const bool focussed : {false, true}) {
      Config c = quick();
      c.rays_per_emitter = 1 << 13;
      c.seed = seed;
      const Tracer<BeerLambert> tracer(c);
      const RayFocus focus{16e-3, focussed ? 10e-3 : 0.0};
      const Response rest = tracer.trace(m.body, m.mesh, std::vector<Vec3d>{}, {}, across, focus),
                     loaded = tracer.trace(m.body, m.mesh, dent, {}, across, focus);
      CHECK(loaded.ledger.emitted == Approx(1.0));
      CHECK(loaded.ledger.imbalance() < 1e-9);
      const Eigen::MatrixXd change = loaded.replicates - rest.replicates;
      const std::vector<double> error = standard_error(change);
      for (std::size_t b = 0; b < 11; ++b) square[Eigen::Index(b)] += error[b] * error[b] / 36.0;
      noise[focussed] += Eigen::Map<const Eigen::VectorXd>(error.data(), 11).squaredNorm();
      rays[focussed] += double(loaded.rays);
      mean[focussed] += change.colwise().mean().transpose() / 6.0;
    }
  CHECK(noise[1] / noise[0] < 0.7);
  CHECK(rays[1] < 1.2 * rays[0]);
  CHECK(((mean[1] - mean[0]).array().square() / square.array()).mean() < 2.5);
  CHECK((mean[0].array().square() / square.array()).maxCoeff() > 100.0);

  const Tracer<BeerLambert> tracer(quick());
  const RayFocus focus{16e-3, 10e-3};
  CHECK(distance(tracer.trace(m.body, m.mesh, dent, {}, {}, focus).power_W,
            tracer.trace(m.body, m.mesh, dent, {}, across, focus).power_W) < 1e-6);
  CHECK_THROWS_AS(tracer.trace(m.body, m.mesh, std::vector<Vec3d>{}, {}, Symmetry{true, true}, focus), InvalidArgument);
  CHECK_THROWS_AS(tracer.trace(m.body, m.mesh, dent, {}, across, {std::nan(""), 10e-3}), InvalidArgument);
  CHECK_THROWS_AS(tracer.trace(m.body, m.mesh, dent, {}, across, {0.0, -1e-3}), InvalidArgument);
}

TEST_CASE("A scene far from the origin gives the same response", "[tracer]") {
  const PadShape s = coarse();
  Model m = pad(s);
  const Tracer<BeerLambert> tracer(quick());
  const Response near = tracer.trace(m.body, m.mesh);
  const Vec3d far(0.0, 0.0, 64.0);
  for (Vec3d& p : m.mesh.nodes) p += far;
  for (Emitter& e : m.body.emitters) {
    RectangleEmitter moved = *e.as<RectangleEmitter>();
    moved.center += far;
    e = moved;
  }
  for (RigidFace& f : m.body.rigid_faces)
    for (Vec3d& p : f.corners) p += far;
  for (Patch& p : m.body.patches) {
    if (auto* plane = std::get_if<Plane>(&p.shape)) plane->point += far;
    if (auto* cylinder = std::get_if<EllipticCylinder>(&p.shape)) cylinder->center += far;
  }
  const Response away = tracer.trace(m.body, m.mesh);
  CHECK(distance(near.power_W, away.power_W) < 1e-6);
  CHECK(away.ledger.lost < 1e-6);
}

TEST_CASE("Silicone pressed into the carrier is accounted for", "[tracer]") {
  const PadShape s = coarse(4e-3);
  const Model m = pad(s);
  for (double overlap : {5e-6, 100e-6}) {
    std::vector<Vec3d> u(m.mesh.nodes.size(), Vec3d::Zero());
    for (std::size_t i = 0; i < u.size(); ++i) {  // the roof's middle comes down through the floor
      const Vec3d& p = m.mesh.nodes[i];
      const double t = (std::abs(p.x()) - 4e-3) / 4e-3;
      if (t > 0.0 && t < 1.0 && std::abs(p.z() - s.stem_height) < 1e-9)
        u[i].z() = -(s.stem_height + overlap) * 4.0 * t * (1.0 - t);
    }
    const Response r = Tracer<BeerLambert>(quick()).trace(m.body, m.mesh, u, {});
    CHECK(r.ledger.imbalance() < 1e-9);
    CHECK(r.ledger.lost < 1e-6);
  }
}

TEST_CASE("Contact: light that leaves inside {φ > 0} goes to the indenter", "[tracer]") {
  const PadShape s = coarse(0.0);
  const Model m = pad(s);
  const Tracer<BeerLambert> tracer(quick());
  const auto run = [&](double radius) {
    return tracer.trace(m.body, m.mesh, {}, Dent{0, 0, 0, 1e-3, radius}.contact(s, m.mesh));
  };
  const Response none = tracer.trace(m.body, m.mesh), small = run(3e-3), large = run(6e-3);
  CHECK(none.ledger.to_indenter == 0.0);
  CHECK(small.ledger.to_indenter > 0.0);
  CHECK(large.ledger.to_indenter > 2.0 * small.ledger.to_indenter);
  CHECK(small.ledger.elsewhere + small.ledger.to_indenter == Approx(none.ledger.elsewhere).margin(1e-6));
  std::vector<double> untouchable(m.mesh.nodes.size(), -std::numeric_limits<double>::infinity());
  CHECK(tracer.trace(m.body, m.mesh, {}, untouchable).ledger.to_indenter == 0.0);
}

TEST_CASE("A photodiode is a readout like any other", "[tracer]") {
  struct Photodiode {
    int channels(const Body&) const { return 1; }
    int channel(const Escape& e) const { return e.direction.x() > 0.9 && e.position.y() > 0.0 ? 0 : -1; }
  };
  static_assert(ExitReadout<Photodiode>);
  const PadShape s = coarse(0.0);
  const Model m = pad(s);
  const Response r = Tracer<BeerLambert, Photodiode>().trace(m.body, m.mesh);
  CHECK(r.power_W.size() == 1);
  CHECK((r.power_W[0] > 0.0 && r.power_W[0] < 0.1));
  CHECK(r.ledger.imbalance() < 1e-9);
}

TEST_CASE("Broken arguments are refused by name", "[tracer]") {
  const PadShape s = coarse();
  const Model m = pad(s);
  const Tracer<BeerLambert> tracer(quick());
  const std::vector<Vec3d> still(m.mesh.nodes.size(), Vec3d::Zero());
  std::vector<Vec3d> broken = still;
  broken[std::size_t(m.mesh.faces[0].nodes[0])].y() = std::nan("");
  CHECK_THROWS_AS(tracer.trace(m.body, m.mesh, broken, {}), InvalidArgument);
  CHECK_THROWS_AS(tracer.trace(m.body, m.mesh, {Vec3d::Zero()}, {}), InvalidArgument);
  CHECK_THROWS_AS(tracer.trace(m.body, m.mesh, still, {1.0}), InvalidArgument);
  CHECK_THROWS_AS(
      tracer.trace(m.body, m.mesh, {}, std::vector<double>(m.mesh.nodes.size(), std::nan(""))), InvalidArgument);
  Config c = quick();
  c.rays_per_emitter = 1000;
  CHECK_THROWS_AS(Tracer<BeerLambert>(c).trace(m.body, m.mesh), InvalidArgument);
  CHECK_THROWS_AS(tracer.refined(3), InvalidArgument);
  CHECK(tracer.refined(4).config().exit_rays == 4 * quick().exit_rays);
  CHECK(tracer.refined(4).config().seed == tracer.config().seed);
  CHECK(tracer.refined(1, 1).config().seed != tracer.refined(1, 2).config().seed);
  CHECK(tracer.refined(0.5).config().exit_rays == quick().exit_rays / 2);
  CHECK_THROWS_AS(tracer.refined(0.3), InvalidArgument);
  c = quick();
  c.replicates = 1;
  CHECK_THROWS_AS(Tracer<BeerLambert>(c).trace(m.body, m.mesh), InvalidArgument);
  Model lopsided = pad(s);
  lopsided.body.emitters.pop_back();
  CHECK_THROWS_AS(
      tracer.trace(lopsided.body, lopsided.mesh, std::vector<Vec3d>{}, {}, Symmetry{false, true}), InvalidArgument);
  CHECK_NOTHROW(tracer.trace(lopsided.body, lopsided.mesh));
}

TEST_CASE("replicates that are traced apart make the response of all") {
  const Model m = pad(coarse(0.0));
  const Tracer<BeerLambert> tracer(quick());
  const Response whole = tracer.trace(m.body, m.mesh);
  const int half = quick().replicates / 2;
  const Response joined = Tracer<BeerLambert>::joined(
      {tracer.portion(0, half).trace(m.body, m.mesh), tracer.portion(half, half).trace(m.body, m.mesh)});
  CHECK(joined.replicates == whole.replicates);
  CHECK(joined.direct == whole.direct);
  CHECK(joined.power_W == whole.power_W);
  CHECK(joined.error_W == whole.error_W);
  CHECK(joined.rays == whole.rays);
  CHECK(joined.ledger.emitted == Approx(whole.ledger.emitted).epsilon(1e-12));
  CHECK(joined.ledger.imbalance() < 1e-9);
}

TEST_CASE(
    "What a tool does to light where it wets the pad: black takes it, a perfect mirror keeps it, white spreads it",
    "[tracer]") {
  PadShape s = coarse(0.0);
  s.medium.extinction_per_m = 0.0;
  Model m = pad(s);
  const Tracer<BeerLambert> tracer(quick());
  const std::vector<double> touch = Dent{0, 0, 0, 1e-3, 6e-3}.contact(s, m.mesh);
  const auto run = [&](const SurfaceOptics& tool) {
    m.body.touched = tool;
    const Response r = tracer.trace(m.body, m.mesh, {}, touch);
    CHECK(r.ledger.imbalance() < 1e-9);
    return r;
  };
  const Response film = run(Dielectric{}), black = run(Absorber{}), mirror = run(Mirror{1.0}),
                 white = run(Lambertian{1.0}), gray = run(Lambertian{0.6});
  CHECK(black.ledger.to_indenter > 1.2 * film.ledger.to_indenter);  // total reflection is over, too
  CHECK(mirror.ledger.to_indenter == Approx(0.0).margin(1e-12));
  CHECK(white.ledger.to_indenter == Approx(0.0).margin(1e-12));
  CHECK(gray.ledger.to_indenter >
        0.4 * 0.9 * black.ledger.to_indenter);  // of what comes once; what comes back is taken again
  CHECK(gray.ledger.to_indenter < black.ledger.to_indenter);
  CHECK(white.power_W[5] > black.power_W[5]);
}

TEST_CASE("Light that a white tool throws back is found forwards and backwards alike", "[tracer]") {
  const PadShape s = coarse(0.0);
  Model m = pad(s);
  m.body.touched = Lambertian{0.8};
  const std::vector<double> touch = Dent{0, 0, 0, 1e-3, 6e-3}.contact(s, m.mesh);
  Config forwards = quick();
  forwards.exit_rays = 0;
  forwards.rays_per_emitter = 1 << 14;
  forwards.carrier_rays = 1 << 16;
  const Response a = Tracer<BeerLambert>(quick()).trace(m.body, m.mesh, {}, touch),
                 b = Tracer<BeerLambert>(forwards).trace(m.body, m.mesh, {}, touch);
  for (std::size_t k = 0; k < 11; ++k)
    CHECK(std::abs(a.power_W[k] - b.power_W[k]) < 4.5 * std::hypot(a.error_W[k], b.error_W[k]));
}

TEST_CASE(
    "Regions in space stay where they are when the pad is moved, regions of the material go with it", "[tracer]") {
  const PadShape s = coarse(0.0);
  Model m = pad(s);
  m.mesh.symmetry = {};
  m.body.region = [](const Vec3d& p, const Vec3d&) {
    return p.y() < -27.5e-3 || p.y() > 27.5e-3 ? -1 : std::min(10, int((p.y() + 27.5e-3) / 5e-3));
  };
  const Tracer<BeerLambert> tracer(quick());
  const Response rest = tracer.trace(m.body, m.mesh, {}, {}, Symmetry{});
  std::vector<Emitter> moved;
  for (const Emitter& e : m.body.emitters) {
    RectangleEmitter r = *e.as<RectangleEmitter>();
    r.center.y() += 5e-3;
    moved.push_back(r);
  }
  m.body.emitters = moved;
  const std::vector<Vec3d> away(m.mesh.nodes.size(), Vec3d(0, 5e-3, 0));
  const Response material = tracer.trace(m.body, m.mesh, away, {}, Symmetry{});
  m.body.regions_in_space = true;
  const Response space = tracer.trace(m.body, m.mesh, away, {}, Symmetry{});
  for (std::size_t k = 0; k < 11; ++k) {
    CHECK(std::abs(material.power_W[k] - rest.power_W[k]) < 5.0 * std::hypot(material.error_W[k], rest.error_W[k]));
    if (k > 0)
      CHECK(std::abs(space.power_W[k] - rest.power_W[k - 1]) < 5.0 * std::hypot(space.error_W[k], rest.error_W[k - 1]));
  }
  CHECK(std::abs(space.power_W[3] - rest.power_W[3]) > 10.0 * rest.error_W[3]);  // the two are not the same thing
}

TEST_CASE(
    "Light seen by its direction: gathered and forward tracing agree, and both directions are all of it", "[tracer]") {
  const PadShape s = coarse();
  Model m = pad(s);
  m.body.region = [](const Vec3d&, const Vec3d&) { return 0; };
  m.body.regions = 1;
  auto forwards = quick();
  forwards.exit_rays = 0;
  const Response all = Tracer<BeerLambert>(quick()).trace(m.body, m.mesh);
  m.body.seen_towards = Vec3d::UnitX();
  const Response gathered = Tracer<BeerLambert>(quick()).trace(m.body, m.mesh),
                 traced = Tracer<BeerLambert>(forwards).trace(m.body, m.mesh);
  CHECK(std::abs(gathered.power_W[0] - traced.power_W[0]) < 4.5 * std::hypot(gathered.error_W[0], traced.error_W[0]));
  CHECK(2.0 * gathered.power_W[0] == Approx(all.power_W[0]).epsilon(1e-3));  // the pad is its own mirror image
  m.body.seen_towards = Vec3d(1.0, 0.0, 1.0).normalized();
  const double up = Tracer<BeerLambert>(quick()).trace(m.body, m.mesh).power_W[0];
  m.body.seen_towards = -m.body.seen_towards;
  const double down = Tracer<BeerLambert>(quick()).trace(m.body, m.mesh).power_W[0];
  CHECK(up + down == Approx(all.power_W[0]).epsilon(1e-9));
  CHECK(up > 1.2 * down);  // light leaves through the dome, away from the carrier
}

TEST_CASE("One side seen is half of both in a symmetric state", "[tracer]") {
  const PadShape s = coarse();
  Model m = pad(s);
  const Tracer<BeerLambert> tracer(quick());
  const Response both = tracer.trace(m.body, m.mesh);
  m.body.region = [region = m.body.region](const Vec3d& p, const Vec3d& n) { return n.x() > 0.0 ? region(p, n) : -1; };
  m.body.region_image_y = std::vector<int>{10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0};  // it has no facets to be asked at
  const Response one = tracer.trace(m.body, m.mesh);
  for (std::size_t k = 0; k < 11; ++k) CHECK(2.0 * one.power_W[k] == Approx(both.power_W[k]).epsilon(1e-9));
  CHECK_FALSE(tracer.image_channels(m.body, 0));
  CHECK(tracer.image_channels(m.body, 1));
}

TEST_CASE(
    "LEDs in the air of the gaps: a quarter, a half and the whole pad agree, and a gap that is pressed shut takes "
    "their air away",
    "[tracer]") {
  const PadShape s = coarse(2e-3);
  Model m = pad(s);
  m.body.emitters.clear();
  for (const double y : {-11e-3, 0.0, 11e-3})
    for (const double side : {1.0, -1.0})
      m.body.emitters.push_back(RectangleEmitter{
          {side * (4e-3 - 10e-6), y, 2.5e-3}, {0, 0.8e-3, 0}, {0, 0, side * 0.4e-3}, 1.0 / 6.0, 0, true});
  const Tracer<BeerLambert> tracer(quick());
  const Response quarter = tracer.trace(m.body, m.mesh),
                 half = tracer.trace(m.body, m.mesh, {}, {}, Symmetry{true, false}),
                 whole = tracer.trace(m.body, m.mesh, {}, {}, Symmetry{});
  CHECK(quarter.ledger.emitted == Approx(1.0));
  for (const Response* r : {&quarter, &half, &whole}) {
    CHECK(r->ledger.imbalance() < 1e-9);
    CHECK(r->ledger.lost <= 1e-6);
  }
  CHECK(distance(whole.power_W, half.power_W) < 1e-6);
  CHECK(distance(whole.power_W, quarter.power_W) < 1e-6);
  for (std::size_t k = 0; k < 11; ++k) CHECK(whole.power_W[k] > 0.0);

  // The walls of the gaps lie 20 µm behind the stem's face, and with them all LEDs inside.
  std::vector<Vec3d> shut(m.mesh.nodes.size(), Vec3d::Zero());
  for (std::size_t n = 0; n < shut.size(); ++n)
    if (const Vec3d& p = m.mesh.nodes[n]; std::abs(std::abs(p.x()) - 6e-3) < 1e-9 && p.z() < 5e-3 - 1e-9)
      shut[n].x() = p.x() > 0.0 ? -2.02e-3 : 2.02e-3;
  const Response pressed = tracer.trace(m.body, m.mesh, shut, {});
  CHECK(pressed.ledger.imbalance() < 1e-9);
  CHECK(pressed.ledger.absorbed_in_medium > whole.ledger.absorbed_in_medium);  // no wall of the gap turns light back
  CHECK(pressed.ledger.elsewhere < 0.6);  // nor does it leave as if there were no pad
}
