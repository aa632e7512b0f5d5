#include "commands/commands.hpp"
#include "computing/press.hpp"
#include "report/present.hpp"

namespace lumo::program {

namespace {

struct Mesh : DesignCommand {
  void declare(CLI::App& app) { declare_common(app); }
  Result run(Output& files, Progress& progress) const {
    return present(asked(), json, make_mesh(asked(), progress), files);
  }
};

}  // namespace

void add_mesh(CommandLine& line) { line.add<Mesh>("mesh", "Make the tetrahedral mesh (VTU with --out)"); }

}  // namespace lumo::program
