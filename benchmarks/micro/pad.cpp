#include "pad.hpp"

#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/mesh/swept_mesher.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/support/mixed_cholesky.hpp"

namespace lumo::micro {

const PressedPad& pressed_pad() {
  static const PressedPad pad = [] {
    const Silicone card = dragon_skin();
    PressedPad p;
    p.body = finger({.h_fp = 5.0, .h_ep = 10.0, .w_s = 10.0, .h_s = 6.0, .w_v = 3.0}, card,
        plain_finger({.contact_edge = 3.0_mm, .growth = 0.5}));
    p.ball = {.indenter = {.diameter_m = 10.0_mm}, .loads_N = {5.0}};
    p.mesh = mesh_for_contact(p.body, mesh_body(p.body, SweptMesher{}), std::vector{p.ball}, SweptMesher{},
        {.finest = 0.7_mm, .growth = 0.5});
    p.touch = first_touch(p.body, p.mesh, p.ball);
    const Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<MixedCholesky>> simulator{
        NeoHookean{.mu = card.mu_Pa, .lambda = card.lambda_Pa}};
    p.state = simulator.press(p.body, p.mesh, p.ball).back();
    if (p.state.status != Status::converged) throw Error("the pad of the benchmarks has no equilibrium");
    return p;
  }();
  return pad;
}

}  // namespace lumo::micro
