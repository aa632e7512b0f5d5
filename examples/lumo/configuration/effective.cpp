#include "configuration/effective.hpp"

#include "options/options.hpp"

#include "lumo/core/files.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/study/assumptions.hpp"

#include <algorithm>
#include <set>
#include <utility>

namespace lumo::program {

namespace {

/// The end of a message about a value, whose fields are shown so.
std::string said(const Misfit& e, const std::vector<std::string>& fields) {
  std::string why = e.detail;
  if (e.field >= 0)
    why = lumo::message("field ", e.field + 1, " of ", fields.size(), ", ", fields[std::size_t(e.field)], ", ", why);
  return (why.empty() ? "" : " (" + why + ")") + ", must " + e.wanted;
}

/// Where a path leads in a tree; null: nowhere.
const Json* find(const Json& tree, const std::string& path) {
  const Json* at = &tree;
  for (const std::string_view key : split(path, '.')) {
    if (!at->is_object()) return nullptr;
    const auto it = at->find(std::string(key));
    if (it == at->end()) return nullptr;
    at = &*it;
  }
  return at;
}

void plant(Json& tree, const std::string& path, Json value) {
  const auto fields = split(path, '.');
  Json* at = &tree;
  for (const std::string_view key : fields) at = &(*at)[std::string(key)];
  *at = std::move(value);
}

/// Refuses keys that are no settings.
void check_keys(const Json& object, const std::string& above) {
  std::vector<std::string> known;
  for (const Setting& s : settings())
    if (above.empty() || s.path.starts_with(above + ".")) {
      const std::size_t begin = above.empty() ? 0 : above.size() + 1;
      const std::string key = s.path.substr(begin, s.path.find('.', begin) - begin);
      if (known.empty() || known.back() != key) known.push_back(key);
    }
  if (above.empty()) known.insert(known.end(), {"assume", "from", "$schema"});
  for (const auto& [key, value] : object.items()) {
    const std::string path = above.empty() ? key : above + "." + key;
    if (std::find(known.begin(), known.end(), key) == known.end())
      throw UsageError("unknown key " + in_quotes(path) + ", the nearest is '" + (above.empty() ? "" : above + ".") +
                       nearest(key, known) + "'");
    const bool is_setting =
        std::any_of(settings().begin(), settings().end(), [&](const Setting& s) { return s.path == path; });
    if (is_setting || (above.empty() && (key == "assume" || key == "from" || key == "$schema"))) continue;
    if (!value.is_object()) throw UsageError(path + " is " + short_form(value) + ", must be an object {...}");
    check_keys(value, path);
  }
}

void check_notes(const Json& whole) {
  if (whole.contains("$schema") && !whole["$schema"].is_string())
    throw UsageError("$schema is " + short_form(whole["$schema"]) + ", must be text");
  if (!whole.contains("from")) return;
  if (!whole["from"].is_object())
    throw UsageError("from is " + short_form(whole["from"]) + ", must be an object {...}");
  for (const auto& [path, source] : whole["from"].items()) {
    setting(path);
    if (!source.is_string()) throw UsageError("from." + path + " is " + short_form(source) + ", must be text");
  }
}

/// JSON whose objects have no key twice.
Json parsed(const std::string& text) {
  constexpr int deepest = 16;
  std::vector<std::set<std::string>> open;
  const auto watch = [&](int depth, nlohmann::json::parse_event_t event, Json& value) {
    using Event = nlohmann::json::parse_event_t;
    if (depth > deepest) throw UsageError(lumo::message("is nested more than ", deepest, " deep"));
    if (event == Event::object_start) open.emplace_back();
    if (event == Event::object_end) open.pop_back();
    if (event == Event::key && !open.back().insert(value.get<std::string>()).second)
      throw UsageError("has the key " + in_quotes(value.get<std::string>()) + " twice");
    return true;
  };
  try {
    return Json::parse(text, watch);
  } catch (const nlohmann::json::out_of_range&) {
    throw UsageError("holds a number that is not finite");
  } catch (const nlohmann::json::parse_error& e) {
    throw UsageError(lumo::message("is not JSON, at byte ", e.byte));
  }
}

/// Whole fingers, and what distinguishes a built finger from a plain one; the others are the library's.
void assume_plain(Configuration& c) {
  c.pad.finger = plain_finger();
  c.search.references = References::plain;
}
void assume_built(Configuration& c) {
  c.pad.finger = built_finger();
  c.search.references = References::built;
}

/// docs/manual.md has what it is off by.
void assume_quick(Configuration& c) {
  constexpr double rays = 0.25, noise = 3.5;
  c.pad.finger.mesh = c.pad.finger.mesh.coarser(FingerOptions::Mesh::quick_edges);
  c.focus = c.focus.scaled(FingerOptions::Mesh::quick_edges);
  c.light.ray_error_percent *= noise;
  for (int* count : {&c.light.rays_per_emitter, &c.light.carrier_rays, &c.light.exit_rays})
    *count = std::max(64, int(rays * *count));
}

const std::vector<NamedAssumption> own_assumptions = {{"built", "the finger as its authors built it", assume_built},
    {"plain", "a pad on a flat carrier, bonded to the stem, with free ends and LEDs in the silicone", assume_plain},
    {"authors",
        "built, and what the authors' code has otherwise: the film over an LED closes on touch; all light is seen that "
        "leaves towards +x, in regions that stay in space; contact sets are records within 0.1 mm, and in time no load "
        "is held",
        [](Configuration& c) {
          assume_built(c);
          c.pad.finger.recess.film_closes = 0.0;
          c.pad.finger.readout.by_direction = true;
          c.pad.finger.readout.in_space = true;
          c.mechanics.record_margin_mm = 0.1;
          c.mechanics.hold_s = 0.0;
        }},
    {"contact_by_records", "contact set: all triangles within 0.1 mm of the tool",
        [](Configuration& c) { c.mechanics.record_margin_mm = 0.1; }},
    {"carrier_friction_0.5", "friction of pad and carrier: 0.5",
        [](Configuration& c) { c.mechanics.carrier_friction = 0.5; }},
    {"quick", "a look in a fifth of the time: coarser meshes, fewer rays, larger errors beside results", assume_quick},
    {"first_crossing", "load state: the first step at which the load is met (vbd)",
        [](Configuration& c) { c.mechanics.hold_s = 0.0; }}};

void apply_variant(const AssumptionVariant& variant, Configuration& c) {
  FingerAssumptions a{c.pad.silicone, c.pad.finger, c.mechanics.friction, c.touch.tilt};
  variant.apply(a);
  c.pad.silicone = a.silicone;
  c.pad.finger = a.finger;
  c.mechanics.friction = a.friction;
  if (a.tilt != c.touch.tilt) c.touch.tilt = c.ensemble.tilt = a.tilt;
}

}  // namespace

std::vector<NamedAssumption> named_assumptions() {
  std::vector<NamedAssumption> all = own_assumptions;
  for (const AssumptionVariant& v : known_assumption_variants())
    all.push_back({v.key, v.name(), [v](Configuration& c) { apply_variant(v, c); }});
  return all;
}

Json Effective::shown(const Setting& s) const {
  const auto given = given_.find(s.path);
  return given == given_.end() ? s.get(value_) : given->second;
}

template <class Change> void Effective::layer(const std::string& from, const Change& change) {
  const Configuration before = value_;
  change(value_);
  for (const Setting& s : settings()) {
    if (s.get(before) == s.get(value_)) continue;
    std::string& source = from_[s.path];
    if (source.starts_with("--set ") && !from.starts_with("--set "))
      throw UsageError(from + " takes back " + source + ": give one of them");
    source = from;
    given_.erase(s.path);
  }
}

void Effective::put_marked(const Setting& s, const Json& value, const std::string& from) {
  layer(from, [&](Configuration& c) { put(s, c, value); });
  from_[s.path] = from;
  given_[s.path] = value;
}

void Effective::type(const std::string& flag, const std::string& path, const std::string& typed) {
  const Setting& s = setting(path);
  try {
    put_marked(s, typed_value(s, typed), flag);
  } catch (const Misfit& e) {
    std::vector<std::string> fields;
    for (const std::string_view field : split(typed)) fields.push_back(in_quotes(field));
    throw UsageError(flag + " is " + in_quotes(typed) + said(e, fields));
  }
}

void Effective::set(const std::string& assignment) {
  const std::size_t at = assignment.find('=');
  if (at == std::string::npos || at == 0)
    throw UsageError("--set is " + in_quotes(assignment) + ", must be PATH=VALUE, as --set finger.stem=free");
  const std::string path = assignment.substr(0, at);
  type("--set " + path, path, assignment.substr(at + 1));
}

void Effective::assume(const std::string& name, const std::string& from) {
  std::vector<std::string> known;
  for (const NamedAssumption& a : named_assumptions()) {
    known.push_back(a.name);
    if (a.name != name) continue;
    return layer(from, [&](Configuration& c) {
      a.apply(c);
      if (!given_.contains("theta_mm")) c.pad.theta_mm = baseline_of(c.search.references).values();
    });
  }
  throw UsageError("unknown assumption " + in_quotes(name) + ", the nearest is '" + nearest(name, known) + "'");
}

void Effective::read(const std::string& file) {
  constexpr std::size_t largest = 1 << 20;
  const auto text = read_whole(file, largest);
  if (!text) throw InputError("configuration '" + file + "': cannot be read, or has more than 1 MiB");
  read_text(*text, file);
}

void Effective::read_text(const std::string& text, const std::string& source) {
  const std::string from = "file " + source;
  std::string path;
  Json whole;
  Effective next = *this;
  try {
    whole = parsed(text);
    if (!whole.is_object()) throw UsageError("is " + short_form(whole) + ", must be an object {...}");
    check_keys(whole, "");
    check_notes(whole);
    if (whole.contains("assume")) {
      const Json& list = whole["assume"];
      if (!list.is_array()) throw UsageError("assume is " + short_form(list) + ", must be a list of names");
      for (const Json& name : list) {
        if (!name.is_string()) throw UsageError("assume has " + short_form(name) + ", must be a name");
        next.assume(name.get<std::string>(), from);
      }
    }
    for (const Setting& s : settings()) {
      path = s.path;
      if (const Json* const value = find(whole, s.path)) next.put_marked(s, *value, from);
    }
    next.check_silicone();
    next.check_ensemble(whole);
  } catch (const UsageError& e) {
    throw InputError("configuration '" + source + "': " + e.what());
  } catch (const Misfit& e) {
    const Json& value = *find(whole, path);
    std::vector<std::string> fields;
    if (value.is_array())
      for (const Json& field : value) fields.push_back(short_form(field));
    throw InputError("configuration '" + source + "': " + path + " is " + short_form(value) + said(e, fields));
  }
  *this = std::move(next);
}

bool Effective::gives(const std::string& group) const {
  return std::any_of(from_.begin(), from_.end(),
      [&](const auto& entry) { return entry.first == group || entry.first.starts_with(group + "."); });
}

void Effective::check_silicone() const {
  const std::string& card = value_.pad.silicone.name;
  if (find_silicone(card)) return;
  for (const Setting& s : settings())
    if (s.path.starts_with("silicone.") && !given_.contains(s.path))
      throw UsageError("silicone " + in_quotes(card) + " is none of DS and Sol, and " + s.path + " is missing");
}

void Effective::check_ensemble(const Json& file) const {
  const Json* const given = find(file, "ensemble.name");
  if (given != nullptr && *given != "own" && *given != name(value_.ensemble))
    throw UsageError(
        "ensemble.name is " + short_form(*given) + ", and a value beside it is none of its own: must be own");
}

void Effective::check() const {
  check_silicone();
  validate(value_.pad.silicone);
  validate(value_.pad.finger);
  for (const auto& [what, rays] : {std::pair("light.rays_per_emitter", value_.light.rays_per_emitter),
           {"light.carrier_rays", value_.light.carrier_rays}, {"light.exit_rays", value_.light.exit_rays}})
    if ((rays & (rays - 1)) != 0) throw InvalidArgument(lumo::message(what, " is ", rays, ", must be a power of two"));
  require_feasible(value_.pad.design(), value_.pad.finger.pad);
}

Json Effective::tree() const {
  Json whole = Json::object();
  for (const Setting& s : settings()) plant(whole, s.path, shown(s));
  return whole;
}

Json Effective::dump() const {
  Json whole = tree();
  for (const Setting& s : settings()) {
    const auto from = from_.find(s.path);
    whole["from"][s.path] =
        from == from_.end() ? "default (" + std::string(name(source_of(s, value_))) + ")" : from->second;
  }
  return whole;
}

Json tree_of(const Configuration& configuration, const std::vector<std::string>& groups) {
  Json tree = Json::object();
  for (const Setting& s : settings())
    if (groups.empty() || std::find(groups.begin(), groups.end(), s.path.substr(0, s.path.find('.'))) != groups.end())
      plant(tree, s.path, s.get(configuration));
  return tree;
}

Configuration configuration_of(const Json& tree) {
  if (!tree.is_object()) throw UsageError("is no object");
  check_keys(tree, "");
  Configuration c;
  for (const Setting& s : settings())
    if (const Json* const value = find(tree, s.path)) put(s, c, *value);
  return c;
}

namespace {

Json schema_of(const Setting& s) {
  Json j = {{"description", s.help + (s.unit.empty() ? "" : " [" + s.unit + "]")}};
  const Json number = {{"type", "number"}, {"minimum", s.limits.low}, {"maximum", s.limits.high}};
  switch (s.kind) {
    case Kind::number: append(j, number); break;
    case Kind::number_or_null:
      append(j, number);
      j["type"] = {"number", "null"};
      break;
    case Kind::whole:
      append(j, number);
      j["type"] = "integer";
      break;
    case Kind::flag: j["type"] = "boolean"; break;
    case Kind::word:
      j["type"] = "string";
      if (!s.words.empty()) j["enum"] = s.words;
      break;
    case Kind::numbers:
      j["type"] = "array";
      j["items"] = s.count == 0 ? number : Json{{"type", "number"}};
      j["minItems"] = std::max<std::size_t>(1, s.count);
      if (s.count > 0) j["maxItems"] = s.count;
  }
  j["default"] = s.get({});
  return j;
}

}  // namespace

Json schema() {
  Json groups = Json::object(), names = Json::array();
  for (const Setting& s : settings()) {
    const std::size_t dot = s.path.find('.');
    if (dot == std::string::npos) {
      groups[s.path] = schema_of(s);
      continue;
    }
    Json& group = groups[s.path.substr(0, dot)];
    group["type"] = "object";
    group["additionalProperties"] = false;
    group["properties"][s.path.substr(dot + 1)] = schema_of(s);
  }
  for (const NamedAssumption& a : named_assumptions()) names.push_back(a.name);
  groups["assume"] = {{"description", "Named assumptions, applied in their order before all other keys"},
      {"type", "array"}, {"items", {{"enum", names}}}};
  groups["from"] = {{"description", "Where each value was from, as --dump-config writes it; not read"},
      {"type", "object"}, {"additionalProperties", {{"type", "string"}}}};
  groups["$schema"] = {{"type", "string"}};
  return {{"$schema", "https://json-schema.org/draft/2020-12/schema"}, {"title", "Configuration of lumo"},
      {"type", "object"}, {"additionalProperties", false}, {"properties", groups}};
}

}  // namespace lumo::program
