#include "program/campaign.hpp"

#include "program/campaign_store.hpp"
#include "program/text.hpp"

namespace lumo::program {

namespace {

Json summary(const StoredTrial& t) {
  return {{"index", t.id}, {"theta_mm", numbers(t.theta_mm)}, {"J_contact", number(value_at(t.record, "J_contact"))}, {"J_obs", number(value_at(t.record, "J_obs"))}};
}

std::string line(const StoredTrial& t) {
  return pad(std::to_string(t.id), 5) + "  " + pad(joined(t.theta_mm), -22) + pad(cell(value_at(t.record, "J_contact"), 4), 10) + pad(scientific(value_at(t.record, "J_obs")), 12) +
         (t.selected ? "  selected" : "") + "\n";
}

}  // namespace

std::string campaign_status(const Options& o) {
  const StoredCampaign c = read_campaign(SqliteJournal(o.store), o.store);
  double seconds = 0.0;
  for (const StoredTrial& t : c.trials) seconds += std::isfinite(t.seconds()) ? t.seconds() : 0.0;
  const int done = c.count("evaluated"), failed = c.count("failed"), open = c.count("under way");
  if (o.json) {
    Json j = {{"store", o.store},      {"material", c.problem.material}, {"ensemble", name(c.problem.ensemble)}, {"mode", c.problem.paper ? "paper" : "default"}, {"source", c.problem.source},
              {"seed", c.problem.seed}, {"evaluated", done},              {"failed", failed},                      {"under_way", open},
              {"hypervolume", number(c.hypervolume)}, {"seconds", number(seconds)}, {"digest", c.digest}, {"problem_digest", c.problem_digest},
              {"results_version", c.problem.results}, {"results_version_of_lumo", results_version}};
    j["selected"] = c.selected ? summary(c.trials[*c.selected]) : Json(nullptr);
    j["front"] = Json::array();
    for (const StoredTrial& t : c.trials)
      if (t.on_front) j["front"].push_back(summary(t));
    return j.dump(2) + "\n";
  }
  std::string text = lumo::message(o.store, ": ", c.problem.material, ", ", name(c.problem.ensemble), c.problem.paper ? " ensemble, paper mode, source " : " ensemble, source ", c.problem.source, ", seed ", c.problem.seed, "\n", done,
                                        " evaluated, ", failed, " failed, ", open, " under way; ", span(seconds), " in evaluations\nhypervolume ", scientific(c.hypervolume), "\n");
  if (c.problem.results != results_version)
    text += lumo::message("results are of version ", c.problem.results, ", this lumo computes version ", results_version, ": they cannot be compared, nor the campaign continued\n");
  if (done > 0) text += "\nfront\n" + pad("index", 5) + "  " + pad("theta [mm]", -22) + pad("J_contact", 10) + pad("J_obs", 12) + "\n";
  for (const StoredTrial& t : c.trials)
    if (t.on_front) text += line(t);
  if (c.selected && !c.trials[*c.selected].on_front) text += "\n" + line(c.trials[*c.selected]);
  for (const StoredTrial& t : c.trials)
    if (t.state == "failed") text += "failed " + std::to_string(t.id) + ": " + t.why + "\n";
  return text;
}

std::string campaign_verify(const Options& o) {
  const SqliteJournal log(o.store);
  log.verify();
  const StoredCampaign c = read_campaign(log, o.store);
  if (o.json) return Json{{"store", o.store}, {"ok", true}, {"trials", c.trials.size()}, {"digest", c.digest}}.dump(2) + "\n";
  return lumo::message(o.store, ": ok, ", c.trials.size(), " trials, digest ", c.digest, "\n");
}

std::string campaign_export(const Options& o) {
  const StoredCampaign c = read_campaign(SqliteJournal(o.store), o.store);
  if (o.json) {
    Json rows = Json::array();
    for (const StoredTrial& t : c.trials)
      rows.push_back({{"index", t.id}, {"theta_mm", numbers(t.theta_mm)}, {"state", t.state}, {"why", t.why.empty() ? Json(nullptr) : Json(t.why)}, {"on_front", t.on_front},
                      {"selected", t.selected}, {"hypervolume", number(t.hypervolume)}, {"record", t.record}, {"notes", t.notes}});
    return text_of(rows, 1) + "\n";
  }
  std::string text = "index";
  for (const Variable& v : finger_space().variables) text += "," + v.name + "_mm";
  text += ",state,J_contact,J_contact_err,J_obs,J_obs_err,hypervolume,on_front,selected,worst_contact_diameter_mm,worst_contact_angle_deg,worst_contact_y_mm,"
          "worst_observation_diameter_mm,worst_observation_angle_deg,worst_observation_load_N,worst_observation_y_a_mm,worst_observation_y_b_mm,nodes,elements,seconds,why\n";
  for (const StoredTrial& t : c.trials) {
    const Json r = t.record.is_object() ? t.record : Json::object();
    const auto at = [&](const char* pointer) { return csv_field(r.value(Json::json_pointer(pointer), Json(nullptr))); };
    text += std::to_string(t.id) + "," + joined(t.theta_mm) + "," + t.state;
    for (const char* key : {"/J_contact", "/J_contact_err", "/J_obs", "/J_obs_err"}) text += "," + at(key);
    text += "," + csv_field(number(t.hypervolume)) + (t.on_front ? ",1" : ",0") + (t.selected ? ",1" : ",0");
    for (const char* key : {"/worst_contact/diameter_mm", "/worst_contact/angle_deg", "/worst_contact/y_mm", "/worst_observation/diameter_mm", "/worst_observation/angle_deg",
                            "/worst_observation/load_N", "/worst_observation/y_mm/0", "/worst_observation/y_mm/1", "/mesh/nodes", "/mesh/elements"})
      text += "," + at(key);
    text += "," + csv_field(number(t.seconds()));
    text += t.why.empty() ? ",\n" : "," + csv_text(t.why) + "\n";
  }
  return text;
}

}  // namespace lumo::program
