#include "options/configured.hpp"

namespace lumo::program {

namespace {

/// May be repeated; each is applied in turn.
void add_layers(
    CLI::App& app, const std::string& flag, const std::string& kind, const std::string& help, const Read& read) {
  const auto all = [read](const std::vector<std::string>& typed) {
    for (const std::string& one : typed) read(one);
  };
  app.add_option_function<std::vector<std::string>>(flag, all, help)->type_name(kind)->allow_extra_args(false);
}

}  // namespace

CLI::Option* add_setting(
    CLI::App& app, Effective& effective, const std::string& flag, const std::string& path, const std::string& help) {
  const Kind kind = setting(path).kind;
  const char* const shown = kind == Kind::word ? "NAME" : kind == Kind::numbers ? "N,N,..." : "N";
  return add_value(app, flag, shown, help,
      [&effective, flag, path](const std::string& typed) { effective.type(flag, path, typed); });
}

// In this order they are applied.
void Configured::declare_configuration(CLI::App& app) {
  add_value(app, "--config", "FILE", "Configuration (JSON); what is not in it keeps its default",
      [this](const std::string& file) { effective.read(file); });
  add_value(
      app, "--finger", "NAME", "built (default: as its authors built it) or plain", [this](const std::string& typed) {
        effective.assume(one_of("--finger", typed, {"built", "plain"}), "--finger");
      });
  add_layers(app, "--assume", "NAME", "Another assumption, over the file; may be repeated. lumo config lists them",
      [this](const std::string& typed) { effective.assume(typed, "--assume " + typed); });
  app.add_flag_callback(
      "--quick", [this] { effective.assume("quick", "--quick"); },
      "A look in a fifth of the time, with larger errors: coarser meshes, fewer rays");
  add_layers(app, "--set", "PATH=VALUE", "One value of the configuration, over those; may be repeated",
      [this](const std::string& typed) { effective.set(typed); });
  add_flag(app, "--dump-config", dump_only, "Print the whole configuration, each value with where it is from, and end");
}

std::optional<std::string> Configured::printed_instead() const {
  if (!dump_only) return std::nullopt;
  return text_of(effective.dump(), 2) + "\n";
}

}  // namespace lumo::program
