#include "report/present.hpp"

#include "charts/contact_picture.hpp"
#include "configuration/effective.hpp"
#include "console/text.hpp"
#include "lumo/mesh/vtu.hpp"
#include "report/records.hpp"

#include <locale>
#include <sstream>

namespace lumo::program {

std::string theta_text(const Pad& o) { return "θ = [" + joined(o.theta_mm, ", ") + "] mm, " + o.material(); }

namespace {

std::string sphere_text(double diameter_m, double angle_rad) {
  return "sphere " + short_number(1e3 * diameter_m) + " mm, " + short_number(degrees(angle_rad)) + "°";
}

std::string y_text(double y_m) { return short_number(1e3 * y_m); }

std::string size_text(std::size_t nodes, std::size_t elements) {
  return std::to_string(nodes) + " nodes, " + std::to_string(elements) + " tetrahedra";
}

std::string dump(const Json& j) { return j.dump(2) + "\n"; }

std::string how(const Mechanics& m) { return m == Mechanics{} ? "" : mechanics_text(m) + "\n"; }

std::string state_table(const ScenarioRecord& s) {
  std::string t = "load [N]  force [N]      depth [mm]       contact area [mm²]  residual [N]\n";
  for (const StateRecord& k : reported(s))
    t += cell(k.load_N, 2, 8) + cell(k.force_N, 4, 11) + cell(1e3 * k.depth_m, 4, 9) + " ± " +
         cell(1e3 * k.depth_error_m, 4) + cell(1e6 * k.contact_area_m2, 2, 12) + " ± " +
         cell(1e6 * k.contact_area_error_m2, 2, 5) + "  " + scientific(k.residual_N, 1) + "\n";
  return t + "status: " + std::string(to_string(s.status)) + "\n";
}

/// With the numbers of light, or without.
std::string csv(const std::vector<ScenarioRecord>& scenarios, bool light) {
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out.precision(12);
  out << "diameter_mm,angle_deg,y_mm,status";
  for (const StateQuantity& q : state_quantities) out << "," << q.name;
  std::size_t regions = 0;
  for (const ScenarioRecord& s : scenarios)
    for (const StateRecord& k : s.states) regions = std::max(regions, light ? k.response.size() : 0);
  for (const char* name : {"response", "response_change_err"})
    for (std::size_t b = 1; b <= regions; ++b) out << "," << name << "_" << b;
  out << "\n";
  const auto put = [&out](double v) {
    out << ",";
    if (std::isfinite(v)) out << v;
  };
  for (const ScenarioRecord& s : scenarios)
    for (const StateRecord& k : reported(s)) {
      out << mm(s.diameter_m) << "," << degrees(s.angle_rad) << "," << mm(s.y_m) << "," << to_string(s.status);
      for (const StateQuantity& q : state_quantities) put(q.of(k));
      for (const auto* numbers : {&k.response, &k.change_error})
        for (std::size_t b = 0; b < regions; ++b) put(b < numbers->size() ? (*numbers)[b] : undefined);
      out << "\n";
    }
  return out.str();
}

Points force_depth(const ScenarioRecord& s) {
  Points points = {{0.0, 0.0}};
  for (const StateRecord& k : reported(s))
    if (std::isfinite(k.depth_m) && std::isfinite(k.force_N)) points.push_back({1e3 * k.depth_m, k.force_N});
  return points;
}

LineChart force_depth_chart(const Pad& o, const std::string& subtitle) {
  return {"Force over depth", theta_text(o) + "; " + subtitle, "depth since first touch [mm]", "force [N]", {}};
}

BarChart response_chart(const Pad& o, const std::string& title, const std::string& subtitle, std::size_t regions) {
  BarChart c{title, theta_text(o) + "; " + subtitle, "region along the finger, proximal to distal",
      "change of response per emitted power", {}, {}};
  for (std::size_t b = 1; b <= regions; ++b) c.categories.push_back(std::to_string(b));
  return c;
}

/// The change of a state's light.
BarSeries response_bars(
    const std::string& label, const std::string& colour, const StateRecord& s, const std::vector<double>& unloaded) {
  BarSeries bars{label, colour, {}, s.change_error};
  for (std::size_t i = 0; i < s.response.size() && i < unloaded.size(); ++i)
    bars.values.push_back(s.response[i] - unloaded[i]);
  return bars;
}

/// A contact field with a number on every node: what cannot be touched is as far from contact as the farthest node that
/// can be.
std::vector<double> on_all_nodes(std::vector<double> field) {
  double least = 0.0;
  for (const double v : field)
    if (std::isfinite(v)) least = std::min(least, v);
  for (double& v : field)
    if (!std::isfinite(v)) v = least;
  return field;
}

/// What the sphere does to the pad, point by point of the deformed surface.
std::string traction_csv(const std::vector<MechanicalState>& states) {
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out.precision(12);
  out << "load_N,x_mm,y_mm,z_mm,area_mm2,pressure_kPa,traction_x_kPa,traction_y_kPa,traction_z_kPa\n";
  for (const MechanicalState& s : states)
    for (const TractionPoint& p : s.tractions) {
      const Vec3d at = 1e3 * p.place_m, traction = 1e-3 * p.traction_Pa;
      out << s.load_N << "," << at.x() << "," << at.y() << "," << at.z() << "," << 1e6 * p.area_m2 << ","
          << 1e-3 * p.pressure_Pa << "," << traction.x() << "," << traction.y() << "," << traction.z() << "\n";
    }
  return out.str();
}

/// What a press leaves behind: curve, contact sets, table and states.
void add_press(const Pad& o, const PressResult& press, Output& files) {
  const std::string caption = theta_text(o) + "; " + scenario_text(press.scenario());
  LineChart chart = force_depth_chart(o, scenario_text(press.scenario()));
  chart.curves.push_back({"", palette[0], force_depth(press.scenario())});
  files.add("force_depth.svg", draw(chart));
  files.add("contact.svg", draw_contact("Contact set at each load", caption, press.mesh, press.states));
  files.add("press.csv", csv(press.seen.scenarios, false));
  files.add("traction.csv", traction_csv(press.states));

  std::vector<SeriesEntry> series;
  for (const MechanicalState& s : press.states) {
    std::vector<NodeField> fields;
    const std::size_t n = press.mesh.nodes.size();
    if (s.displacement.size() == n) fields.push_back(node_field("displacement_m", s.displacement));
    if (s.pressure_Pa.size() == n) fields.push_back({"pressure_Pa", 1, s.pressure_Pa});
    if (s.traction_Pa.size() == n) fields.push_back(node_field("traction_Pa", s.traction_Pa));
    if (s.contact_field.size() == n) fields.push_back({"contact_field_m", 1, on_all_nodes(s.contact_field)});
    std::ostringstream vtu;
    write_vtu(vtu, press.mesh, fields);
    series.push_back({s.load_N, "press_" + std::to_string(series.size() + 1) + ".vtu"});
    files.add(series.back().file, vtu.str());
  }
  std::ostringstream pvd;
  write_pvd(pvd, series);
  files.add("press.pvd", pvd.str());
}

std::string ledger_text(const EnergyLedger& ledger) {
  std::string text = "power:", sign = " ";
  for (const PowerShare& s : power_shares(ledger)) {
    text += sign + cell(s.part, 6) + " " + s.words;
    sign = sign == " " ? " = " : " + ";
  }
  return text + "\n";
}

/// Head, scenario and, with light, what was seen of it.
Json press_json(const Configuration& o, const PressResult& p, bool light) {
  Json j = heading(o.pad);
  j["mechanics"] = json(o.mechanics);
  append(j, json(p.scenario()));
  if (light) {
    append(j, unloaded(p.seen));
    j["ledger"] = json(p.seen.ledger);
  }
  j["mesh"] = mesh_size(p.seen.nodes, p.seen.elements);
  j["seconds"] = json(p.seen.seconds);
  j["configuration"] = tree_of(o);
  return j;
}

std::string press_text(const Configuration& o, const PressResult& p) {
  return theta_text(o.pad) + "; " + scenario_text(p.scenario()) + "\n" + how(o.mechanics) + state_table(p.scenario());
}

/// One curve for each scenario, one colour for each diameter, in order of appearance.
LineChart ensemble_curves(const Configuration& o, const std::vector<ScenarioRecord>& scenarios) {
  LineChart chart = force_depth_chart(o.pad, name(o.ensemble) + " ensemble, " + std::to_string(scenarios.size()) +
                                                 " scenarios; one curve per place along the finger");
  std::vector<double> seen;
  for (const ScenarioRecord& s : scenarios) {
    const auto place = std::size_t(std::find(seen.begin(), seen.end(), s.diameter_m) - seen.begin());
    const bool first = place == seen.size();
    if (first) seen.push_back(s.diameter_m);
    chart.curves.push_back({first ? "sphere " + short_number(1e3 * s.diameter_m) + " mm" : "",
        palette[place % palette.size()], force_depth(s), 1.2, false, 0.7});
  }
  return chart;
}

BarChart hardest_pair(const Configuration& o, const Evaluation& e) {
  const ObservedState &a = e.observed[e.worst_observation->first], &b = e.observed[e.worst_observation->second];
  const std::vector<double>& unloaded = e.observations.unloaded_response;
  BarChart chart = response_chart(o.pad, "The two places that are hardest to tell apart",
      sphere_text(a.diameter_m, a.angle_rad) + ", " + short_number(a.load_N) + " N", unloaded.size());
  for (const ObservedState* side : {&a, &b})
    for (const StateRecord& s : e.observations.scenarios[side->scenario].states)
      if (s.load_N == side->load_N)
        chart.series.push_back(
            response_bars("y = " + y_text(side->y_m) + " mm", palette[chart.series.size()], s, unloaded));
  return chart;
}

std::string evaluation_text(const Configuration& o, const Evaluation& e) {
  const Observations& seen = e.observations;
  std::string text = theta_text(o.pad) + ", " + name(o.ensemble) + " ensemble, " +
                     std::to_string(seen.scenarios.size()) + " scenarios\n" + how(o.mechanics) +
                     "J_contact = " + cell(value_of(e.J_contact), 4) + " ± " + cell(error_of(e.J_contact), 4);
  if (e.worst_contact) text += "   worst: " + scenario_text(seen.scenarios[*e.worst_contact]);
  const Observation::By by = o.observation.by;
  text += by == Observation::By::side ? "" : by == Observation::By::camera ? "\nby a camera" : "\nby photodiodes";
  text += "\nJ_obs     = " + scientific(value_of(e.J_obs)) + " ± " + scientific(error_of(e.J_obs));
  if (e.worst_observation) {
    const ObservedState &a = e.observed[e.worst_observation->first], &b = e.observed[e.worst_observation->second];
    text += "   worst: " + sphere_text(a.diameter_m, a.angle_rad) + ", " + short_number(a.load_N) +
            " N, y = " + y_text(a.y_m) + " and " + y_text(b.y_m) + " mm";
  }
  const Timing& s = seen.seconds;
  return text + "\n" + ledger_text(seen.ledger) + size_text(seen.nodes, seen.elements) + "; " + cell(s.mesh, 1) +
         " s mesh, " + cell(s.mechanics, 1) + " s mechanics, " + cell(s.optics, 1) + " s optics, " + cell(s.total, 1) +
         " s in all\n";
}

}  // namespace

std::string scenario_text(const ScenarioRecord& s) {
  return sphere_text(s.diameter_m, s.angle_rad) + ", y = " + y_text(s.y_m) + " mm";
}

std::string present(const Configuration& o, bool as_json, const SectionDrawing& section, Output& files) {
  const std::string svg = draw(section);
  files.add("section.svg", svg);
  if (!as_json) return files.wanted() ? section.title + "\n" + section.subtitle + "\n" : svg;
  Json j = heading(o.pad);
  for (const auto& d : section.dimensions) {
    const Point a = d.start(), b = d.end();
    j["dimensions_mm"][d.label.substr(0, d.label.find(' '))] = number(std::hypot(b[0] - a[0], b[1] - a[1]));
  }
  j["configuration"] = tree_of(o);
  return dump(j);
}

std::string present(const Configuration& o, bool as_json, const MeshResult& m, Output& files) {
  if (files.wanted()) {
    std::ostringstream vtu;
    write_vtu(vtu, m.mesh);
    files.add("mesh.vtu", vtu.str());
  }
  const double volume_mm3 = 1e9 * m.quality.volume_m3, exact_mm3 = 1e9 * m.exact_volume_m3;
  const std::size_t nodes = m.mesh.nodes.size(), elements = m.mesh.tets.size(), faces = m.mesh.faces.size();
  if (!as_json)
    return theta_text(o.pad) + "\n" + size_text(nodes, elements) + ", " + std::to_string(faces) +
           " boundary faces\nvolume " + cell(volume_mm3, 2) + " mm³ (exact " + cell(exact_mm3, 2) +
           " mm³)\nsmallest Jacobian ratio " + cell(m.quality.min_jacobian_ratio, 3) + ", smallest dihedral angle " +
           cell(m.quality.min_dihedral_deg, 1) + "°\n";
  Json j = heading(o.pad);
  append(j, {{"mesh", mesh_size(nodes, elements)}, {"boundary_faces", faces}, {"volume_mm3", number(volume_mm3)},
                {"exact_volume_mm3", number(exact_mm3)}, {"min_jacobian_ratio", number(m.quality.min_jacobian_ratio)},
                {"min_dihedral_deg", number(m.quality.min_dihedral_deg)}, {"seconds", number(m.seconds)},
                {"configuration", tree_of(o)}});
  return dump(j);
}

std::string present(const Configuration& o, bool as_json, const PressResult& p, Output& files) {
  if (files.wanted()) add_press(o.pad, p, files);
  return as_json ? dump(press_json(o, p, false)) : press_text(o, p);
}

std::string present(const Configuration& o, bool as_json, const TraceResult& t, Output& files) {
  const PressResult& p = t.press;
  const std::vector<StateRecord>& states = p.scenario().states;
  const std::vector<double>& unloaded = p.seen.unloaded_response;
  if (files.wanted()) {
    BarChart chart =
        response_chart(o.pad, "Change of light in each region", scenario_text(p.scenario()), unloaded.size());
    for (const StateRecord& s : states)
      chart.series.push_back(response_bars(
          short_number(s.load_N) + " N", shade(int(chart.series.size()), int(states.size())), s, unloaded));
    files.add("response.svg", draw(chart));
    files.add("trace.csv", csv(p.seen.scenarios, true));
    add_press(o.pad, p, files);
  }
  if (as_json) return dump(press_json(o, p, true));
  std::string text = press_text(o, p) + "response per emitted power, regions from proximal to distal\n";
  const auto row = [&text](const std::string& label, const std::vector<double>& r) {
    text += pad(label, -10);
    for (const double v : r) text += cell(v, 6, 10);
    text += "\n";
  };
  row("unloaded", unloaded);
  for (const StateRecord& s : states) row(short_number(s.load_N) + " N", s.response);
  return text + ledger_text(p.seen.ledger);
}

std::string present(const Configuration& o, bool as_json, const Evaluation& e, Output& files) {
  Json j = heading(o.pad);
  j["mechanics"] = json(o.mechanics);
  j["ensemble"] = name(o.ensemble);
  append(j, json(e));
  j["seconds"] = json(e.observations.seconds);
  j["configuration"] = tree_of(o);
  if (files.wanted()) {
    files.add("evaluation.json", dump(j));
    files.add("evaluation.csv", csv(e.observations.scenarios, true));
    files.add("force_depth.svg", draw(ensemble_curves(o, e.observations.scenarios)));
    if (e.worst_observation) files.add("hardest_pair.svg", draw(hardest_pair(o, e)));
  }
  return as_json ? dump(j) : evaluation_text(o, e);
}

}  // namespace lumo::program
