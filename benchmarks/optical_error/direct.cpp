// How much of the readout is direct light, and what gathering light backwards from the regions is worth against
// following paths forward only: per design, silicone and carrier albedo the share of direct light in the unloaded
// response, the relative standard error of that response and of its change under 1 N (10 mm, y = 0), the seconds of one
// core, and by how much gathering lowers error² × seconds.
//   lumo_direct_light
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/pipeline/evaluate.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "lumo/support/tetgen.hpp"

#include <cstdio>

using namespace lumo;

namespace {

using Light = Tracer<BeerLambert, ExitPower, Embree>;

struct Quality {
  double response_error, change_error, seconds;  ///< relative; of one core
};

double norm(const std::vector<double>& v) {
  return Eigen::Map<const Eigen::VectorXd>(v.data(), Eigen::Index(v.size())).norm();
}

/// What is traced, and the change of its response.
struct TracedPress {
  const Body& body;
  const TetMesh& mesh;
  const MechanicalState& state;
  Symmetry symmetry;
  Eigen::VectorXd change;
};

Quality quality(const Light& light, const TracedPress& press) {
  const Stopwatch watch;
  const Response rest = light.trace(press.body, press.mesh);
  const Response loaded = light.trace(press.body, press.mesh, press.state, press.symmetry);
  const double seconds = watch.seconds();
  return {norm(rest.error_W) / norm(rest.power_W),
      norm(standard_error(loaded.replicates - rest.replicates)) / press.change.norm(), seconds};
}

}  // namespace

int main() {
  const TetgenMesher mesher;
  std::printf(
      "design           card  albedo  direct   gathered: response  change   seconds   paths: response  change   "
      "seconds   gain: response  change\n");
  for (const FingerDesign& d : {plain_references()[0], plain_references()[3]})
    for (const char* card : {"DS", "Sol"})
      for (const double albedo : {0.5, 0.8}) {
        const Silicone silicone = lumo::silicone(card);
        FingerOptions options = plain_finger();
        options.carrier_albedo = albedo;
        const Body body = finger(d, silicone, options);
        const std::vector<Scenario<Sphere>> scenarios{{Sphere{10.0_mm}, 0.0, 0.0, {1.0}}};
        const TetMesh mesh = mesh_for_contact(body, mesh_body(body, mesher), scenarios, mesher);
        const Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<MixedCholesky>> simulator{
            NeoHookean{silicone.mu_Pa, silicone.lambda_Pa}};
        const MechanicalState state = simulator.prepare(body, mesh).press(scenarios[0])[0];
        const Symmetry symmetry = symmetry_of(body, mesh, scenarios[0]);

        Light::Config paths;
        paths.exit_rays = 0;
        paths.rays_per_emitter *= 8;
        const Response best = Light().refined(16).trace(body, mesh),
                       pressed = Light().refined(16).trace(body, mesh, state, symmetry);
        const TracedPress press{body, mesh, state, symmetry, (pressed.replicates - best.replicates).colwise().mean()};
        const Quality p = quality(Light(paths), press), g = quality(Light(), press);
        const auto gain = [&](double a, double b) { return a * a * p.seconds / (b * b * g.seconds); };
        std::printf(
            "%g,%g,%g,%g,%g  %-4s  %.1f  %6.1f %%          %6.3f %%  %6.2f %%  %6.2f          %6.3f %%  %6.2f %%  "
            "%6.2f          %6.1f  %6.1f\n",
            d.h_fp, d.h_ep, d.w_s, d.h_s, d.w_v, card, albedo, 100.0 * best.direct.sum() / best.replicates.sum(),
            100.0 * g.response_error, 100.0 * g.change_error, g.seconds, 100.0 * p.response_error,
            100.0 * p.change_error, p.seconds, gain(p.response_error, g.response_error),
            gain(p.change_error, g.change_error));
        std::fflush(stdout);
      }
  return 0;
}
