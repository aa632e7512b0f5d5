#include "commands/pressing.hpp"
#include "computing/evaluation.hpp"
#include "report/present.hpp"

namespace lumo::program {

namespace {

struct Evaluate : DesignCommand {
  EvaluationRequest request;

  void declare(CLI::App& app) {
    declare_common(app, request);
    add_ensemble(app, request.ensemble);
    add_ray_error(app, request.ray_error_percent);
    add_mechanics(app, request.mechanics);
  }
  void check() const { check_design(request); }
  Result run(Output& files, Progress& progress) const {
    const Evaluation result = make_evaluation(request, threads, progress);
    return {present(request, json, result, files), failure_of(result.observations.scenarios)};
  }
};

}  // namespace

void add_evaluate(CommandLine& line) { line.add<Evaluate>("evaluate", "Both objectives of a design over an ensemble"); }

}  // namespace lumo::program
