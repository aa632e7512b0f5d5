#include "computing/solver_study.hpp"

#include "drawing/chart.hpp"
#include "report/json.hpp"
#include "report/present.hpp"
#include "console/text.hpp"

#include <algorithm>
#include <utility>

namespace lumo::program {

namespace {

double per_load(const StateReport& s) { return s.residual_N / s.force_N; }

Json json(const SolverState& s) {
  Json j = program::json(s.state);
  j.erase("response");
  append(j, {{"met_force_N", number(s.met_force_N)},
             {"residual_over_force", number(per_load(s.state))},
             {"equilibrium_depth_mm", number(s.equilibrium_depth_mm)},
             {"distance_over_height", number(s.distance_over_height)},
             {"distance_relative", number(s.distance_relative)}});
  return j;
}

Json json(const SolverRow& r) {
  Json j = {{"name", r.name}, {"mechanics", program::json(r.mechanics)}, {"mesh", program::json(r.size)}, {"status", r.scenario.status}, {"q_form", number(r.scenario.q_form)},
            {"q_stable", number(r.scenario.q_stable)}, {"q_stiff", number(r.scenario.q_stiff)}, {"score", number(r.score)}, {"seconds", number(r.seconds)}, {"states", Json::array()}};
  for (const SolverState& s : r.states) j["states"].push_back(json(s));
  return j;
}

/// Columns of the states, as all tables show them.
const std::vector<std::string> state_columns = {"load [N]", "force [N]", "depth [mm]", "in equilibrium [mm]", "area [mm²]", "residual / force", "distance / height", "distance"};
std::vector<std::string> cells(const SolverState& s) {
  const StateReport& k = s.state;
  return {short_number(k.load_N), cell(k.force_N, 3), cell(k.depth_mm, 4), cell(s.equilibrium_depth_mm, 4), cell(k.contact_area_mm2, 2), scientific(per_load(k)),
          scientific(s.distance_over_height), scientific(s.distance_relative)};
}
const std::vector<std::string> row_columns = {"status", "nodes", "seconds", "q_form", "q_stable", "q_stiff", "score"};
std::vector<std::string> cells(const SolverRow& r) {
  return {r.scenario.status, std::to_string(r.size.nodes), cell(r.seconds, 1), cell(r.scenario.q_form, 4), cell(r.scenario.q_stable, 4), cell(r.scenario.q_stiff, 4), cell(r.score, 4)};
}

std::string subject(const PressRequest& o, const SolverStudy& study) { return theta_text(o) + "; " + scenario_text(study.rows.front().scenario); }

constexpr std::string_view meaning =
    "In equilibrium: the depth at which the quasi-static solver bears the force that was reached, on the same mesh. Distance: root mean square over nodes of "
    "the difference from that equilibrium's displacements, per height of the pad and per root mean square of those displacements. Residual: norm of the out-of-balance "
    "forces, by an independent routine.";

std::string table(const SolverStudy& study) {
  std::string text = "solver,status,load_N,met_force_N,force_N,depth_mm,equilibrium_depth_mm,contact_area_mm2,reference_area_mm2,residual_over_force,distance_over_height,distance_relative,seconds\n";
  for (const SolverRow& r : study.rows)
    for (const SolverState& s : r.states) {
      text += "\"" + r.name + "\"," + r.scenario.status;
      for (const double v : {s.state.load_N, s.met_force_N, s.state.force_N, s.state.depth_mm, s.equilibrium_depth_mm, s.state.contact_area_mm2, s.state.reference_area_mm2, per_load(s.state),
                             s.distance_over_height, s.distance_relative, r.seconds})
        text += "," + (std::isfinite(v) ? Json(v).dump() : "");
      text += "\n";
    }
  return text;
}

LineChart depth_chart(const SolverStudy& study) {
  LineChart chart{"Depth under force", "where the indenter stands, at the force it then feels", "force [N]", "depth since first touch δ [mm]", {}};
  for (std::size_t r = 0; r < study.rows.size(); ++r) {
    Curve curve{study.rows[r].name, std::string(palette[r]), {{0.0, 0.0}}};
    for (const SolverState& s : study.rows[r].states)
      if (std::isfinite(s.state.force_N)) curve.points.push_back({s.state.force_N, s.state.depth_mm});
    chart.curves.push_back(std::move(curve));
  }
  return chart;
}

LineChart distance_chart(const SolverStudy& study) {
  LineChart chart{"Distance to equilibrium", "root mean square over nodes, per height of the pad; on the same mesh, under the same force", "load [N]", "distance [%]", {}};
  for (std::size_t r = 0; r < study.rows.size(); ++r) {
    Curve curve{study.rows[r].name, std::string(palette[r]), {}};
    for (const SolverState& s : study.rows[r].states)
      if (std::isfinite(s.distance_over_height)) curve.points.push_back({s.state.load_N, 100.0 * s.distance_over_height});
    if (!curve.points.empty() && study.rows[r].mechanics.solver == Mechanics::Solver::vbd) chart.curves.push_back(std::move(curve));
  }
  return chart;
}

/// Lines of cells in columns: the first to the left, the others to the right.
std::string aligned(const std::vector<std::vector<std::string>>& lines) {
  std::vector<int> width(lines.front().size(), 0);
  for (const auto& line : lines)
    for (std::size_t k = 0; k < line.size(); ++k) width[k] = std::max(width[k], length(line[k]));
  std::string text;
  for (const auto& line : lines) {
    for (std::size_t k = 0; k < line.size(); ++k) text += k == 0 ? pad(line[k], -width[k]) : "  " + pad(line[k], width[k]);
    text += "\n";
  }
  return text;
}

/// One line of a table; `tag` is td or th.
std::string html_row(const std::vector<std::string>& cells, const std::string& tag) {
  std::string row = "<tr>";
  for (const std::string& c : cells) row += "<" + tag + ">" + c + "</" + tag + ">";
  return row + "</tr>\n";
}

std::vector<std::string> with(std::string first, std::vector<std::string> rest) {
  rest.insert(rest.begin(), std::move(first));
  return rest;
}

}  // namespace

std::string solver_page(const PressRequest& o, const SolverStudy& study) {
  std::string page = R"(<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>lumo study solver</title>
<style>
body { font: 15px/1.45 "DejaVu Sans", Verdana, Helvetica, sans-serif; color: #222; max-width: 64rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.4rem; margin-bottom: 0.2rem; }
h2 { font-size: 1.1rem; margin-top: 2rem; }
p, ul { max-width: 46rem; }
ul { font-size: 0.86rem; padding-left: 1.2rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.86rem; font-variant-numeric: tabular-nums; }
th, td { padding: 0.25rem 0.7rem; text-align: right; border-bottom: 1px solid #e4e4e4; }
td { white-space: nowrap; }
th { border-bottom: 1.5px solid #222; vertical-align: bottom; }
th:first-child, td:first-child { text-align: left; padding-left: 0; }
tr.first td { border-top: 1.5px solid #999; }
svg { max-width: 100%; height: auto; display: block; margin-top: 1.5rem; }
</style>
)";
  page += "<h1>One press, four ways</h1>\n<p>" + subject(o, study) + "</p>\n<h2>Solvers</h2>\n<div class=\"scroll\"><table>\n" + html_row(with("solver", row_columns), "th");
  for (const SolverRow& r : study.rows) page += html_row(with(r.name, cells(r)), "td");
  page += "</table></div>\n<ul>\n";
  for (const SolverRow& r : study.rows) page += "<li>" + r.name + ": " + mechanics_text(r.mechanics) + "</li>\n";
  page += "</ul>\n" + draw(depth_chart(study));
  if (const LineChart chart = distance_chart(study); !chart.curves.empty()) page += draw(chart);
  page += "<h2>States</h2>\n<p>" + std::string(meaning) + "</p>\n<div class=\"scroll\"><table>\n" + html_row(with("solver", state_columns), "th");
  for (const SolverRow& r : study.rows)
    for (std::size_t k = 0; k < r.states.size(); ++k) {
      std::string row = html_row(with(k == 0 ? r.name : "", cells(r.states[k])), "td");
      if (k == 0) row.insert(3, " class=\"first\"");
      page += row;
    }
  return page + "</table></div>\n</html>\n";
}

std::string present(const PressRequest& o, bool as_json, const SolverStudy& study, Output& files) {
  Json j = {{"study", "solver"}};
  append(j, heading(o));
  append(j, {{"diameter_mm", o.diameter_mm}, {"angle_deg", o.angle_deg}, {"y_mm", o.y_mm}, {"pad_height_mm", study.pad_height_mm}, {"rows", Json::array()}});
  for (const SolverRow& r : study.rows) j["rows"].push_back(json(r));
  const std::string whole = j.dump(2) + "\n";
  if (files.wanted()) {
    files.add("study_solver.json", whole);
    files.add("study_solver.csv", table(study));
    files.add("study_solver.html", solver_page(o, study));
  }
  if (as_json) return whole;

  std::vector<std::vector<std::string>> solvers = {with("solver", row_columns)}, states = {with("solver", state_columns)};
  for (const SolverRow& r : study.rows) {
    solvers.push_back(with(r.name, cells(r)));
    for (const SolverState& s : r.states) states.push_back(with(&s == &r.states.front() ? r.name : "", cells(s)));
  }
  return subject(o, study) + "\n\n" + aligned(solvers) + "\n" + aligned(states) + "\n" + std::string(meaning) + "\n";
}

}  // namespace lumo::program
