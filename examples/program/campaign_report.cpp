#include "program/campaign.hpp"

#include "program/chart_library.hpp"
#include "program/commands.hpp"
#include "program/output.hpp"
#include "program/report_model.hpp"
#include "program/report_page.hpp"
#include "program/report_press.hpp"
#include "program/text.hpp"
#include "program/version.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>
#include <system_error>

namespace lumo::program {

namespace {

constexpr std::array<double, 2> pressed_diameters_mm = {10.0, 30.0};

/// As a shell takes it for one word.
std::string word(const std::string& s) {
  const auto plain = [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 ||
           std::string_view("/._-+=:,@%").find(c) != std::string_view::npos;
  };
  if (!s.empty() && std::all_of(s.begin(), s.end(), plain)) return s;
  std::string quoted = "'";
  for (const char c : s) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

std::string command_line(const Options& o, const std::string& page) {
  std::string line = "lumo campaign report";
  for (const std::string& store : o.stores) line += " --store " + word(store);
  return line + " --out " + word(page);
}

/// Presses the selected pads, each once, at y = 0 along z; what goes wrong is said in the page.
void add_presses(Json& campaigns, const Options& o, Progress& progress) {
  std::vector<Options> requests;
  const auto same = [](const Options& a, const Options& b) {
    return a.theta_mm == b.theta_mm && a.material == b.material && a.diameter_mm == b.diameter_mm &&
           a.mechanics.paper == b.mechanics.paper;
  };
  std::vector<std::pair<std::size_t, std::size_t>> wanted;  // campaign, request
  for (std::size_t c = 0; c < campaigns.size(); ++c) {
    if (campaigns[c]["design"].is_null()) continue;
    for (const double diameter_mm : pressed_diameters_mm) {
      Options request;
      request.theta_mm = campaigns[c]["design"]["theta_mm"].get<std::array<double, 5>>();
      request.material = campaigns[c]["material"].get<std::string>();
      request.diameter_mm = diameter_mm;
      if (campaigns[c]["mechanics"]["mode"] == "paper") request.mechanics = paper_mechanics();
      const auto found =
          std::find_if(requests.begin(), requests.end(), [&](const Options& r) { return same(r, request); });
      wanted.emplace_back(c, std::size_t(found - requests.begin()));
      if (found == requests.end()) requests.push_back(request);
    }
  }
  if (requests.empty()) return;
  std::vector<PressOutcome> outcomes(requests.size());
  try {
    outcomes = make_presses(requests, o.threads, progress);
  } catch (const Error& e) {  // this build lacks the simulations
    for (PressOutcome& outcome : outcomes) outcome.why = e.what();
  }
  for (const auto& [c, k] : wanted) campaigns[c]["design"]["presses"].push_back(press_model(requests[k], outcomes[k]));
}

}  // namespace

std::string campaign_report(const Options& o, Progress& progress) {
  namespace fs = std::filesystem;
  const fs::path path = o.page;
  if (std::error_code unknown; !path.has_filename() || fs::is_directory(path, unknown))
    throw InputError("cannot write to '" + path.string() + "': it names a directory, not a file");
  Output files(path.has_parent_path() ? path.parent_path().string() : ".");
  const std::string charts = chart_library();

  Json campaigns = Json::array();
  std::string title = "lumo campaign";
  for (const std::string& store : o.stores) {
    const StoredCampaign campaign = read_campaign(SqliteJournal(store), store);
    title += (campaigns.empty() ? ": " : "; ") + campaign_name(campaign.problem);
    campaigns.push_back(campaign_model(campaign, store));
  }
  add_presses(campaigns, o, progress);

  Json variables = Json::array();
  for (const Variable& v : finger_space().variables)
    variables.push_back({{"name", v.name}, {"unit", v.unit}, {"lower", v.lower}, {"upper", v.upper}});
  const PadDimensions pad;
  const Json data = {{"lumo", version},
                     {"results_version", results_version},
                     {"plotly", chart_library_version()},
                     {"command", command_line(o, path.string())},
                     {"variables", variables},
                     {"pad", {{"width_mm", pad.width}, {"length_mm", pad.length}}},
                     {"campaigns", campaigns}};
  std::string page = report_page(title, data, charts);
  const std::size_t size = page.size();
  files.add(path.filename().string(), std::move(page));
  files.write();
  progress.finish();
  if (o.json) return Json{{"page", path.string()}, {"bytes", size}}.dump(2) + "\n";
  return lumo::message(path.string(), ": ", cell(1e-6 * double(size), 1), " MB\n");
}

}  // namespace lumo::program
