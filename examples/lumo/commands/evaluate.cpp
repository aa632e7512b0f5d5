#include "commands/pressing.hpp"
#include "computing/evaluation.hpp"
#include "report/present.hpp"

namespace lumo::program {

namespace {

struct Evaluate : DesignCommand {
  void declare(CLI::App& app) {
    declare_common(app);
    add_ensemble(app, effective);
    add_setting(app, effective, "--observe", "observation.by",
        "Light that J_obs is of: side (default: all that leaves its regions), camera (what a lens takes in of it) or "
        "photodiodes");
    add_ray_error(app, effective);
    add_mechanics(app, effective);
    add_time_limit(app, effective);
  }
  Result run(Output& files, Progress& progress) const {
    const Evaluation result = make_evaluation(asked(), threads, progress);
    return {present(asked(), json, result, files), unscored(asked(), result.observations.scenarios)};
  }
};

}  // namespace

void add_evaluate(CommandLine& line) { line.add<Evaluate>("evaluate", "Both objectives of a design over an ensemble"); }

}  // namespace lumo::program
