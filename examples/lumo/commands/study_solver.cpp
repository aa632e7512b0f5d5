#include "commands/pressing.hpp"
#include "computing/solver_study.hpp"

namespace lumo::program {

namespace {

struct StudySolver : DesignCommand {
  PressRequest request;

  void declare(CLI::App& app) {
    declare_common(app, request);
    add_touch(app, request);
    add_number(
        app, "--size", request.mechanics.size_mm, {0.2, 10.0}, "mm", "Of all edges of the linear mesh [mm], default 1");
    add_contact(app, request.mechanics);
  }
  void check() const { check_design(request); }
  Result run(Output& files, Progress& progress) const {
    const SolverStudy result = make_solver_study(request, threads, progress);
    std::vector<ScenarioRecord> presses;
    for (const SolverRow& row : result.rows) presses.push_back(row.scenario);
    return {present(request, json, result, files), failure_of(presses)};
  }
};

}  // namespace

void add_study_solver(CommandLine& line) {
  line.add<StudySolver>("study solver",
      "One press by the paper's solver and by equilibrium: depth, residual, distance (1 mm, five loads: some 20 min of "
      "one processor)");
}

}  // namespace lumo::program
