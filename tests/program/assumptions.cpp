#include "catch.hpp"

#include "commands/study_readings.hpp"
#include "report/json.hpp"

#include "lumo/study/assumptions.hpp"
#include "temporary_folder.hpp"

#include <filesystem>
#include <set>
#include <sstream>

namespace fs = std::filesystem;

namespace {

using namespace lumo;
using namespace lumo::program;

/// Objectives in closed form; the first departure loses some designs, the second turns the ranking by J_contact
/// round.
Json made_up(const Design& x, int reading) {
  const double contact = 0.3 + 0.01 * x[0] + 0.003 * x[3], light = 1e-6 * (x[1] + 0.1 * x[2]);
  const bool lost = reading == 1 && int(2.0 * x[0]) % 3 == 0;
  Json j = {{"reading", "r"}, {"why", lost ? Json("mesh: none, \"at all\"") : Json(nullptr)}};
  const auto add = [&](const char* key, double value, double error) {
    j[key] = lost ? Json(nullptr) : Json(value);
    j[std::string(key) + "_err"] = lost ? Json(nullptr) : Json(error);
  };
  add("J_contact", reading == 2 ? 1.0 - contact : contact + 0.001 * reading, 0.004);
  add("J_obs", light * (1.0 - 0.02 * reading), 0.1 * light);
  j["worst_contact"] =
      lost ? Json(nullptr)
           : Json{{"diameter_mm", reading == 3 ? 30.0 : 10.0}, {"angle_deg", 0.0}, {"y_mm", 0.0}, {"value", contact}};
  j["worst_observation"] =
      lost ? Json(nullptr)
           : Json{{"diameter_mm", 10.0}, {"angle_deg", 0.0}, {"load_N", 1.0}, {"y_mm", {0.0, 5.5}}, {"value", light}};
  return j;
}

std::string run(const StudyReadings& o, const fs::path& out) {
  Output files(out.string());
  Progress progress(true);
  const std::string text = o.run(files, progress).text;
  files.write();
  return text;
}

}  // namespace

namespace lumo::program {

/// In place of simulations.
Evaluator assumptions_evaluator(const StudyTools&, const std::vector<Scenario<Sphere>>& contacts,
    const std::vector<AssumptionVariant>& variants, Progress&) {
  return [contacts, variants](const Design& x) {
    TrialResult v;
    Json record = {{"theta_mm", numbers(x)}};
    for (int r = 0; r <= int(variants.size()); ++r) record["readings"].push_back(made_up(x, r));
    v.outputs = {record["readings"][0]["J_contact"], record["readings"][0]["J_obs"]};
    v.record = record.dump();
    v.notes = "{}";
    return v;
  };
}

}  // namespace lumo::program

TEST_CASE(
    "a study of assumptions reports each assumption once, the largest change first, and what conclusions depend on") {
  const TemporaryFolder scratch;
  StudyReadings o;
  o.designs = 8;
  o.store = (scratch.path / "readings.db").string();
  const std::string text = run(o, scratch.path / "out");
  CHECK(run(o, scratch.path / "again") == text);  // from the store
  for (const AssumptionVariant& d : assumption_variants()) CHECK(text.find(d.name()) != std::string::npos);
  CHECK(text.find("end faces: held, clear, ranking by J_contact (τ -1.00)") != std::string::npos);
  CHECK_THAT(text, !Catch::Matchers::Contains("ranking by J_obs"));
  CHECK(text.find("carrier albedo: 0.95") < text.find("carrier albedo: 0.5"));  // 36 % before 34 %

  const auto shape = [&](const char* name) {  // lines, and how many fields they have
    std::istringstream table(scratch.read(std::string("out/") + name));
    std::string line;
    std::set<std::size_t> fields;
    std::size_t lines = 0;
    for (; std::getline(table, line); ++lines) {
      bool quoted = false;
      std::size_t commas = 0;
      for (const char c : line) {
        quoted = quoted != (c == '"');
        commas += c == ',' && !quoted;
      }
      fields.insert(commas + 1);
    }
    return std::pair(lines, fields);
  };
  const std::size_t others = assumption_variants().size();
  CHECK(shape("study_readings.csv") == std::pair(others + 1, std::set<std::size_t>{16}));
  CHECK(shape("study_readings_designs.csv") == std::pair(13 * (others + 1) + 1, std::set<std::size_t>{11}));
  CHECK(scratch.read("out/study_readings_designs.csv").find("\"mesh: none, \"\"at all\"\"\"") != std::string::npos);
  for (const char* name : {"study_readings_J_contact.svg", "study_readings_J_obs.svg"}) {
    const std::string picture = scratch.read(std::string("out/") + name);
    CHECK(picture.find("tilt plane: y–z") != std::string::npos);
    CHECK(picture.find("nan") == std::string::npos);
  }
  o.json = true;
  const Json whole = Json::parse(run(o, scratch.path / "json"));
  REQUIRE(whole["designs"].size() == 13);  // five references first
  CHECK(whole["designs"][0]["theta_mm"] == Json({14.5, 4, 5, 12.5, 5}));
  REQUIRE(whole["readings"].size() == assumption_variants().size());
  const Json& narrow = whole["readings"][0];
  CHECK(narrow["compared"].get<int>() + narrow["lost"].get<int>() == 13);
  CHECK(narrow["lost"].get<int>() > 0);
  CHECK(whole["readings"][2]["worst_contact_moved"] == 13);
  CHECK(whole["readings"][3]["delta_J_contact"]["median"].get<double>() == Approx(0.004));
  CHECK(whole["readings"][4]["relative_delta_J_obs"]["median"].get<double>() == Approx(-0.1));
  CHECK(whole["readings"][5]["tau_J_obs"] == 1.0);

  o.designs = 3;  // a store may hold more than are asked for
  CHECK(Json::parse(run(o, scratch.path / "fewer"))["designs"].size() == 8);
  o.effective.type("--material", "silicone.name", "Sol");
  CHECK_THROWS_AS(run(o, scratch.path / "other"), StoreError);
}
