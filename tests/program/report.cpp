#include "catch.hpp"

#include "charts/contact_outline.hpp"
#include "report/chart_library.hpp"
#include "report/report_press.hpp"

#include <limits>
#include <numbers>

using namespace lumo;
using namespace lumo::program;

namespace {

/// The square [−10, 10]² mm in the plane z = 0 with 2 n² triangles, or half as many per edge with their edge middles:
/// the same sub-triangles.
TetMesh square(int n, int order) {
  TetMesh mesh;
  mesh.order = order;
  for (int i = 0; i <= n; ++i)
    for (int k = 0; k <= n; ++k) mesh.nodes.emplace_back(-10e-3 + 20e-3 * i / n, -10e-3 + 20e-3 * k / n, 0.0);
  const auto node = [n](int i, int k) { return i * (n + 1) + k; };
  for (int i = 0; i < n; i += order)
    for (int k = 0; k < n; k += order) {
      const int a = order, h = 1;  // a facet's edge, and half of a curved one's
      if (order == 1) {
        mesh.faces.push_back({{node(i, k), node(i + a, k), node(i + a, k + a), -1, -1, -1}, 0});
        mesh.faces.push_back({{node(i, k), node(i + a, k + a), node(i, k + a), -1, -1, -1}, 0});
      } else {
        mesh.faces.push_back(
            {{node(i, k), node(i + a, k), node(i + a, k + a), node(i + h, k), node(i + a, k + h), node(i + h, k + h)},
                0});
        mesh.faces.push_back(
            {{node(i, k), node(i + a, k + a), node(i, k + a), node(i + h, k + h), node(i + h, k + a), node(i, k + h)},
                0});
      }
    }
  return mesh;
}

/// Distance [m] inside two discs of radius 4 and 2 mm about (x, y) = (0, −5) and (0, 5) mm.
std::vector<double> two_discs(const TetMesh& mesh) {
  std::vector<double> field;
  for (const Vec3d& p : mesh.nodes)
    field.push_back(std::max(4e-3 - (p - Vec3d(0, -5e-3, 0)).norm(), 2e-3 - (p - Vec3d(0, 5e-3, 0)).norm()));
  return field;
}

/// Signed, positive when the loop turns from the first coordinate to the second [mm²].
double area(const std::vector<Point>& loop) {
  double twice = 0.0;
  for (std::size_t k = 0; k + 1 < loop.size(); ++k) twice += loop[k][0] * loop[k + 1][1] - loop[k + 1][0] * loop[k][1];
  return 0.5 * twice;
}

double error_of_area(int n) {
  const TetMesh mesh = square(n, 1);
  double sum = 0.0;
  for (const auto& loop : contact_outline(mesh, two_discs(mesh))) sum += std::abs(area(loop));
  return std::abs(sum - std::numbers::pi * (16.0 + 4.0));
}

PressOutcome press_of(std::vector<MechanicalState> states) {
  PressOutcome outcome;
  outcome.press.emplace();
  outcome.press->mesh = square(4, 2);
  const std::size_t n = outcome.press->mesh.nodes.size();
  for (MechanicalState& s : states) {
    s.displacement.assign(n, Vec3d(1.4e-6, 0.0, -2.6e-6));
    s.pressure_Pa.assign(n, 5e3);
    s.traction_Pa.assign(n, Vec3d(0.0, 0.0, -5e3));
    s.contact_field.assign(n, -std::numeric_limits<double>::infinity());
  }
  outcome.press->states = std::move(states);
  return outcome;
}

}  // namespace

TEST_CASE("edges of contact are closed loops with the area of the set") {
  const TetMesh mesh = square(40, 1);
  const auto loops = contact_outline(mesh, two_discs(mesh));
  REQUIRE(loops.size() == 2);
  for (const auto& loop : loops) {
    CHECK(loop.front() == loop.back());
    const bool large = loop.front()[0] < 0.0;  // (y, x)
    CHECK(std::abs(area(loop)) == Approx(std::numbers::pi * (large ? 16.0 : 4.0)).epsilon(0.02));
    CHECK(area(loop) * area(loops.front()) > 0.0);
    for (const Point& p : loop)
      CHECK(std::hypot(p[0] - (large ? -5.0 : 5.0), p[1]) == Approx(large ? 4.0 : 2.0).epsilon(0.02));
  }
  CHECK(error_of_area(80) < 0.4 * error_of_area(40));  // of second order
}

TEST_CASE("the edge of contact of curved faces runs through their sub-facets") {
  const TetMesh flat = square(40, 1), curved = square(40, 2);
  const auto field = two_discs(flat);
  double of_flat = 0.0, of_curved = 0.0;
  for (const auto& loop : contact_outline(flat, field)) of_flat += area(loop);
  for (const auto& loop : contact_outline(curved, field)) of_curved += area(loop);
  CHECK(of_curved == Approx(of_flat).epsilon(0.005));  // the diagonals of some squares differ
}

TEST_CASE("where nothing can touch, the edge of contact is at the last node that can") {
  const TetMesh mesh = square(20, 1);
  std::vector<double> field(mesh.nodes.size(), -std::numeric_limits<double>::infinity());
  for (std::size_t k = 0; k < field.size(); ++k)
    if (mesh.nodes[k].cwiseAbs().maxCoeff() < 3.5e-3) field[k] = 1e-3;
  const auto loops = contact_outline(mesh, field);
  REQUIRE(loops.size() == 1);
  CHECK(std::abs(area(loops[0])) == Approx(36.0));
  CHECK(contact_outline(mesh, std::vector<double>(mesh.nodes.size(), -1.0)).empty());
}

TEST_CASE("a press in the page: whole micrometres, four triangles a face, the sphere above its depth") {
  Configuration request;
  request.pad.theta_mm = {5.0, 7.0, 8.0, 4.0, 1.0};
  request.touch.diameter_mm = 30.0;
  MechanicalState s;
  s.status = Status::converged;
  s.load_N = 2.0;
  s.depth_m = 1.5e-3;
  const Json j = press_model(request, press_of({s}));
  CHECK(j["note"] == "");
  CHECK(j["triangles"].size() == 3 * 4 * 8);  // 2 × 2 squares of two curved faces
  CHECK(j["rest_um"].size() == 3 * 25);
  REQUIRE(j["states"].size() == 1);
  CHECK(j["states"][0]["displacement_um"][0] == 1);
  CHECK(j["states"][0]["displacement_um"][2] == -3);
  CHECK(j["states"][0]["traction_kPa"].size() == 3 * 25);
  CHECK(j["states"][0]["traction_kPa"][2] == -5.0);
  CHECK(j["states"][0]["traction_sum_N"] == 0.0);  // no point of it was given
  CHECK(j["states"][0]["sphere_z_mm"].get<double>() == Approx(12.0 + 15.0 - 1.5));
  CHECK(j["states"][0]["outlines_mm"].empty());
}

TEST_CASE("a press that fails leaves what is sound, and a sentence") {
  Configuration request;
  MechanicalState good, bad;
  good.status = Status::converged;
  good.load_N = 5.0;
  bad.status = Status::not_positive_definite;
  bad.load_N = 10.0;
  const Json part = press_model(request, press_of({good, bad}));
  CHECK(part["states"].size() == 1);
  CHECK(part["note"] == "no equilibrium at 10 N (not_positive_definite)");
  const Json none = press_model(request, PressOutcome{std::nullopt, "mesh: crashed"});
  CHECK(none["states"].empty());
  CHECK(none["note"] == "mesh: crashed");
}

TEST_CASE("without the chart library a report is refused with what to install") {
  std::string why;
  try {
    chart_library();
  } catch (const InputError& e) {
    why = e.what();
  }
  CHECK(why.find("'no/such/plotly.js'") != std::string::npos);
  CHECK(why.find("apt install python3-plotly") != std::string::npos);
  CHECK(chart_library_version().empty());
}
