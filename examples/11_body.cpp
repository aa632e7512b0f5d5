// 11 Body: a plate of one's own, from its corners to the light at its four walls. docs/pages/body.md goes through it.
#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/mesh/swept_mesher.hpp"
#include "lumo/optics/tracer.hpp"

#include <cstdio>

using namespace lumo;

Body plate(const Silicone& card) {
  const double a = 12.0_mm, b = 15.0_mm, h = 8.0_mm;  // half its width, half its length, its height
  //! [patches]
  enum { floor, top, side, end };
  Body body;
  body.name = "plate";
  body.patches = {
      {.name = "floor", .shape = Plane{{0, 0, 0}, {0, 0, -1}}, .bonded = true, .optics = Lambertian{.albedo = 0.8}},
      {.name = "top", .shape = Plane{{0, 0, h}, {0, 0, 1}}, .contactable = true},
      {.name = "side", .shape = Plane{{a, 0, 0}, {1, 0, 0}}},
      {.name = "end", .shape = Plane{{0, b, 0}, {0, 1, 0}}},
  };
  //! [patches]
  //! [facets]
  body.symmetry = {.x = true, .y = true};  // what follows is the quarter x >= 0, y >= 0
  body.vertices = {{0, 0, 0}, {a, 0, 0}, {a, b, 0}, {0, b, 0}, {0, 0, h}, {a, 0, h}, {a, b, h}, {0, b, h}};
  body.facets = {{{0, 3, 2, 1}, floor}, {{4, 5, 6, 7}, top}, {{1, 2, 6, 5}, side}, {{3, 7, 6, 2}, end},
      {{0, 4, 7, 3}, Body::mirror_patch}, {{0, 1, 5, 4}, Body::mirror_patch}};
  body.exact_volume_m3 = 4.0 * a * b * h;
  body.sizing.edge = [](const Vec3d&) { return 4.0_mm; };
  //! [facets]
  //! [light]
  body.medium = card.medium();
  for (const double y : {-6.0_mm, 6.0_mm}) body.emitters.push_back(DiscEmitter{.center = {0, y, 0}});
  body.regions = 4;  // walls to +x, -x, +y and -y
  body.region = [](const Vec3d&, const Vec3d& n) {
    return n.x() > 0.5 ? 0 : n.x() < -0.5 ? 1 : n.y() > 0.5 ? 2 : n.y() < -0.5 ? 3 : -1;
  };
  //! [light]
  return body;
}

int main() {
  const Silicone card = solaris();
  const Body body = plate(card);
  //! [press]
  const Scenario<Sphere> ball{.indenter = {.diameter_m = 10.0_mm}, .y_m = 6.0_mm, .loads_N = {0.5, 1.0, 2.0}};
  const SweptMesher mesher;  // for prisms along y; TetgenMesher fills any body
  const TetMesh mesh =
      mesh_for_contact(body, mesh_body(body, mesher), std::vector{ball}, mesher, {.finest = 0.8_mm, .growth = 0.5});
  const Simulator simulator{NeoHookean{.mu = card.mu_Pa, .lambda = card.lambda_Pa}, SDFContact{}};
  const std::vector<MechanicalState> states = simulator.press(body, mesh, ball);
  //! [press]
  for (const MechanicalState& s : states)
    std::printf("%4.1f N: %.3f mm deep, %s\n", s.force_N, 1e3 * s.depth_m, to_string(s.status).data());
  //! [trace]
  const Tracer<BeerLambert> light({.rays_per_emitter = 1 << 14, .carrier_rays = 1 << 15, .exit_rays = 1 << 17});
  const Response rest = light.trace(body, mesh), pressed = light.trace(body, mesh, states.back(), {.x = true});
  const std::vector<double> error_W = standard_error(pressed.replicates - rest.replicates);  // of the change
  //! [trace]
  //! [mesh error]
  Tracer<BeerLambert>::Config finer = light.config();
  finer.scene.sub_facets *= 2;
  const Response smoother = Tracer<BeerLambert>(finer).trace(body, mesh, states.back(), {.x = true});
  //! [mesh error]
  const char* const walls[] = {"+x", "-x", "+y", "-y"};
  for (std::size_t r = 0; r < 4; ++r)
    std::printf("wall %s: %.4f W at rest, %+.4f +- %.4f W under %.0f N, %+.4f with finer facets\n", walls[r],
        rest.power_W[r], pressed.power_W[r] - rest.power_W[r], error_W[r], states.back().force_N,
        smoother.power_W[r] - pressed.power_W[r]);
  return states.back().status == Status::converged && pressed.ledger.imbalance() < 1e-9 ? 0 : 1;
}
