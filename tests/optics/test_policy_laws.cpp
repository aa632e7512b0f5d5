#include "catch.hpp"
#include "optics/policies.hpp"

using namespace optics_test;

namespace {

double total(const std::vector<double>& v) {
  double sum = 0.0;
  for (double x : v) sum += x;
  return sum;
}

// Mean square of (a − b) in units of its standard error, over all channels.
double chi_square(const Response& a, const Response& b) {
  double sum = 0.0;
  for (std::size_t c = 0; c < a.power_W.size(); ++c) {
    const double error2 = a.error_W[c] * a.error_W[c] + b.error_W[c] * b.error_W[c];
    sum +=
        error2 > 0.0 ? std::pow(a.power_W[c] - b.power_W[c], 2) / error2 : (a.power_W[c] != b.power_W[c] ? 1e9 : 0.0);
  }
  return sum / double(a.power_W.size());
}

const Vec3d inside{-1e-3, 0.5e-3, -1.5e-3};

}  // namespace

TEST_CASE("Energy: the ledger closes for every surface, emitter, medium and readout", "[policies]") {
  for_each_medium(1.41, [&](const std::string& medium_name, auto tag, const lumo::Medium& medium) {
    for_each_readout([&](const std::string& readout_name, const auto& readout) {
      using Light = Tracer<typename decltype(tag)::type, std::decay_t<decltype(readout)>>;
      for (const NamedSurface& s : all_surfaces())
        for (const NamedEmitter& e : all_emitters(inside)) {
          INFO(medium_name << ", " << readout_name << ", " << s.name << ", " << e.name);
          const Model m = lit_box(s.optics, medium, e.emitter);
          const Response r =
              Light(few_rays<typename decltype(tag)::type, std::decay_t<decltype(readout)>>(1 << 7), readout)
                  .trace(m.body, m.mesh);
          CHECK(r.ledger.imbalance() < 1e-9);
          CHECK(r.ledger.emitted == Approx(1.0));
          CHECK(r.ledger.lost < 1e-6);
          CHECK(total(r.power_W) >= (readout_name == "exit power" ? 0.01 : 0.0));
        }
    });
  });
}

TEST_CASE("White furnace: where nothing absorbs all light leaves, whatever the surface, emitter and phase function",
    "[policies]") {
  for (const auto& [albedo, g] : {std::pair(0.0, 0.0), std::pair(1.0, 0.7), std::pair(1.0, -0.3)}) {
    const lumo::Medium medium{
        1.2, albedo * 150.0, albedo, g};  // an index below √1.5 leaves no light that circles in a box for ever
    for (const NamedSurface& s : all_surfaces())
      for (const NamedEmitter& e : all_emitters(inside)) {
        if (!s.lossless) continue;
        INFO(s.name << ", " << e.name << ", albedo " << albedo << ", g " << g);
        const Model m = lit_box(s.optics, medium, e.emitter);
        const Response r = Tracer<ScatteringMedium>(few_rays<ScatteringMedium, ExitPower>()).trace(m.body, m.mesh);
        CHECK(r.ledger.absorbed_in_medium == Approx(0.0).margin(1e-12));
        CHECK(r.ledger.absorbed_at_surfaces == Approx(0.0).margin(1e-12));
        CHECK(total(r.power_W) + r.ledger.elsewhere ==
              Approx(1.0).margin(0.05));  // roulette and gathering keep it in the mean
        CHECK(r.ledger.lost < 1e-9);
      }
  }
}

TEST_CASE("Gathering and forward tracing agree for every emitter, medium and readout, and nothing is counted twice",
    "[policies]") {
  for_each_medium(1.3, [&](const std::string& medium_name, auto tag, const lumo::Medium& medium) {
    for_each_readout([&](const std::string& readout_name, const auto& readout) {
      using Policy = typename decltype(tag)::type;
      using Readout = std::decay_t<decltype(readout)>;
      for (const NamedEmitter& e : all_emitters(inside)) {
        const Model m = lit_box(Lambertian{0.9}, medium, e.emitter);
        auto config = few_rays<Policy, Readout>(1 << 13);
        const Response gathered = Tracer<Policy, Readout>(config, readout).trace(m.body, m.mesh);
        config.exit_rays = 0;
        config.seed = 7;
        config.carrier_rays = config.rays_per_emitter = 1 << 14;
        const Response forward = Tracer<Policy, Readout>(config, readout).trace(m.body, m.mesh);
        INFO(medium_name << ", " << readout_name << ", " << e.name << ": " << total(gathered.power_W) << ", "
                         << total(forward.power_W));
        CHECK(chi_square(gathered, forward) < 9.0);
        CHECK(total(gathered.power_W) == Approx(total(forward.power_W)).epsilon(0.1));
        CHECK(forward.ledger.refinement == 0.0);
      }
    });
  });
}

TEST_CASE("Reciprocity: a flat source and a flat detector of equal area may change places", "[policies]") {
  const Vec3d low{-2e-3, 1e-3, -3e-3}, high{2.5e-3, -1e-3, 3e-3};
  const auto power = [&](const Vec3d& from, const Vec3d& to, const SurfaceOptics& optics, bool round, auto tag,
                         const lumo::Medium& medium) {
    const double up = from.z() < to.z() ? 1.0 : -1.0;
    const Vec3d u(1.2e-3, 0, 0), v(0, 1.2e-3, 0);
    Model m = box({5e-3, 4e-3, 3e-3}, medium, 2);
    m.body.patches[0].optics = m.body.patches[1].optics = m.body.patches[2].optics = optics;
    if (round) m.body.emitters = {DiscEmitter{from, {0, 0, up}, 1.2e-3, 1.0, 0}};
    else m.body.emitters = {RectangleEmitter{from, u, up * v, 1.0, 0}};
    const Photodiodes diode({{to + Vec3d(0, 0, 1e-7 * up), u, -up * v, round}});
    auto config = few_rays<typename decltype(tag)::type, Photodiodes>(1 << 15);
    config.roulette_below = 0.2;
    const Response r = Tracer<typename decltype(tag)::type, Photodiodes>(config, diode).trace(m.body, m.mesh);
    return std::pair(r.power_W[0], r.error_W[0]);
  };
  for_each_medium(1.0, [&](const std::string& name, auto tag, const lumo::Medium& medium) {
    for (const NamedSurface& s : all_surfaces())
      for (bool round : {false, true}) {
        INFO(name << ", " << s.name << ", round " << round);
        const auto there = power(low, high, s.optics, round, tag, medium),
                   back = power(high, low, s.optics, round, tag, medium);
        CHECK(there.first > 3e-3);
        CHECK(std::abs(there.first - back.first) < 5.0 * std::hypot(there.second, back.second) + 1e-4 * there.first);
        CHECK(there.second < 0.06 * there.first);
      }
  });
}
