#include "catch.hpp"
#include "optics/scenes.hpp"

// What somebody else would write, who does not touch lumo: an emitter, a medium and a readout.
namespace outsider {

using lumo::Vec3d;

/// A ring of light, brightest along its axis: intensity 3 cos²/(2π).
struct RingLight {
  Vec3d center = Vec3d::Zero();
  double radius_m = 1e-3, power_W = 1.0;
  int channel = 0;

  Vec3d axis() const { return Vec3d::UnitZ(); }
  Vec3d point(double u, double) const {
    return center + radius_m * Vec3d(std::cos(2.0 * lumo::pi * u), std::sin(2.0 * lumo::pi * u), 0.0);
  }
  lumo::Polar polar(double u) const {
    const double c = std::cbrt(1.0 - u);
    return {std::sqrt(1.0 - c * c), c};
  }
  double intensity(double c) const { return c > 0.0 ? 1.5 / lumo::pi * power_W * c * c : 0.0; }
  RingLight mirrored(const Vec3d& m) const { return {m.cwiseProduct(center), radius_m, power_W, channel}; }
};

/// A medium that loses 2 dB/cm, whatever the body's data say.
struct TwoDecibels {
  explicit TwoDecibels(const lumo::Medium&) {}
  double refractive_index() const { return 1.0; }
  double transmittance(double path_m) const { return std::pow(10.0, -0.1 * 2.0 * 100.0 * path_m); }
};

/// Light that leaves steeply, and all other light.
struct Steep {
  double least_cosine = 0.8;

  int channels(const lumo::Body&) const { return 2; }
  int channel(const lumo::Escape& e) const { return e.direction.z() > least_cosine ? 0 : 1; }
};

static_assert(lumo::EmitterModel<RingLight> && lumo::TransparentMedium<TwoDecibels> && lumo::ExitReadout<Steep>);
static_assert(!lumo::EmitterModel<Steep> && !lumo::TurbidMedium<TwoDecibels> && !lumo::ConnectedReadout<Steep>);

}  // namespace outsider

using namespace optics_test;

TEST_CASE("An outsider's emitter, medium and readout work together, forwards and backwards, to their closed form",
    "[outsider]") {
  const double h = 5e-3, least = 0.8;
  Model m = box({0.1, 0.1, 0.5 * h}, {1.4, 99.0}, 4);
  m.body.emitters = {outsider::RingLight{{0, 0, -0.5 * h}, 1e-3, 2.0}};
  m.body.regions = 1;
  m.body.region = [](const Vec3d&, const Vec3d& n) { return n.z() > 0.5 ? 0 : -1; };
  using Light = Tracer<outsider::TwoDecibels, outsider::Steep>;
  Light::Config c;
  c.rays_per_emitter = 1 << 14;
  c.exit_rays = 0;
  double steep = 0.0;
  for (int i = 0; i < 10000; ++i) {
    const double cosine = least + (1.0 - least) * (i + 0.5) / 10000.0;
    steep += 2.0 * 3.0 * cosine * cosine * std::pow(10.0, -20.0 * h / cosine) * (1.0 - least) / 10000.0;
  }
  const Response forward = Light(c, {least}).trace(m.body, m.mesh);
  CHECK(forward.power_W[0] == Approx(steep).margin(4.0 * forward.error_W[0] + 1e-4));
  CHECK(forward.error_W[0] < 0.005 * steep);
  CHECK(forward.ledger.imbalance() < 1e-9);
  c.exit_rays = 1 << 16;
  const Response gathered = Light(c, {least}).trace(m.body, m.mesh);
  CHECK(gathered.power_W[0] == Approx(steep).margin(4.0 * gathered.error_W[0] + 1e-4));
  CHECK(gathered.ledger.imbalance() < 1e-9);
  // Its mirror images are known, too: a ring in the middle is its own.
  m.body.symmetry = m.mesh.symmetry = {true, true};
  CHECK(symmetry_of(m.body, m.mesh) == Symmetry{true, true});
  m.body.emitters.push_back(outsider::RingLight{{2e-3, 0, 0}});
  CHECK(symmetry_of(m.body, m.mesh) == Symmetry{false, true});
  REQUIRE(m.body.emitters[1].as<outsider::RingLight>() != nullptr);
  CHECK(m.body.emitters[1].as<outsider::RingLight>()->radius_m == 1e-3);
  CHECK(m.body.emitters[1].as<RectangleEmitter>() == nullptr);
}
