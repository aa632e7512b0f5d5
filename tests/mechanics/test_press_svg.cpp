#include "lumo/mechanics/press_svg.hpp"

#include "catch.hpp"
#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/mesh/swept_mesher.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "lumo/support/tetgen.hpp"

#include <regex>
#include <sstream>

using namespace lumo;

namespace {

/// Sum of the areas of all filled polygons of a colour of the scale [mm²], whose unit is that of the x axis.
double drawn_area_mm2(const std::string& svg, double px_per_mm) {
  double sum = 0.0;
  const std::regex area(
      "<path fill-rule=\"evenodd\" d=\"([^\"]*)Z\" fill=\"#[0-9a-f]{6}\" stroke=\"#[0-9a-f]{6}\" stroke-width=\"0.6\"");
  const std::regex point("[ML]([-0-9.]+) ([-0-9.]+)");
  for (std::sregex_iterator a(svg.begin(), svg.end(), area), end; a != end; ++a) {
    const std::string d = (*a)[1];
    std::vector<std::array<double, 2>> p;
    for (std::sregex_iterator q(d.begin(), d.end(), point); q != end; ++q)
      p.push_back({std::stod((*q)[1]), std::stod((*q)[2])});
    double twice = 0.0;
    for (std::size_t i = 0; i < p.size(); ++i)
      twice += p[i][0] * p[(i + 1) % p.size()][1] - p[i][1] * p[(i + 1) % p.size()][0];
    sum += 0.5 * std::abs(twice) / (px_per_mm * px_per_mm);
  }
  return sum;
}

}  // namespace

TEST_CASE(
    "the picture of a pressed body is its cut: the section's area while nothing moves, and the tool where it is") {
  const FingerDesign design{5, 10, 10, 6, 3};
  const Body body = finger(design, dragon_skin(), plain_finger());
  const double section_mm2 = 1e6 * body.exact_volume_m3 / (1e-3 * plain_pad().length);
  const TetgenMesher mesher;
  const TetMesh mesh = mesh_body(body, mesher);
  for (const double y : {0.0, 11.3e-3}) {  // through nodes, and between them
    const Scenario<Sphere> scenario{.indenter = {10e-3}, .angle_rad = 0.0, .y_m = y};
    MechanicalState state;
    state.displacement.assign(mesh.nodes.size(), Vec3d::Zero());
    std::ostringstream out;
    write_press_svg(out, body, mesh, scenario, state);
    const std::string svg = out.str();
    CHECK(drawn_area_mm2(svg, 560.0 / 40.0) == Approx(section_mm2).epsilon(0.01));
    CHECK(svg.find("nan") == std::string::npos);
    CHECK(svg.ends_with("</svg>\n"));
    // Lowest point of the sphere's outline: the apex, 15 mm high.
    const auto tool = svg.find("stroke=\"#d55e00\"");
    REQUIRE(tool != std::string::npos);
    double lowest = 0.0;
    const auto path = svg.rfind("<path", tool);
    const std::string d = svg.substr(path, tool - path);
    const std::regex point("[ML]([-0-9.]+) ([-0-9.]+)");
    for (std::sregex_iterator q(d.begin(), d.end(), point), end; q != end; ++q)
      lowest = std::max(lowest, std::stod((*q)[2]));
    const auto plot = svg.find("<clipPath");
    const double top = 56.0, height = std::stod(svg.substr(svg.find("height=\"", plot) + 8));
    CHECK((top + height - lowest) / 14.0 - 5.0 == Approx(design.h_fp + design.h_ep).margin(0.05));
  }
  MechanicalState none;
  std::ostringstream out;
  CHECK_THROWS_AS(write_press_svg(out, body, mesh, Scenario<Sphere>{}, none), InvalidArgument);
}

TEST_CASE("a swept mesh presses like an unstructured one") {
  const Silicone card = dragon_skin();
  const Body body = finger(plain_baseline(), card, plain_finger());
  const Scenario<Sphere> scenario{.indenter = {20e-3}, .loads_N = {2.0, 10.0}};
  const Focus focus{.finest = 0.6e-3, .growth = 0.2};
  const Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<MixedCholesky>> simulator{
      NeoHookean{.mu = card.mu_Pa, .lambda = card.lambda_Pa}};
  const auto pressed = [&](const auto& mesher) {
    const TetMesh mesh = mesh_for_contact(body, mesh_body(body, mesher), std::vector{scenario}, mesher, focus);
    return simulator.press(body, mesh, scenario);
  };
  const auto swept = pressed(SweptMesher{}), other = pressed(TetgenMesher{});
  REQUIRE(swept.size() == 2);
  for (std::size_t k = 0; k < 2; ++k) {
    CHECK(swept[k].certified);
    CHECK(swept[k].depth_m == Approx(other[k].depth_m).epsilon(0.005));
    CHECK(swept[k].contact_area_m2 == Approx(other[k].contact_area_m2).epsilon(0.04));
  }
}
