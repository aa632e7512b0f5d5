#include "report/report_press.hpp"

#include "charts/contact_outline.hpp"

#include <cmath>

namespace lumo::program {

namespace {

/// Vectors [m] of the chosen nodes as whole µm, x, y, z of one after the other.
Json micrometres(const std::vector<Vec3d>& vectors, const std::vector<std::size_t>& nodes) {
  Json list = Json::array();
  for (const std::size_t n : nodes)
    for (int i = 0; i < 3; ++i) list.push_back(std::llround(1e6 * vectors[n][i]));
  return list;
}

double rounded(double value, double step) { return std::round(value / step) * step; }

/// Force on the pad, of all tractions.
Vec3d traction_sum(const MechanicalState& s) {
  Vec3d sum = Vec3d::Zero();
  for (const TractionPoint& p : s.tractions) sum += p.area_m2 * p.traction_Pa;
  return sum;
}

Json outlines(const TetMesh& mesh, const std::vector<double>& field) {
  Json loops = Json::array();
  for (const Points& loop : contact_outline(mesh, field)) {
    Json& points = loops.emplace_back(Json::array());
    for (const Point& p : loop) points.push_back({std::round(1e3 * p[0]) / 1e3, std::round(1e3 * p[1]) / 1e3});
  }
  return loops;
}

}  // namespace

Json press_model(const Configuration& request, const PressOutcome& outcome) {
  Json j = {{"diameter_mm", request.touch.diameter_mm}, {"note", outcome.why}, {"states", Json::array()}};
  if (!outcome.press) return j;
  const PressResult& press = *outcome.press;
  const TetMesh& mesh = press.mesh;

  std::vector<std::size_t> nodes;
  std::vector<int> number(mesh.nodes.size(), -1);
  Json triangles = Json::array();
  for (const auto& facet : sub_facets(mesh))
    for (const std::size_t node : facet) {
      if (number[node] < 0) {
        number[node] = int(nodes.size());
        nodes.push_back(node);
      }
      triangles.push_back(number[node]);
    }
  j["triangles"] = std::move(triangles);
  j["rest_um"] = micrometres(mesh.nodes, nodes);
  const double apex_mm = request.pad.theta_mm[0] + request.pad.theta_mm[1];
  for (const MechanicalState& s : press.states) {
    if (!is_scored(s.status, request.mechanics.holds())) {
      j["note"] = lumo::message("no equilibrium at ", s.load_N, " N (", to_string(s.status), ")");
      break;
    }
    Json traction = Json::array();
    for (const std::size_t n : nodes)
      for (int i = 0; i < 3; ++i) traction.push_back(rounded(1e-3 * s.traction_Pa[n][i], 0.125) + 0.0);  // no −0
    j["states"].push_back({{"load_N", s.load_N}, {"depth_mm", 1e3 * s.depth_m},
        {"sphere_z_mm",
            apex_mm + 0.5 * request.touch.diameter_mm - 1e3 * s.depth_m},  // the sphere meets the apex first
        {"contact_area_mm2", 1e6 * s.contact_area_m2}, {"reference_area_mm2", 1e6 * s.reference_area_m2},
        {"displacement_um", micrometres(s.displacement, nodes)}, {"traction_kPa", std::move(traction)},
        {"traction_sum_N", -traction_sum(s).z()}, {"outlines_mm", outlines(mesh, s.contact_field)}});
  }
  return j;
}

}  // namespace lumo::program
