#include "asking/space.hpp"

#include "lumo/core/files.hpp"
#include "lumo/optimize/design_sampler.hpp"
#include "lumo/sense/recording/csv.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <initializer_list>
#include <limits>
#include <set>
#include <utility>
#include <vector>

namespace lumo::program {

namespace {

using Json = nlohmann::ordered_json;

std::string short_form(const Json& value) {
  std::string s = value.dump(-1, ' ', true, Json::error_handler_t::replace);
  return s.size() > 60 ? s.substr(0, 57) + "..." : s;
}

/// Reads values by key and says which key is wrong.
class Reader {
 public:
  explicit Reader(std::string file) : file_(std::move(file)) {}

  [[noreturn]] void refuse(const std::string& key, const std::string& what) const {
    throw InputError("space file '" + file_ + "': " + key + " " + what);
  }

  void keys(const Json& object, const std::string& where, std::initializer_list<const char*> known) const {
    if (!object.is_object())
      refuse(where.empty() ? "the whole" : where, "is " + short_form(object) + ", must be an object {...}");
    for (const auto& [key, value] : object.items()) {
      bool found = false;
      std::string list;
      for (const char* k : known) {
        found = found || key == k;
        list += (list.empty() ? "" : ", ") + std::string(k);
      }
      if (!found)
        refuse((where.empty() ? "" : where + ": ") + "unknown key " + short_form(key) + ",", "must be one of " + list);
    }
  }
  const Json& at(const Json& object, const std::string& where, const char* key) const {
    if (!object.contains(key)) refuse(where + key, "is missing");
    return object[key];
  }
  double number(const Json& value, const std::string& where) const {
    // Sums and products of such numbers are finite.
    if (!value.is_number() || !(std::abs(value.get<double>()) <= 1e150))
      refuse(where, "is " + short_form(value) + ", must be a number within +-1e150");
    return value.get<double>();
  }
  std::int64_t whole(const Json& value, const std::string& where, std::int64_t low, std::int64_t high) const {
    const bool fits =
        value.is_number_unsigned() ? value.get<std::uint64_t>() <= std::uint64_t(high) : value.is_number_integer();
    if (!fits || value.get<std::int64_t>() < low || value.get<std::int64_t>() > high)
      refuse(where, "is " + short_form(value) + lumo::message(", must be a whole number from ", low, " to ", high));
    return value.get<std::int64_t>();
  }
  std::string word(const Json& value, const std::string& where) const {
    if (!value.is_string() || value.get<std::string>().empty())
      refuse(where, "is " + short_form(value) + ", must be a word");
    return value.get<std::string>();
  }
  std::string one_of(const Json& value, const std::string& where, const char* a, const char* b) const {
    if (value != a && value != b) refuse(where, "is " + short_form(value) + ", must be \"" + a + "\" or \"" + b + "\"");
    return value.get<std::string>();
  }
  const Json& list(const Json& value, const std::string& where) const {
    if (!value.is_array()) refuse(where, "is " + short_form(value) + ", must be a list [...]");
    return value;
  }

 private:
  std::string file_;
};

Variable read_variable(const Reader& reader, const Json& j, const std::string& where) {
  reader.keys(j, where, {"name", "lower", "upper", "step"});
  Variable v;
  v.name = reader.word(reader.at(j, where + ".", "name"), where + ".name");
  v.lower = reader.number(reader.at(j, where + ".", "lower"), where + ".lower");
  v.upper = reader.number(reader.at(j, where + ".", "upper"), where + ".upper");
  if (!(v.lower <= v.upper))
    reader.refuse(where, lumo::message("(", v.name, ") has lower ", v.lower, " above upper ", v.upper));
  if (v.lower < v.upper && v.upper - v.lower < 1e-12 * std::max({std::abs(v.lower), std::abs(v.upper), 1e-100}))
    reader.refuse(
        where, lumo::message("(", v.name, ") is ", v.upper - v.lower, " wide, too little to tell numbers apart"));
  if (!j.contains("step")) return v;
  v.step = reader.number(j["step"], where + ".step");
  if (!(v.step > 0.0))
    reader.refuse(
        where + ".step", lumo::message("is ", v.step, ", must be > 0 (leave it out for a continuous variable)"));
  // A lattice is counted from zero where the lower bound lies on it, as 2 does on 0.5, and from the lower bound
  // otherwise.
  const double steps = v.lower / v.step;
  if (std::abs(steps - std::round(steps)) > 1e-9 * std::max(1.0, std::abs(steps))) v.origin = v.lower;
  return v;
}

LinearConstraint read_constraint(
    const Reader& reader, const Json& j, const std::string& where, const std::vector<Variable>& variables) {
  reader.keys(j, where, {"terms", "lower", "upper"});
  LinearConstraint c;
  c.coefficients.assign(variables.size(), 0.0);
  const Json& terms = reader.at(j, where + ".", "terms");
  if (!terms.is_object() || terms.empty())
    reader.refuse(where + ".terms", "is " + short_form(terms) + ", must be an object {\"variable\": coefficient, ...}");
  for (const auto& [name, coefficient] : terms.items()) {
    std::size_t i = 0;
    while (i < variables.size() && variables[i].name != name) ++i;
    if (i == variables.size()) reader.refuse(where + ".terms", "names " + short_form(name) + ", which is no variable");
    c.coefficients[i] = reader.number(coefficient, where + ".terms." + name);
    c.name += (c.name.empty() ? "" : " + ") + short_form(coefficient) + " " + name;
  }
  if (!j.contains("lower") && !j.contains("upper")) reader.refuse(where, "has neither lower nor upper");
  if (j.contains("lower")) c.lower = reader.number(j["lower"], where + ".lower");
  if (j.contains("upper")) c.upper = reader.number(j["upper"], where + ".upper");
  if (c.lower > c.upper) reader.refuse(where, lumo::message("has lower ", c.lower, " above upper ", c.upper));
  return c;
}

std::string numbered(const char* key, std::size_t i) { return lumo::message(key, "[", i, "]"); }

void read_variables(const Reader& reader, const Json& variables, DesignSpace& space) {
  if (variables.empty()) reader.refuse("variables", "is empty, must hold at least 1");
  for (std::size_t i = 0; i < variables.size(); ++i) {
    space.variables.push_back(read_variable(reader, variables[i], numbered("variables", i)));
    for (std::size_t k = 0; k < i; ++k)
      if (space.variables[k].name == space.variables[i].name)
        reader.refuse(numbered("variables", i) + ".name", short_form(space.variables[i].name) + " is there twice");
  }
}

Objective read_objective(const Reader& reader, const Json& j, const std::string& where) {
  reader.keys(j, where, {"name", "goal", "reference"});
  return {reader.word(reader.at(j, where + ".", "name"), where + ".name"),
      reader.one_of(reader.at(j, where + ".", "goal"), where + ".goal", "maximize", "minimize") == "maximize",
      reader.number(reader.at(j, where + ".", "reference"), where + ".reference")};
}

std::vector<double> read_numbers(
    const Reader& reader, const Json& j, const std::string& where, std::size_t wanted, const char* each) {
  if (reader.list(j, where).size() != wanted)
    reader.refuse(where, lumo::message("has ", j.size(), " values, must have ", wanted, ", one for each ", each));
  std::vector<double> values;
  for (std::size_t k = 0; k < j.size(); ++k) values.push_back(reader.number(j[k], numbered(where.c_str(), k)));
  return values;
}

/// An initial design: one that is named may lie off the lattice or outside the bounds, but constraints hold.
Design read_design(const Reader& reader, const Json& j, const std::string& where, const DesignSpace& space) {
  Design x = read_numbers(reader, j, where, space.variables.size(), "variable");
  try {
    space.check_result(x);
    space.unbounded().check(x);
  } catch (const InfeasibleDesign& e) {
    reader.refuse(where, std::string("is an ") + e.what());
  } catch (const InvalidArgument& e) {
    reader.refuse(where, std::string("is a ") + e.what());
  }
  return x;
}

/// [x, y] or [x, y, y_err].
KnownResult read_known(const Reader& reader, const Json& j, const std::string& where, const Problem& p) {
  if (reader.list(j, where).size() < 2 || j.size() > 3)
    reader.refuse(where, lumo::message("has ", j.size(), " entries, must be [x, y] or [x, y, y_err]"));
  KnownResult known{read_numbers(reader, j[0], where + "[0]", p.space.variables.size(), "variable"),
      read_numbers(reader, j[1], where + "[1]", p.objectives.size(), "objective"), {}};
  if (j.size() == 3) known.errors = read_numbers(reader, j[2], where + "[2]", p.objectives.size(), "objective");
  for (const double e : known.errors)
    if (e < 0.0) reader.refuse(where + "[2]", lumo::message("holds a standard error of ", e, ", must be >= 0"));
  try {
    p.space.check_result(known.x);
  } catch (const InvalidArgument& e) {
    reader.refuse(where, std::string("is of a ") + e.what());
  }
  return known;
}

Noise read_noise(const Reader& reader, const Json& value) {
  for (const auto& [name, noise] :
      {std::pair{"estimated", Noise::estimated}, std::pair{"none", Noise::none}, std::pair{"present", Noise::present}})
    if (value == name) return noise;
  reader.refuse("noise", "is " + short_form(value) + ", must be \"estimated\", \"none\" or \"present\"");
}

Json parse_file(const std::string& path) {
  const std::string text = read_text(path);
  try {
    return parse_strictly(text);
  } catch (const InvalidArgument& e) {
    throw InputError("space file '" + path + "' " + e.what());
  }
}

}  // namespace

Json parse_strictly(std::string_view text) {
  constexpr int deepest = 32;
  std::vector<std::set<std::string>> open;
  const auto watch = [&](int depth, Json::parse_event_t event, Json& value) {
    using Event = Json::parse_event_t;
    if (depth > deepest) throw InvalidArgument(lumo::message("nests values more than ", deepest, " deep"));
    if (event == Event::object_start) open.emplace_back();
    if (event == Event::object_end) open.pop_back();
    if (event == Event::key && !open.back().insert(value.get<std::string>()).second)
      throw InvalidArgument("has the key " + short_form(value) + " twice");
    return true;
  };
  if (text.starts_with("\xEF\xBB\xBF")) throw InvalidArgument("begins with a byte order mark, which JSON has not");
  try {
    return Json::parse(text, watch);
  } catch (const nlohmann::json::parse_error& e) {
    throw InvalidArgument(
        lumo::message("is not JSON (nor are NaN and Infinity): something is wrong near byte ", e.byte));
  } catch (const nlohmann::json::exception&) {
    throw InvalidArgument("holds a number that is not finite");
  }
}

std::vector<KnownResult> read_known_table(const std::string& path, const Problem& p) {
  std::ifstream in(path);
  if (!in) throw InputError("'" + path + "' cannot be opened");
  sense::CsvReader table(in, path);
  std::vector<int> x, y, errors;
  for (const Variable& v : p.space.variables) {
    const int with_unit = v.unit.empty() ? -1 : table.find(v.name + "_" + v.unit);
    x.push_back(with_unit >= 0 ? with_unit : table.require(v.name));
  }
  for (const Objective& o : p.objectives) y.push_back(table.require(o.name));
  for (const Objective& o : p.objectives)
    if (const int column = table.find(o.name + "_err"); column >= 0) errors.push_back(column);
  if (!errors.empty() && errors.size() != p.objectives.size())
    throw InputError("'" + path + "': has a column of standard errors for some objectives, must have one for each");
  const auto values = [&](const std::vector<int>& columns) {
    Json list = Json::array();
    for (const int c : columns) list.push_back(table.number(c));
    return list;
  };
  const Reader reader(path);
  const int state = table.find("state");
  std::vector<KnownResult> known;
  while (table.next()) {
    if (state >= 0 && table.text(state) != "evaluated") continue;
    Json row = {values(x), values(y)};
    if (!errors.empty()) row.push_back(values(errors));
    known.push_back(read_known(reader, row, lumo::message("line ", table.line()), p));
  }
  return known;
}

namespace {

void add_known_table(SpaceFile& space, const std::string& path) {
  Json& all = space.whole["known"];
  if (all.is_null()) all = Json::array();
  for (KnownResult& k : read_known_table(path, space.problem)) {
    Json row = {k.x, k.outputs};
    if (!k.errors.empty()) row.push_back(k.errors);
    all.push_back(std::move(row));
    space.problem.known.push_back(std::move(k));
  }
}

}  // namespace

SpaceFile read_space(const std::string& path, const std::string& known_table) {
  const Json j = parse_file(path);
  const Reader reader(path);
  reader.keys(j, "",
      {"variables", "constraints", "objectives", "initial", "known", "noise", "repeats", "sobol", "evaluations",
          "failures", "seed", "source"});
  SpaceFile space;
  Problem& p = space.problem;

  const Json none = Json::array();
  const Json& variables = reader.list(reader.at(j, "", "variables"), "variables");
  const Json& constraints = j.contains("constraints") ? reader.list(j["constraints"], "constraints") : none;
  const Json& objectives = reader.list(reader.at(j, "", "objectives"), "objectives");
  const Json& initial = j.contains("initial") ? reader.list(j["initial"], "initial") : none;
  if (objectives.empty()) reader.refuse("objectives", "is empty, must hold at least 1");
  read_variables(reader, variables, p.space);
  for (std::size_t i = 0; i < constraints.size(); ++i)
    p.space.constraints.push_back(
        read_constraint(reader, constraints[i], numbered("constraints", i), p.space.variables));
  for (std::size_t i = 0; i < objectives.size(); ++i)
    p.objectives.push_back(read_objective(reader, objectives[i], numbered("objectives", i)));
  for (std::size_t i = 0; i < initial.size(); ++i)
    p.initial.push_back(read_design(reader, initial[i], numbered("initial", i), p.space));
  p.initial_anywhere = true;
  const Json& known = j.contains("known") ? reader.list(j["known"], "known") : none;
  for (std::size_t i = 0; i < known.size(); ++i)
    p.known.push_back(read_known(reader, known[i], numbered("known", i), p));
  if (j.contains("noise")) p.noise = read_noise(reader, j["noise"]);
  if (j.contains("repeats")) p.repeats = int(reader.whole(j["repeats"], "repeats", 1, 1000));
  if (j.contains("sobol")) p.sobol = int(reader.whole(j["sobol"], "sobol", 0, 100000));
  p.evaluations = int(reader.whole(reader.at(j, "", "evaluations"), "evaluations", 1, 100000));
  if (j.contains("failures")) {
    space.failures = reader.number(j["failures"], "failures");
    if (!(space.failures >= 0.0 && space.failures <= 1.0))
      reader.refuse("failures", lumo::message("is ", space.failures, ", must be a share of the evaluations, 0 to 1"));
  }
  if (j.contains("seed"))
    p.seed = std::uint64_t(reader.whole(j["seed"], "seed", 0, std::numeric_limits<std::int64_t>::max()));
  space.source = j.contains("source") ? reader.one_of(j["source"], "source", "paper", "default") : "default";

  try {
    p.validate();
    const DesignSampler sampler(p.space);
    if (sampler.fresh(1, 0, {}).empty())
      reader.refuse("the whole",
          sampler.feasible_count() ? "has no feasible design" : "has no feasible design that can be found");
  } catch (const InvalidArgument& e) {
    throw InputError("space file '" + path + "': " + e.what());
  }
  space.whole = {{"variables", variables}, {"constraints", constraints}, {"objectives", objectives},
      {"initial", initial}, {"sobol", p.sobol}, {"evaluations", p.evaluations}, {"seed", p.seed},
      {"source", space.source}};
  if (j.contains("failures")) space.whole["failures"] = space.failures;
  for (const char* key : {"known", "noise", "repeats"})
    if (j.contains(key)) space.whole[key] = j[key];
  if (!known_table.empty()) add_known_table(space, known_table);
  return space;
}

Json fixed_part(const Json& space) {
  Json fixed = space;
  for (const char* key : {"known", "noise", "repeats", "sobol", "evaluations", "failures", "seed", "source"})
    fixed.erase(key);
  for (Json& objective : fixed["objectives"]) {
    objective.erase("name");
    objective.erase("reference");
  }
  for (std::size_t i = 0; i < fixed["variables"].size(); ++i) {
    const Json name = fixed["variables"][i]["name"];
    fixed["variables"][i].erase("name");
    for (Json& constraint : fixed["constraints"])
      if (Json& terms = constraint["terms"]; terms.contains(name)) {
        terms[lumo::message("variables[", i, "]")] = terms[name];
        terms.erase(name.get<std::string>());
      }
  }
  return fixed;
}

std::string difference(const Json& now, const Json& before, const std::string& key) {
  if (now == before) return "";
  if (now.is_object() && before.is_object()) {
    for (const auto& [name, value] : now.items()) {
      const std::string inner = key.empty() ? name : key + "." + name;
      if (!before.contains(name)) return inner + " is " + short_form(value) + ", was absent";
      if (const std::string found = difference(value, before[name], inner); !found.empty()) return found;
    }
    for (const auto& [name, value] : before.items())
      if (!now.contains(name)) return (key.empty() ? name : key + "." + name) + " is absent, was " + short_form(value);
    return "";  // the same keys in another order
  }
  if (now.is_array() && before.is_array()) {
    for (std::size_t i = 0; i < std::min(now.size(), before.size()); ++i)
      if (const std::string found = difference(now[i], before[i], lumo::message(key, "[", i, "]")); !found.empty())
        return found;
    if (now.size() != before.size()) return lumo::message(key, " has ", now.size(), " entries, had ", before.size());
    return "";
  }
  return key + " is " + short_form(now) + ", was " + short_form(before);
}

}  // namespace lumo::program
