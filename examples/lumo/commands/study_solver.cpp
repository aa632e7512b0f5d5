#include "commands/pressing.hpp"
#include "computing/solver_study.hpp"

namespace lumo::program {

namespace {

struct StudySolver : DesignCommand {
  void declare(CLI::App& app) {
    declare_common(app);
    add_touch(app, effective);
    add_setting(app, effective, "--size", "mechanics.edge_mm", "Of all edges of the linear mesh [mm], default 1");
    add_contact(app, effective);
  }
  Result run(Output& files, Progress& progress) const {
    const SolverStudy result = make_solver_study(asked(), threads, progress);
    std::vector<ScenarioRecord> presses;
    for (const SolverRow& row : result.rows) presses.push_back(row.scenario);
    return {present(asked(), json, result, files), failure_of(asked(), presses)};
  }
};

}  // namespace

void add_study_solver(CommandLine& line) {
  line.add<StudySolver>("study solver",
      "One press by the paper's solver and by equilibrium: depth, residual, distance (1 mm, five loads: some 20 min of "
      "one processor)");
}

}  // namespace lumo::program
