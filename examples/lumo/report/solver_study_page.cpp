#include "computing/solver_study.hpp"

#include "charts/chart.hpp"
#include "configuration/effective.hpp"
#include "console/text.hpp"
#include "page/page.hpp"
#include "report/json.hpp"
#include "report/present.hpp"
#include "report/records.hpp"

#include <algorithm>
#include <utility>

namespace lumo::program {

namespace {

double per_load(const StateRecord& s) { return s.residual_N / s.force_N; }

Json json(const StateRecord& record, const SolverState& s) {
  Json j = program::json(record);
  j.erase("response");
  append(j, {{"met_force_N", number(s.met_force_N)}, {"residual_over_force", number(per_load(record))},
                {"equilibrium_depth_mm", number(s.equilibrium_depth_mm)},
                {"distance_over_height", number(s.distance_over_height)},
                {"distance_relative", number(s.distance_relative)}});
  return j;
}

double score(const SolverRow& r) { return value_of(r.scenario.terms.score()); }

Json json(const SolverRow& r) {
  Json j = {{"name", r.name}, {"mechanics", program::json(r.mechanics)}, {"mesh", mesh_size(r.nodes, r.elements)},
      {"status", to_string(r.scenario.status)}};
  append(j, program::json(r.scenario.terms));
  append(j, {{"score", number(score(r))}, {"seconds", number(r.seconds)}, {"states", Json::array()}});
  const std::vector<StateRecord> records = reported(r.scenario);
  for (std::size_t k = 0; k < records.size(); ++k) j["states"].push_back(json(records[k], r.states[k]));
  return j;
}

/// Columns of the states, as all tables show them.
const std::vector<std::string> state_columns = {"solver", "load [N]", "force [N]", "depth [mm]", "in equilibrium [mm]",
    "area [mm²]", "residual / force", "distance / height", "distance"};
/// One line for each state of a row, its first with the row's name.
std::vector<std::vector<std::string>> state_lines(const SolverRow& r) {
  std::vector<std::vector<std::string>> lines;
  for (const StateRecord& k : reported(r.scenario)) {
    const SolverState& s = r.states[lines.size()];
    lines.push_back({lines.empty() ? r.name : "", short_number(k.load_N), cell(k.force_N, 3), cell(1e3 * k.depth_m, 4),
        cell(s.equilibrium_depth_mm, 4), cell(1e6 * k.contact_area_m2, 2), scientific(per_load(k)),
        scientific(s.distance_over_height), scientific(s.distance_relative)});
  }
  return lines;
}
const std::vector<std::string> row_columns = {
    "solver", "status", "nodes", "seconds", "q_form", "q_stable", "q_stiff", "score"};
std::vector<std::string> cells(const SolverRow& r) {
  const ContactTerms& q = r.scenario.terms;
  return {r.name, std::string(to_string(r.scenario.status)), std::to_string(r.nodes), cell(r.seconds, 1),
      cell(value_of(q.form), 4), cell(value_of(q.stable), 4), cell(value_of(q.stiff), 4), cell(score(r), 4)};
}

std::string subject(const Configuration& o, const SolverStudy& study) {
  return theta_text(o.pad) + "; " + scenario_text(study.rows.front().scenario);
}

constexpr std::string_view meaning =
    "In equilibrium: the depth at which the quasi-static solver bears the force that was reached, on the same mesh. "
    "Distance: root mean square over nodes of "
    "the difference from that equilibrium's displacements, per height of the pad and per root mean square of those "
    "displacements. Residual: norm of the out-of-balance "
    "forces, by an independent routine.";

std::string table(const SolverStudy& study) {
  const std::vector<std::string> columns = {"load_N", "met_force_N", "force_N", "depth_mm", "equilibrium_depth_mm",
      "contact_area_mm2", "reference_area_mm2", "residual_over_force", "distance_over_height", "distance_relative"};
  std::string text = "solver,status";
  for (const std::string& c : columns) text += "," + c;
  text += ",seconds\n";
  for (const SolverRow& r : study.rows) {
    const Json row = json(r);
    for (const Json& state : row["states"]) {
      text += "\"" + r.name + "\"," + std::string(to_string(r.scenario.status));
      for (const std::string& c : columns) text += "," + csv_field(state[c]);
      text += "," + csv_field(row["seconds"]) + "\n";
    }
  }
  return text;
}

LineChart depth_chart(const SolverStudy& study) {
  LineChart chart{"Depth under force", "where the indenter stands, at the force it then feels", "force [N]",
      "depth since first touch δ [mm]", {}};
  for (std::size_t r = 0; r < study.rows.size(); ++r) {
    Curve curve{study.rows[r].name, palette[r], {{0.0, 0.0}}};
    for (const StateRecord& s : reported(study.rows[r].scenario))
      if (std::isfinite(s.force_N)) curve.points.push_back({s.force_N, 1e3 * s.depth_m});
    chart.curves.push_back(std::move(curve));
  }
  return chart;
}

LineChart distance_chart(const SolverStudy& study) {
  LineChart chart{"Distance to equilibrium",
      "root mean square over nodes, per height of the pad; on the same mesh, under the same force", "load [N]",
      "distance [%]", {}};
  for (std::size_t r = 0; r < study.rows.size(); ++r) {
    const SolverRow& row = study.rows[r];
    Curve curve{row.name, palette[r], {}};
    for (std::size_t k = 0; k < row.states.size(); ++k)
      if (const double d = row.states[k].distance_over_height; std::isfinite(d))
        curve.points.push_back({row.scenario.states[k].load_N, 100.0 * d});
    if (!curve.points.empty() && row.mechanics.solver == Mechanics::Solver::vbd)
      chart.curves.push_back(std::move(curve));
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
    for (std::size_t k = 0; k < line.size(); ++k)
      text += k == 0 ? pad(line[k], -width[k]) : "  " + pad(line[k], width[k]);
    text += "\n";
  }
  return text;
}

/// One line of a table; `tag` is td or th.
std::string html_row(const std::vector<std::string>& cells, const std::string& tag) {
  std::string row = "<tr>";
  const std::string scope = tag == "th" ? " scope=\"col\"" : "";
  for (const std::string& c : cells) row += "<" + tag + scope + ">" + c + "</" + tag + ">";
  return row + "</tr>\n";
}

/// A chart with its name for whoever does not see it.
std::string html_figure(const std::string& name, const LineChart& chart) {
  return "<figure role=\"img\" aria-label=\"Chart: " + name + "; its numbers are in the table of states\">\n" +
         draw(chart) + "</figure>\n";
}

}  // namespace

std::string solver_page(const Configuration& o, const SolverStudy& study) {
  std::string page = page::solver_study;
  page += "<h1>One press, four ways</h1>\n<p>" + subject(o, study) +
          "</p>\n<h2>Solvers</h2>\n<div class=\"scroll\"><table>\n" + html_row(row_columns, "th");
  for (const SolverRow& r : study.rows) page += html_row(cells(r), "td");
  page += "</table></div>\n<ul>\n";
  for (const SolverRow& r : study.rows) page += "<li>" + r.name + ": " + mechanics_text(r.mechanics) + "</li>\n";
  page += "</ul>\n" + html_figure("depth over load", depth_chart(study));
  if (const LineChart chart = distance_chart(study); !chart.curves.empty())
    page += html_figure("distance to equilibrium over load", chart);
  page += "<h2>States</h2>\n<p>" + std::string(meaning) + "</p>\n<div class=\"scroll\"><table>\n" +
          html_row(state_columns, "th");
  for (const SolverRow& r : study.rows)
    for (const auto& line : state_lines(r)) {
      std::string row = html_row(line, "td");
      if (!line.front().empty()) row.insert(3, " class=\"first\"");
      page += row;
    }
  return page + "</table></div>\n</html>\n";
}

std::string present(const Configuration& o, bool as_json, const SolverStudy& study, Output& files) {
  Json j = {{"study", "solver"}};
  append(j, heading(o.pad));
  append(j, {{"diameter_mm", o.touch.diameter_mm}, {"angle_deg", o.touch.angle_deg}, {"y_mm", o.touch.y_mm},
                {"pad_height_mm", study.pad_height_mm}, {"rows", Json::array()}});
  for (const SolverRow& r : study.rows) j["rows"].push_back(json(r));
  j["configuration"] = tree_of(o);
  const std::string whole = j.dump(2) + "\n";
  if (files.wanted()) {
    files.add("study_solver.json", whole);
    files.add("study_solver.csv", table(study));
    files.add("study_solver.html", solver_page(o, study));
  }
  if (as_json) return whole;

  std::vector<std::vector<std::string>> solvers = {row_columns}, states = {state_columns};
  for (const SolverRow& r : study.rows) {
    solvers.push_back(cells(r));
    for (auto& line : state_lines(r)) states.push_back(std::move(line));
  }
  return subject(o, study) + "\n\n" + aligned(solvers) + "\n" + aligned(states) + "\n" + std::string(meaning) + "\n";
}

}  // namespace lumo::program
