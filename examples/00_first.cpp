#include <fstream>
#include <iostream>
#include <lumo/lumo.hpp>
using namespace lumo;
int main() {
  const Silicone silicone = dragon_skin();
  const Body pad = finger({.h_fp = 6, .h_ep = 6, .w_s = 8, .h_s = 5, .w_v = 0}, silicone,
      plain_finger({.contact_edge = 3.0_mm, .growth = 0.5, .stretch_y = 2}));
  const Scenario<Sphere> ball{.indenter = {.diameter_m = 10.0_mm}, .loads_N = {1, 2, 5, 10, 15}};
  const TetMesh mesh = mesh_for_contact(
      pad, mesh_body(pad, SweptMesher{}), std::vector{ball}, SweptMesher{}, {.finest = 0.7_mm, .growth = 0.5});
  const Simulator simulator{NeoHookean{.mu = silicone.mu_Pa, .lambda = silicone.lambda_Pa}, SDFContact{}};
  const auto states = simulator.press(pad, mesh, ball);
  for (const auto& s : states)
    std::cout << s.force_N << " N at " << 1e3 * s.depth_m << " mm, " << to_string(s.status) << '\n';
  std::ofstream picture("press.svg");
  write_press_svg(picture, pad, mesh, ball, states.back());
}
