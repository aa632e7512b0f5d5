#include "catch.hpp"
#include "lumo/mesh/body_mesh.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/tetgen.hpp"
#include "optics/analog_walk.hpp"
#include "optics/policies.hpp"

#include <algorithm>
#include <numeric>

using namespace optics_test;

namespace {

struct Sum {
  double power, error;
};

Sum side_light(const std::vector<double>& power, const std::vector<double>& error) {
  double square = 0.0;
  for (double e : error) square += e * e;
  return {std::accumulate(power.begin(), power.end(), 0.0), std::sqrt(square)};
}

void agree(const Sum& a, const Sum& b, double within) {
  INFO(a.power << " ± " << a.error << ", " << b.power << " ± " << b.error);
  CHECK(std::abs(a.power - b.power) < within * b.power + 3.0 * std::hypot(a.error, b.error));
}

// The body pushed in at its top.
MechanicalState dented(const TetMesh& mesh) {
  MechanicalState state;
  state.status = Status::converged;
  const double top = std::max_element(mesh.nodes.begin(), mesh.nodes.end(), [](const Vec3d& a, const Vec3d& b) {
    return a.z() < b.z();
  })->z();
  for (const Vec3d& p : mesh.nodes)
    state.displacement.push_back(-0.3e-3 * std::exp(-(p - Vec3d(0, 0, top)).squaredNorm() / 25e-6) * Vec3d::UnitZ());
  return state;
}

// The light of a finger's sides three ways: gathered backwards, forwards only, and walked; and backwards once more with
// what was learned from a dent. Errors are far below `within`.
template <class Medium> void three_ways(
    const FingerDesign& design, Silicone card, int rays, int walks, FingerOptions options = plain_finger()) {
  constexpr double within = 0.01;
  options.mesh.contact_edge = 3e-3;
  const Body body = finger(design, card, options);
  const TetMesh mesh = mesh_body(body, TetgenMesher{});
  using Light = Tracer<Medium, ExitPower, Embree>;
  typename Light::Config config;
  config.rays_per_emitter = rays;
  config.carrier_rays = 16 * rays;
  config.exit_rays = 32 * rays;
  const Response gathered = Light(config).trace(body, mesh);
  const MechanicalState dent = dented(mesh);
  const RayGuide guide = Light(config).guide(body, mesh, {&dent});
  CHECK(guide.directions.empty() == !body.emitters.front().in_air());
  const Response guided = Light(config).trace(body, mesh, SurfaceState{}, {}, {}, guide);
  CHECK(guided.ledger.imbalance() < 1e-9);
  config.exit_rays = 0;
  config.rays_per_emitter = 16 * rays;
  const Response forwards = Light(config).trace(body, mesh);
  const Sum g = side_light(gathered.power_W, gathered.error_W), f = side_light(forwards.power_W, forwards.error_W);
  agree(g, f, within);
  agree(side_light(guided.power_W, guided.error_W), f, within);
  const OpticalScene surface(body, mesh, {}, {}, config.scene);
  const auto scene = Embree{}.build(surface.triangles());
  const WalkedPower walked = AnalogWalk(body, surface, scene, 5).run(16, walks);
  const Sum w = side_light(walked.power_W, walked.error_W);
  agree(g, w, within);
  agree(f, w, within);
}

}  // namespace

TEST_CASE("Light of carrier faces behind a void: gathered, forwards and walked agree", "[tracer]") {
  three_ways<BeerLambert>({3, 12.5, 7, 8, 5}, solaris(), 1 << 13, 1 << 13);
}

TEST_CASE("The same in a silicone that scatters", "[tracer]") {
  const Silicone turbid = scattering_the_rest(dragon_skin(), 0.1 * dragon_skin().absorption_per_m, 0.9);
  three_ways<ScatteringMedium>({3, 12.5, 7, 8, 5}, turbid, 1 << 13, 1 << 13);
}

TEST_CASE("The same from LEDs in the recesses of a built finger's stem", "[tracer]") {
  three_ways<BeerLambert>(built_baseline(), solaris(), 1 << 13, 1 << 14, built_finger());
}

TEST_CASE("A clear slab over a white floor in air lets out what the floor sends, whatever its index", "[tracer]") {
  // The slab passes the share t of a floor's diffuse light, T = (1 − R)/(1 + R) at each angle, and returns the rest: of
  // 1 W on a floor of albedo a, a t/(1 − a (1 − t)) leaves above.
  const double half = 50e-3, albedo = 0.8;
  for (const double index : {1.2, 1.41, 1.8}) {
    Model m = box({half, half, 0.5e-3}, {index, 0.0}, 12, {0, 0, 1e-3});
    m.body.rigid_faces = {
        {"floor", {{-half, -half, 0}, {half, -half, 0}, {half, half, 0}, {-half, half, 0}}, Lambertian{albedo}}};
    m.body.regions = 1;
    m.body.region = [](const Vec3d&, const Vec3d& n) { return n.z() > 0.5 ? 0 : -1; };
    m.body.emitters = {RectangleEmitter{{0, 0, 0.4e-3}, {45e-3, 0, 0}, {0, -45e-3, 0}, 1.0, 0, true}};
    double t = 0.0;
    const int steps = 4000;
    for (int i = 0; i < steps; ++i) {
      const double c = (i + 0.5) / steps, r = fresnel(c, 1.0 / index).reflectance;
      t += (1.0 - r) / (1.0 + r) * 2.0 * c / steps;
    }
    const double exact = albedo * t / (1.0 - albedo * (1.0 - t));
    for (const int exit_rays : {0, 1 << 16}) {
      auto c = few_rays<BeerLambert, ExitPower>();
      c.carrier_rays = 1 << 14;
      c.exit_rays = exit_rays;
      const Response r = Tracer<BeerLambert>(c).trace(m.body, m.mesh);
      INFO("index " << index << ", exit rays " << exit_rays << ": " << r.power_W[0] << " ± " << r.error_W[0]);
      CHECK(r.power_W[0] == Approx(exact).margin(4.0 * r.error_W[0]));
      CHECK(r.error_W[0] < 0.02 * exact);
    }
  }
}
