#include "report/present.hpp"

#include "lumo/mesh/vtu.hpp"
#include "drawing/contact_picture.hpp"
#include "report/json.hpp"
#include "console/text.hpp"

#include <iomanip>
#include <sstream>

namespace lumo::program {

std::string theta_text(const Pad& o) {
  return "θ = [" + joined(o.theta_mm, ", ") + "] mm, " + o.material;
}

std::string scenario_text(const ScenarioReport& s) {
  return "sphere " + short_number(s.diameter_mm) + " mm, " + short_number(s.angle_deg) + "°, y = " + short_number(s.y_mm) + " mm";
}

namespace {

std::string dump(const Json& j) { return j.dump(2) + "\n"; }

std::string how(const Mechanics& m) { return m == Mechanics{} ? "" : mechanics_text(m) + "\n"; }

std::string state_table(const ScenarioReport& s) {
  std::string t = "load [N]  force [N]  depth [mm]  contact area [mm²]  residual [N]\n";
  for (const auto& k : s.states) {
    std::ostringstream residual;
    residual << std::scientific << std::setprecision(1) << k.residual_N;
    t += cell(k.load_N, 2, 8) + cell(k.force_N, 4, 11) + cell(k.depth_mm, 4, 12) + cell(k.contact_area_mm2, 2, 20) + "  " +
         (std::isfinite(k.residual_N) ? residual.str() : "-") + "\n";
  }
  return t + "status: " + s.status + "\n";
}

std::string csv(const std::vector<ScenarioReport>& scenarios) {
  std::ostringstream out;
  out.precision(12);
  out << "diameter_mm,angle_deg,y_mm,status,load_N,force_N,depth_mm,contact_area_mm2,reference_area_mm2,residual_N,penetration_mm";
  std::size_t regions = 0;
  for (const auto& s : scenarios)
    for (const auto& k : s.states) regions = std::max(regions, k.response.size());
  for (const char* name : {"response", "response_change_err"})
    for (std::size_t b = 1; b <= regions; ++b) out << "," << name << "_" << b;
  out << "\n";
  const auto put = [&out](double v) {
    out << ",";
    if (std::isfinite(v)) out << v;
  };
  for (const auto& s : scenarios)
    for (const auto& k : s.states) {
      out << s.diameter_mm << "," << s.angle_deg << "," << s.y_mm << "," << s.status;
      for (const double v : {k.load_N, k.force_N, k.depth_mm, k.contact_area_mm2, k.reference_area_mm2, k.residual_N, k.penetration_mm}) put(v);
      for (const auto* numbers : {&k.response, &k.change_error})
        for (std::size_t b = 0; b < regions; ++b) put(b < numbers->size() ? (*numbers)[b] : undefined);
      out << "\n";
    }
  return out.str();
}

std::vector<Point> force_depth(const ScenarioReport& s) {
  std::vector<Point> points = {{0.0, 0.0}};
  for (const auto& k : s.states)
    if (std::isfinite(k.depth_mm) && std::isfinite(k.force_N)) points.push_back({k.depth_mm, k.force_N});
  return points;
}

LineChart force_depth_chart(const Pad& o, const std::string& subtitle) {
  return {"Force over depth", theta_text(o) + (subtitle.empty() ? "" : "; " + subtitle), "depth since first touch [mm]", "force [N]", {}};
}

std::vector<double> difference(const std::vector<double>& a, const std::vector<double>& b) {
  std::vector<double> d(std::min(a.size(), b.size()));
  for (std::size_t i = 0; i < d.size(); ++i) d[i] = a[i] - b[i];
  return d;
}

BarChart response_chart(const Pad& o, const std::string& title, const std::string& subtitle, std::size_t regions) {
  BarChart c{title, theta_text(o) + "; " + subtitle, "region along the finger, proximal to distal", "change of response per emitted power", {}, {}};
  for (std::size_t b = 1; b <= regions; ++b) c.categories.push_back(std::to_string(b));
  return c;
}

/// A contact field with a number on every node: what cannot be touched is as far from contact as the farthest node that can be.
std::vector<double> on_all_nodes(std::vector<double> field) {
  double least = 0.0;
  for (const double v : field)
    if (std::isfinite(v)) least = std::min(least, v);
  for (double& v : field)
    if (!std::isfinite(v)) v = least;
  return field;
}

/// What a press leaves behind: curve, contact sets, table and states.
void add_press(const Pad& o, const PressResult& press, Output& files) {
  LineChart chart = force_depth_chart(o, scenario_text(press.scenario));
  chart.curves.push_back({"", std::string(palette[0]), force_depth(press.scenario)});
  files.add("force_depth.svg", draw(chart));
  files.add("contact.svg", draw_contact("Contact set at each load", theta_text(o) + "; " + scenario_text(press.scenario), press.mesh, press.states));
  files.add("press.csv", csv({press.scenario}));

  std::vector<SeriesEntry> series;
  for (std::size_t k = 0; k < press.states.size(); ++k) {
    const auto& s = press.states[k];
    std::vector<NodeField> fields;
    const std::size_t n = press.mesh.nodes.size();
    if (s.displacement.size() == n) fields.push_back(node_field("displacement_m", s.displacement));
    if (s.pressure_Pa.size() == n) fields.push_back({"pressure_Pa", 1, s.pressure_Pa});
    if (s.contact_field.size() == n) fields.push_back({"contact_field_m", 1, on_all_nodes(s.contact_field)});
    std::ostringstream vtu;
    write_vtu(vtu, press.mesh, fields);
    series.push_back({s.load_N, "press_" + std::to_string(k + 1) + ".vtu"});
    files.add(series.back().file, vtu.str());
  }
  std::ostringstream pvd;
  write_pvd(pvd, series);
  files.add("press.pvd", pvd.str());
}

std::string ledger_text(const Ledger& l) {
  return "power: " + cell(l.emitted, 6) + " emitted = " + cell(l.regions, 6) + " regions + " + cell(l.to_indenter, 6) + " to indenter + " + cell(l.elsewhere, 6) +
         " elsewhere + " + cell(l.absorbed_medium, 6) + " silicone + " + cell(l.absorbed_carrier, 6) + " carrier + " + cell(l.sampling, 6) + " sampling + " + cell(l.lost, 6) + " lost\n";
}

const StateReport* find_state(const EvaluationResult& e, double diameter, double angle, double y, double load) {
  for (const auto& s : e.scenarios)
    if (s.diameter_mm == diameter && s.angle_deg == angle && s.y_mm == y)
      for (const auto& k : s.states)
        if (k.load_N == load) return &k;
  return nullptr;
}

}  // namespace

std::string present(const Pad& o, bool as_json, const SectionDrawing& section, Output& files) {
  const std::string svg = draw(section);
  files.add("section.svg", svg);
  if (as_json) {
    Json j = heading(o);
    for (const auto& d : section.dimensions) {
      const bool x = d.along == SectionDrawing::Dimension::Along::x;
      j["dimensions_mm"][d.label.substr(0, d.label.find(' '))] = number(x ? std::abs(d.to[0] - d.from[0]) : std::abs(d.to[1] - d.from[1]));
    }
    return dump(j);
  }
  return files.wanted() ? section.title + "\n" + section.subtitle + "\n" : svg;
}

std::string present(const Pad& o, bool as_json, const MeshResult& m, Output& files) {
  if (files.wanted()) {
    std::ostringstream vtu;
    write_vtu(vtu, m.mesh);
    files.add("mesh.vtu", vtu.str());
  }
  if (as_json) {
    Json j = heading(o);
    j["mesh"] = json(m.size);
    j["boundary_faces"] = m.boundary_faces;
    j["volume_mm3"] = number(m.volume_mm3);
    j["exact_volume_mm3"] = number(m.exact_volume_mm3);
    j["min_jacobian_ratio"] = number(m.min_jacobian_ratio);
    j["min_dihedral_deg"] = number(m.min_dihedral_deg);
    j["seconds"] = number(m.seconds);
    return dump(j);
  }
  return theta_text(o) + "\n" + std::to_string(m.size.nodes) + " nodes, " + std::to_string(m.size.elements) + " tetrahedra, " + std::to_string(m.boundary_faces) +
         " boundary faces\nvolume " + cell(m.volume_mm3, 2) + " mm³ (exact " + cell(m.exact_volume_mm3, 2) + " mm³)\nsmallest Jacobian ratio " + cell(m.min_jacobian_ratio, 3) +
         ", smallest dihedral angle " + cell(m.min_dihedral_deg, 1) + "°\n";
}

std::string present(const PressRequest& o, bool as_json, const PressResult& p, Output& files) {
  if (files.wanted()) add_press(o, p, files);
  if (as_json) {
    Json j = heading(o);
    j["mechanics"] = json(o.mechanics);
    append(j, json(p.scenario));
    j["mesh"] = json(p.size);
    j["seconds"] = json(p.seconds);
    return dump(j);
  }
  return theta_text(o) + "; " + scenario_text(p.scenario) + "\n" + how(o.mechanics) + state_table(p.scenario);
}

std::string present(const PressRequest& o, bool as_json, const TraceResult& t, Output& files) {
  if (files.wanted()) {
    BarChart chart = response_chart(o, "Change of light in each region", scenario_text(t.scenario), t.unloaded_response.size());
    const auto& states = t.scenario.states;
    for (std::size_t k = 0; k < states.size(); ++k)
      chart.series.push_back({short_number(states[k].load_N) + " N", shade(int(k), int(states.size())), difference(states[k].response, t.unloaded_response), states[k].change_error});
    files.add("response.svg", draw(chart));
    files.add("trace.csv", csv({t.scenario}));
    add_press(o, t.press, files);
  }
  if (as_json) {
    Json j = heading(o);
    j["mechanics"] = json(o.mechanics);
    append(j, json(t.scenario));
    j["unloaded_response"] = numbers(t.unloaded_response);
    j["unloaded_response_err"] = numbers(t.unloaded_error);
    j["ledger"] = json(t.ledger);
    j["mesh"] = json(t.press.size);
    j["seconds"] = json(t.press.seconds);
    return dump(j);
  }
  std::string text = theta_text(o) + "; " + scenario_text(t.scenario) + "\n" + how(o.mechanics) + state_table(t.scenario) + "response per emitted power, regions from proximal to distal\n";
  const auto row = [](const std::string& label, const std::vector<double>& r) {
    std::string line = label + std::string(label.size() < 10 ? 10 - label.size() : 0, ' ');
    for (const double v : r) line += cell(v, 6, 10);
    return line + "\n";
  };
  text += row("unloaded", t.unloaded_response);
  for (const auto& k : t.scenario.states) text += row(short_number(k.load_N) + " N", k.response);
  return text + ledger_text(t.ledger);
}

std::string present(const EvaluationRequest& o, bool as_json, const EvaluationResult& e, Output& files) {
  Json j = heading(o);
  j["mechanics"] = json(o.mechanics);
  j["ensemble"] = name(o.ensemble);
  append(j, json(e));
  j["seconds"] = json(e.seconds);

  if (files.wanted()) {
    files.add("evaluation.json", dump(j));
    files.add("evaluation.csv", csv(e.scenarios));
    LineChart curves = force_depth_chart(o, std::string(name(o.ensemble)) + " ensemble, " + std::to_string(e.scenarios.size()) + " scenarios; one curve per place along the finger");
    std::vector<double> seen;   // one colour per diameter, in order of appearance
    for (const auto& s : e.scenarios) {
      const auto place = std::size_t(std::find(seen.begin(), seen.end(), s.diameter_mm) - seen.begin());
      const bool first = place == seen.size();
      if (first) seen.push_back(s.diameter_mm);
      curves.curves.push_back({first ? "sphere " + short_number(s.diameter_mm) + " mm" : "", std::string(palette[place % palette.size()]), force_depth(s), 1.2, false, 0.7});
    }
    files.add("force_depth.svg", draw(curves));
    if (e.worst_observation) {
      const auto& w = *e.worst_observation;
      BarChart bars = response_chart(o, "The two places that are hardest to tell apart",
                                     "sphere " + short_number(w.diameter_mm) + " mm, " + short_number(w.angle_deg) + "°, " + short_number(w.load_N) + " N",
                                     e.unloaded_response.size());
      for (const double y : {w.y_a_mm, w.y_b_mm})
        if (const StateReport* s = find_state(e, w.diameter_mm, w.angle_deg, y, w.load_N))
          bars.series.push_back({"y = " + short_number(y) + " mm", std::string(palette[bars.series.size()]), difference(s->response, e.unloaded_response), s->change_error});
      files.add("hardest_pair.svg", draw(bars));
    }
  }
  if (as_json) return dump(j);
  std::string text = theta_text(o) + ", " + std::string(name(o.ensemble)) + " ensemble, " + std::to_string(e.scenarios.size()) + " scenarios\n" + how(o.mechanics);
  text += "J_contact = " + cell(e.J_contact, 4) + " ± " + cell(e.J_contact_err, 4);
  if (const auto& w = e.worst_contact) text += "   worst: sphere " + short_number(w->diameter_mm) + " mm, " + short_number(w->angle_deg) + "°, y = " + short_number(w->y_mm) + " mm";
  text += "\nJ_obs     = " + scientific(e.J_obs) + " ± " + scientific(e.J_obs_err);
  if (const auto& w = e.worst_observation)
    text += "   worst: sphere " + short_number(w->diameter_mm) + " mm, " + short_number(w->angle_deg) + "°, " + short_number(w->load_N) + " N, y = " + short_number(w->y_a_mm) + " and " +
            short_number(w->y_b_mm) + " mm";
  text += "\n" + ledger_text(e.ledger) + std::to_string(e.size.nodes) + " nodes, " + std::to_string(e.size.elements) + " tetrahedra; " + cell(e.seconds.mesh, 1) + " s mesh, " +
          cell(e.seconds.mechanics, 1) + " s mechanics, " + cell(e.seconds.optics, 1) + " s optics, " + cell(e.seconds.total, 1) + " s in all\n";
  return text;
}

}  // namespace lumo::program
