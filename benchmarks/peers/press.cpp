// lumo's half of newton_time.py: the finger pressed to 5 N by a sphere of 10 mm, in equilibrium. Prints one line of
// JSON; seconds are of the processor, of one thread.
//   lumo_peer_press quadratic FINEST_MM CONTACT_MM
//       quadratic tetrahedra with the locking cure and full-surface contact, as `lumo press` has them
//   lumo_peer_press linear EDGE_MM STIFFNESS_N_PER_M
//       Newton's mesh, energy and contact, on all of it: what vertex block descent descends to

#include "half.hpp"
#include "lumo/mechanics/contact/contact_handler.hpp"
#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/materials/stable_neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/support/cholmod.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "lumo/support/tetgen.hpp"

#include <cstdio>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <string>
#include <vector>

namespace {

using namespace lumo;

constexpr double load_N = 5.0;

int quadratic(double finest_m, double contact_edge_m) {
  const Silicone card = dragon_skin();
  FingerOptions options = plain_finger();
  options.mesh.contact_edge = contact_edge_m;
  options.mesh.coarsest_edge = std::max(options.mesh.coarsest_edge, contact_edge_m);
  const Body body = finger(plain_baseline(), card, options);
  const Scenario<Sphere> scenario{.indenter = Sphere{10e-3}, .loads_N = {load_N}};
  const TetgenMesher mesher;
  const TetMesh mesh =
      mesh_for_contact(body, mesh_body(body, mesher), std::vector{scenario}, mesher, {.finest = finest_m});
  const double begun = processor_seconds();
  const Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<MixedCholesky>> simulator{
      NeoHookean{.mu = card.mu_Pa, .lambda = card.lambda_Pa}};
  const MechanicalState s = simulator.press(body, mesh, scenario).back();
  const double pressed = processor_seconds();
  std::printf("{\"nodes\": %zu, \"depth_mm\": %.9g, \"seconds\": %.4g, \"factors\": %d, \"status\": \"%s\"}\n",
      mesh.nodes.size(), 1e3 * s.depth_m, pressed - begun, s.iterations, to_string(s.status).data());
  return s.status == Status::converged ? 0 : 1;
}

int linear(double edge_m, double stiffness_N_per_m) {
  using Model = SectorModel<StableNeoHookean, VertexContact, LinearTet, Cholmod>;
  const Silicone card = dragon_skin();
  FingerOptions options = plain_finger();
  options.mesh = {edge_m, edge_m, 0.0, 1.0, 1.6, edge_m};  // as in newton_vbd.cpp
  const Body body = finger(plain_baseline(), card, options);
  const TetMesh mesh = mesh_body(body, TetgenMesher{}, 1);
  const Scenario<Sphere> scenario{.indenter = Sphere{10e-3}, .loads_N = {load_N}};
  const Touch touch = first_touch(body, mesh, scenario);
  constexpr double area = 1e-6;  // Newton's stiffness belongs to the vertex
  const VertexContact contact{
      .stiffness_N_per_m3 = stiffness_N_per_m / area, .friction = 0.0, .area_per_vertex_m2 = area};
  const StableNeoHookean material{card.mu_Pa, card.lambda_Pa};
  const double begun = processor_seconds();
  const Model model(body, mesh, {}, {material, contact, {}});
  QuasiStaticRun<Model, Sphere> path(model, scenario, touch, {});
  const Status status = path.solve(load_N);
  const double pressed = processor_seconds();
  const double depth = path.advance();
  const int factors = path.iterations;
  std::vector<Vec3d> displacement;
  for (std::size_t k = 0; k < mesh.nodes.size(); ++k)
    displacement.push_back(path.positions().col(Eigen::Index(k)) - mesh.nodes[k]);
  const double unbalanced = out_of_balance(body, mesh, PressPhysics{material, contact, LinearTet{}},
      Moving<Sphere>{&scenario.indenter, touch.origin + depth * scenario.direction(), scenario.direction()},
      {load_N, displacement});
  const double more = 1.02;  // for the slope of force over depth
  const bool good =
      status == Status::converged && unbalanced <= 1e-6 * load_N && path.solve(more * load_N) == Status::converged;
  std::printf(
      "{\"nodes\": %zu, \"depth_mm\": %.9g, \"N_per_mm\": %.6g, \"seconds\": %.4g, \"factors\": %d, \"residual_N\": "
      "%.2g, \"status\": "
      "\"%s\"}\n",
      mesh.nodes.size(), 1e3 * depth, (more - 1.0) * load_N / (1e3 * (path.advance() - depth)), pressed - begun,
      factors, unbalanced, to_string(status).data());
  return good ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    const std::vector<std::string> args(argv + 1, argv + argc);
    if (args.size() == 3 && args[0] == "quadratic")
      return quadratic(1e-3 * std::stod(args[1]), 1e-3 * std::stod(args[2]));
    if (args.size() == 3 && args[0] == "linear") return linear(1e-3 * std::stod(args[1]), std::stod(args[2]));
    std::cerr << "usage: lumo_peer_press quadratic FINEST_MM CONTACT_MM | linear EDGE_MM STIFFNESS_N_PER_M\n";
    return 2;
  } catch (const std::exception& e) {
    std::cerr << "lumo_peer_press: " << e.what() << '\n';
    return 1;
  }
}
