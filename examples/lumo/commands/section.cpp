#include "computing/section.hpp"

#include "commands/commands.hpp"
#include "report/present.hpp"

namespace lumo::program {

namespace {

struct Section : DesignCommand {
  void declare(CLI::App& app) { declare_common(app); }
  Result run(Output& files, Progress&) const { return present(asked(), json, make_section(asked().pad), files); }
};

}  // namespace

void add_section(CommandLine& line) {
  line.add<Section>("section", "Draw the cross-section with its dimensions (SVG)");
}

}  // namespace lumo::program
