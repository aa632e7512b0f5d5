#include "commands/commands.hpp"

#include "console/text.hpp"

namespace lumo::program {

namespace {

std::string value_text(const Json& value) {
  if (!value.is_array()) return value.is_string() ? value.get<std::string>() : text_of(value, -1);
  return listing(value, [](const Json& v) { return text_of(v, -1); });
}

/// Checks a configuration and shows it whole.
struct Config : Configured {
  bool schema_only = false, markdown = false;

  void declare(CLI::App& app) {
    declare_configuration(app);
    add_theta(app, effective);
    add_material(app, effective);
    add_flag(app, "--schema", schema_only, "Print the JSON schema of configuration files, and end");
    add_flag(app, "--markdown", markdown, "Print settings and assumptions as tables of a page, and end");
    add_common(app, *this);
  }
  void check() const {
    if (!schema_only && !markdown) Configured::check();
  }

  Result run(Output&, Progress&) const {
    if (schema_only) return text_of(schema(), 2) + "\n";
    if (markdown) return tables();
    const Json whole = effective.dump();
    if (json) return text_of(whole, 2) + "\n";
    std::string text = pad("setting", -38) + pad("value", -34) + "from\n";
    for (const Setting& s : settings())
      text +=
          pad(s.path, -38) + pad(value_text(effective.shown(s)), -34) + whole["from"][s.path].get<std::string>() + "\n";
    text += "\nassumptions, for --assume\n";
    for (const NamedAssumption& a : named_assumptions()) text += pad(a.name, -22) + a.words + "\n";
    return text;
  }

  std::string tables() const {
    std::string text = "| setting | default | may be | source | what |\n|---|---|---|---|---|\n";
    for (const Setting& s : settings())
      text += "| `" + s.path + "` | " + value_text(effective.shown(s)) + " | " + admitted(s) + " | " +
              std::string(name(source_of(s, asked()))) + " | " + s.help + " |\n";
    text += "\n| assumption | what |\n|---|---|\n";
    for (const NamedAssumption& a : named_assumptions()) text += "| `" + a.name + "` | " + a.words + " |\n";
    return text;
  }
};

}  // namespace

void add_config(CommandLine& line) {
  line.add<Config>("config", "Check a configuration and print it whole; settings, assumptions, JSON schema");
}

}  // namespace lumo::program
