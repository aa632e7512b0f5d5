#include "commands/commands.hpp"
#include "computing/press.hpp"
#include "console/text.hpp"
#include "console/version.hpp"
#include "report/chart_library.hpp"
#include "report/report_model.hpp"
#include "report/report_page.hpp"
#include "report/report_press.hpp"
#include "store/open_store.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>
#include <system_error>

namespace lumo::program {

namespace {

constexpr std::array<double, 2> pressed_diameters_mm = {10.0, 30.0};

std::string typed(const std::vector<std::string>& stores, const std::string& page) {
  std::string line = "lumo campaign report";
  for (const std::string& store : stores) line += " --store " + shell_word(shown_store(store));
  return line + " --out " + shell_word(page);
}

/// Presses the selected pads, each once, at y = 0 along z; what goes wrong is said in the page.
void add_presses(Json& campaigns, const std::vector<Configuration>& asked, int threads, Progress& progress) {
  std::vector<Configuration> requests;
  std::vector<std::pair<std::size_t, std::size_t>> wanted;  // campaign, request
  for (std::size_t c = 0; c < campaigns.size(); ++c) {
    if (campaigns[c]["design"].is_null()) continue;
    for (const double diameter_mm : pressed_diameters_mm) {
      Configuration request = asked[c];
      request.pad.theta_mm = campaigns[c]["design"]["theta_mm"].get<std::array<double, 5>>();
      request.ensemble = {};
      request.touch.diameter_mm = diameter_mm;
      const auto found = std::find(requests.begin(), requests.end(), request);
      wanted.emplace_back(c, std::size_t(found - requests.begin()));
      if (found == requests.end()) requests.push_back(request);
    }
  }
  if (requests.empty()) return;
  std::vector<PressOutcome> outcomes(requests.size());
  try {
    outcomes = make_presses(requests, threads, progress);
  } catch (const Error& e) {
    for (PressOutcome& outcome : outcomes) outcome.why = e.what();
  }
  for (const auto& [c, k] : wanted) campaigns[c]["design"]["presses"].push_back(press_model(requests[k], outcomes[k]));
}

/// One HTML page about one or more stores.
struct CampaignReport : Common {
  std::vector<std::string> stores;
  std::string page = "report.html";
  int threads = all_threads();

  void declare(CLI::App& app) {
    add_texts(app, "--store", stores, "STORE", "File or database that keeps a campaign; several make one figure")
        ->required();
    add_common(app, *this);
    add_text(app, "--out", page, "FILE", "The page, default report.html");
    add_threads(app, threads);
  }

  Result run(Output&, Progress& progress) const {
    namespace fs = std::filesystem;
    const fs::path path = page;
    if (std::error_code unknown; !path.has_filename() || fs::is_directory(path, unknown))
      throw InputError("cannot write to '" + path.string() + "': it names a directory, not a file");
    Output files(path.has_parent_path() ? path.parent_path().string() : ".");
    const std::string charts = chart_library();
    std::string title = "lumo campaign";
    const Json data = data_of(path.string(), title, progress);
    std::string html = report_page(title, data, charts);
    const std::size_t size = html.size();
    files.add(path.filename().string(), std::move(html));
    files.write();
    progress.finish();
    if (json) return Json{{"page", path.string()}, {"bytes", size}}.dump(2) + "\n";
    return lumo::message(path.string(), ": ", cell(1e-6 * double(size), 1), " MB\n");
  }

  /// What the page shows; `title` goes on with the campaigns' names.
  Json data_of(const std::string& path, std::string& title, Progress& progress) const {
    Json campaigns = Json::array(), variables = Json::array();
    std::vector<Configuration> asked;
    for (const std::string& store : stores) {
      const StoredCampaign campaign = read_campaign(store);
      title += (campaigns.empty() ? ": " : "; ") + campaign_name(campaign.problem);
      campaigns.push_back(campaign_model(campaign, shown_store(store)));
      asked.push_back(campaign.problem.asked);
    }
    add_presses(campaigns, asked, threads, progress);
    const PadDimensions& pad = asked.front().pad.finger.pad;
    for (const Variable& v : finger_space(pad).variables)
      variables.push_back({{"name", v.name}, {"unit", v.unit}, {"lower", v.lower}, {"upper", v.upper}});
    return {{"lumo", version}, {"results_version", results_version}, {"plotly", chart_library_version()},
        {"command", typed(stores, path)}, {"variables", variables},
        {"pad", {{"width_mm", pad.width}, {"length_mm", pad.length}}}, {"campaigns", campaigns}};
  }
};

}  // namespace

void add_campaign_report(CommandLine& line) {
  line.add<CampaignReport>("campaign report", "One HTML page with charts and the chosen pad in 3-D");
}

}  // namespace lumo::program
