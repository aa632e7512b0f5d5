#include "commands/campaigns.hpp"
#include "console/text.hpp"
#include "store/campaign_store.hpp"

namespace lumo::program {

namespace {

std::string rows_of(const StoredCampaign& c) {
  Json rows = Json::array();
  for (const StoredTrial& t : c.trials) {
    rows.push_back({{"index", t.id}, {"theta_mm", numbers(t.theta_mm)}, {"state", name(t.state)},
        {"why", t.why.empty() ? Json(nullptr) : Json(t.why)}, {"on_front", t.on_front}, {"selected", t.selected},
        {"hypervolume", number(t.hypervolume)}, {"values", c.values()}});
    if (!c.modelled.empty()) append(rows.back(), means_json(t));
    append(rows.back(), {{"record", t.record}, {"notes", t.notes}});
  }
  return text_of(rows, 1) + "\n";
}

std::string table_of(const StoredCampaign& c) {
  std::string text = "index";
  for (const Variable& v : finger_space().variables) text += "," + v.name + "_mm";
  text +=
      ",state,J_contact,J_contact_err,J_obs,J_obs_err,hypervolume,on_front,selected,worst_contact_diameter_mm,worst_"
      "contact_angle_deg,worst_contact_y_mm,"
      "worst_observation_diameter_mm,worst_observation_angle_deg,worst_observation_load_N,worst_observation_y_a_mm,"
      "worst_observation_y_b_mm,nodes,elements,seconds,";
  text += c.modelled.empty() ? "why\n" : "J_contact_mean,J_contact_mean_err,J_obs_mean,J_obs_mean_err,why\n";
  for (const StoredTrial& t : c.trials) {
    const Json r = t.record.is_object() ? t.record : Json::object();
    const auto at = [&](const char* pointer) { return csv_field(r.value(Json::json_pointer(pointer), Json(nullptr))); };
    text += std::to_string(t.id) + "," + joined(t.theta_mm) + "," + name(t.state);
    for (const char* key : {"/J_contact", "/J_contact_err", "/J_obs", "/J_obs_err"}) text += "," + at(key);
    text += "," + csv_field(number(t.hypervolume)) + (t.on_front ? ",1" : ",0") + (t.selected ? ",1" : ",0");
    for (const char* key : {"/worst_contact/diameter_mm", "/worst_contact/angle_deg", "/worst_contact/y_mm",
             "/worst_observation/diameter_mm", "/worst_observation/angle_deg", "/worst_observation/load_N",
             "/worst_observation/y_mm/0", "/worst_observation/y_mm/1", "/mesh/nodes", "/mesh/elements"})
      text += "," + at(key);
    text += "," + csv_field(number(t.seconds()));
    const Json means = c.modelled.empty() ? Json::object() : means_json(t);
    for (const auto& [key, value] : means.items()) text += "," + csv_field(value);
    text += t.why.empty() ? ",\n" : "," + csv_text(t.why) + "\n";
  }
  return text;
}

struct CampaignExport : StoreCommand {
  bool csv = false;

  void declare(CLI::App& app) {
    add_store(app, store);
    add_flag(app, "--json", json, "Everything, as JSON");
    add_flag(app, "--csv", csv, "A table (default)")->excludes("--json");
  }
  Result run(Output&, Progress&) const {
    const StoredCampaign c = read_campaign(store);
    return json ? rows_of(c) : table_of(c);
  }
};

}  // namespace

void add_campaign_export(CommandLine& line) {
  line.add<CampaignExport>("campaign export", "All evaluations, to standard output");
}

}  // namespace lumo::program
