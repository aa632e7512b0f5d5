#include "commands/commands.hpp"
#include "computing/press.hpp"
#include "report/present.hpp"

namespace lumo::program {

namespace {

struct Mesh : DesignCommand {
  PressRequest request;

  void declare(CLI::App& app) { declare_common(app, request); }
  void check() const { check_design(request); }
  Result run(Output& files, Progress& progress) const {
    return present(request, json, make_mesh(request, progress), files);
  }
};

}  // namespace

void add_mesh(CommandLine& line) { line.add<Mesh>("mesh", "Make the tetrahedral mesh (VTU with --out)"); }

}  // namespace lumo::program
