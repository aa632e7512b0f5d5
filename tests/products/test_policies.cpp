#include "catch.hpp"
#include "lumo/mechanics/contact/contact_handler.hpp"
#include "lumo/mechanics/indenters/box.hpp"
#include "lumo/mechanics/indenters/capsule.hpp"
#include "lumo/mechanics/indenters/cylinder.hpp"
#include "lumo/mechanics/indenters/mesh_indenter.hpp"
#include "lumo/mechanics/indenters/oriented.hpp"
#include "lumo/mechanics/materials/mooney_rivlin.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/materials/ogden.hpp"
#include "lumo/mechanics/materials/stable_neo_hookean.hpp"
#include "lumo/mechanics/materials/yeoh.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/mechanics/solvers/vertex_block_descent.hpp"
#include "lumo/mesh/body_mesh.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/support/cholmod.hpp"
#include "lumo/support/tetgen.hpp"

#include <map>

// Every material with every element and solver, every contact with every element and solver, on a finger of few
// elements.
using namespace lumo;

namespace {

struct SmallFinger {
  Body body;
  TetMesh linear, quadratic;

  SmallFinger() {
    FingerOptions options = plain_finger();
    options.mesh = {7e-3, 9e-3, 1.0, 1.5, 1.2, 4e-3};
    body = finger(plain_baseline(), dragon_skin(), options);
    linear = mesh_body(body, TetgenMesher{}, 1);
    quadratic = mesh_body(body, TetgenMesher{}, 2);
  }
};
const SmallFinger& small_finger() {
  static const SmallFinger finger;
  return finger;
}

template <class Element> const TetMesh& mesh_for() {
  return Element::order == 1 ? small_finger().linear : small_finger().quadratic;
}

// All at Dragon Skin's small strain: what they do at 0.2 N is nearly the same.
template <class Material, class Contact, class Element, class Solver>
MechanicalState press(const Contact& contact, const Element& element) {
  Simulator<Material, Contact, Element, Solver> sim;
  sim.contact = contact;
  sim.element = element;
  if constexpr (std::same_as<Solver, VertexBlockDescent>) {
    sim.solver.config.hold_s = 0.02;
    sim.solver.config.sweeps = Element::order == 1 ? 10 : 8;
  }
  return sim.press(small_finger().body, mesh_for<Element>(), Scenario<Sphere>{Sphere{20e-3}, 0.0, 0.0, {0.2}}).front();
}

template <class Element> bool is_cured(const Element& e) { return e.mean_dilatation; }

/// Contact at vertices with two of the materials: contact knows nothing of them, and each combination compiles for
/// seconds.
template <class Contact, class Element, class Solver>
void every_material(const std::string& name, const Contact& contact, const Element& element) {
  std::map<std::string, MechanicalState> states = {
      {"NeoHookean", press<NeoHookean, Contact, Element, Solver>(contact, element)},
      {"Ogden", press<Ogden, Contact, Element, Solver>(contact, element)}};
  if constexpr (std::same_as<Contact, SDFContact>) {
    states["StableNeoHookean"] = press<StableNeoHookean, Contact, Element, Solver>(contact, element);
    states["MooneyRivlin"] = press<MooneyRivlin, Contact, Element, Solver>(contact, element);
    states["Yeoh"] = press<Yeoh, Contact, Element, Solver>(contact, element);
  }
  const MechanicalState first = states.at("NeoHookean");
  for (const auto& [material, s] : states) {
    INFO(name << " " << material << ": " << to_string(s.status) << ", " << s.force_N << " N at " << s.depth_m * 1e3
              << " mm, residual " << s.residual_N);
    CHECK(s.status == (std::same_as<Solver, VertexBlockDescent> ? Status::held : Status::converged));
    CHECK(s.certified == (s.status == Status::converged));
    // Descent stops at whole steps of 50 µm. A few nodes of quadratic faces can bear the load in more than one way.
    const double step = std::same_as<Solver, VertexBlockDescent> ? 6e-5 : 0.0;
    // The cure leaves volume changes inside an element to the rest of the law, which holds them back in one and not in
    // another: on elements as wide as the dent is deep this is seen (StableNeoHookean 35 % softer), without the cure
    // and on linear elements it is not.
    const double alike = is_cured(element) ? 0.4 : 0.03;
    if (Element::order == 1 || contact_points<Contact>() == ContactPoints::surface)
      CHECK(s.depth_m == Approx(first.depth_m).epsilon(alike).margin(step));
    CHECK(s.force_N > 0.0);
    if (s.status == Status::held) CHECK(s.met_force_N >= 0.2);
    CHECK(std::isfinite(s.residual_N));
    if (s.certified) CHECK(s.force_N == Approx(0.2).epsilon(1e-6));
  }
}

template <class Solver> void every_contact_and_element(const std::string& solver) {
  const SDFContact smooth{1e10}, rough{1e10, 0.5};
  const VertexContact vertices{.stiffness_N_per_m3 = 1e10, .friction = 0.0}, rough_vertices{.stiffness_N_per_m3 = 1e10};
  every_material<SDFContact, LinearTet, Solver>(solver + ", surface, linear", smooth, {});
  every_material<SDFContact, LinearTet, Solver>(solver + ", rough surface, linear", rough, {});
  every_material<VertexContact, LinearTet, Solver>(solver + ", vertices, linear", vertices, {});
  every_material<VertexContact, LinearTet, Solver>(solver + ", rough vertices, linear", rough_vertices, {});
  every_material<SDFContact, QuadraticTet, Solver>(solver + ", surface, quadratic", smooth, {true});
  every_material<SDFContact, QuadraticTet, Solver>(solver + ", surface, quadratic without cure", smooth, {false});
  every_material<SDFContact, LinearPatchTet, Solver>(solver + ", surface, linear patches", smooth, {true});
  every_material<VertexContact, LinearPatchTet, Solver>(solver + ", vertices, linear patches", vertices, {true});
  every_material<VertexContact, QuadraticTet, Solver>(solver + ", vertices, quadratic", vertices, {true});
  every_material<SDFContact, QuadraticTet, Solver>(solver + ", rough surface, quadratic", rough, {true});
}

}  // namespace

TEST_CASE("the quasi-static solver takes every material, contact and element") {
  every_contact_and_element<QuasiStatic<Cholmod>>("quasi-static");
}

TEST_CASE("vertex block descent takes every material, contact and element") {
  every_contact_and_element<VertexBlockDescent>("descent");
}

TEMPLATE_TEST_CASE("every indenter presses with either solver", "", QuasiStatic<Cholmod>, VertexBlockDescent) {
  Simulator<StableNeoHookean, SDFContact, LinearTet, TestType> sim;
  sim.contact.stiffness_N_per_m3 = 1e10;
  if constexpr (std::same_as<TestType, VertexBlockDescent>) sim.solver.config.hold_s = 0.02;
  const auto pad = sim.prepare(small_finger().body, small_finger().linear);
  const auto presses = [&](const std::string& name, const auto& tool) {
    const MechanicalState s = pad.press(Scenario<std::decay_t<decltype(tool)>>{tool, 0.1, 5e-3, {0.3}}).front();
    INFO(name << ": " << to_string(s.status) << ", " << s.force_N << " N at " << s.depth_m * 1e3 << " mm");
    CHECK(s.status == (std::same_as<TestType, VertexBlockDescent> ? Status::held : Status::converged));
    CHECK(s.force_N > 0.1);
    CHECK(s.depth_m > 0.0);
    CHECK(s.contact_area_m2 > 0.0);
  };
  presses("sphere", Sphere{15e-3});
  presses("box", Box{{8e-3, 8e-3, 8e-3}, 1e-3});
  presses("cylinder", Cylinder{8e-3, 10e-3, 1e-3});
  presses("bar", lying_along_x(Capsule{8e-3, 20e-3}));
  TriangleSurface cube;  // a mesh: the box without its rounding
  for (int k = 0; k < 8; ++k)
    cube.vertices.emplace_back(k & 1 ? 4e-3 : -4e-3, k & 2 ? 4e-3 : -4e-3, k & 4 ? 4e-3 : -4e-3);
  cube.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4}, {2, 6, 3}, {3, 6, 7}, {0, 4, 2},
      {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  presses("mesh", MeshIndenter(cube));
}
