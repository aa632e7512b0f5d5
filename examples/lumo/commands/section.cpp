#include "computing/section.hpp"

#include "commands/commands.hpp"
#include "report/present.hpp"

namespace lumo::program {

namespace {

struct Section : DesignCommand {
  Pad pad;

  void declare(CLI::App& app) { declare_common(app, pad); }
  void check() const { check_design(pad); }
  Result run(Output& files, Progress&) const { return present(pad, json, make_section(pad), files); }
};

}  // namespace

void add_section(CommandLine& line) {
  line.add<Section>("section", "Draw the cross-section with its dimensions (SVG)");
}

}  // namespace lumo::program
