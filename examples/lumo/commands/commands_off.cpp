// Takes the place of commands.cpp where a component is missing, so that `lumo doctor` can still say which.
#include "computing/commands.hpp"
#include "computing/solver_study.hpp"

namespace lumo::program {

namespace {

[[noreturn]] void off(Command command) { throw Error("'" + std::string(name(command)) + "' was built without a library that it needs; run 'lumo doctor'"); }

}  // namespace

MeshResult make_mesh(const Options& options, Progress&) { off(options.command); }
PressResult make_press(const Options& options, Progress&) { off(options.command); }
std::vector<PressOutcome> make_presses(const std::vector<Options>&, int, Progress&) { off(Command::press); }
TraceResult make_trace(const Options& options, Progress&) { off(options.command); }
SolverStudy make_solver_study(const Options& options, Progress&) { off(options.command); }
EvaluationResult make_evaluation(const Options& options, Progress&) { off(options.command); }
std::vector<double> make_depths(const Options& options, const std::array<double, 5>&, const lumo::Ensemble&, Progress&) { off(options.command); }
PadResponses make_pad_responses(const Options& options, Progress&) { off(options.command); }
std::string pad_responses_key(const Options&) { return ""; }
Evaluator campaign_evaluator(const Options& options, Progress&) { off(options.command); }
Evaluator study_evaluator(const Options& options, const MatchedStudy&, const lumo::Ensemble&, Progress&) { off(options.command); }
Evaluator readings_evaluator(const Options& options, const std::vector<Scenario<Sphere>>&, Progress&) { off(options.command); }

}  // namespace lumo::program
