// The command-line program: reads the options, runs one command, writes its result, and turns errors into one line and an exit code.
#include "commands/campaign.hpp"
#include "computing/commands.hpp"
#include "commands/doctor.hpp"
#include "commands/fabricate.hpp"
#include "console/interrupt.hpp"
#include "asking/optimize.hpp"
#include "options/options.hpp"
#include "console/output.hpp"
#include "report/present.hpp"
#include "console/progress.hpp"
#include "commands/sensing.hpp"
#include "computing/solver_study.hpp"
#include "commands/study.hpp"
#include "console/text.hpp"

#include <iostream>
#include <new>
#include <string>
#include <string_view>
#include <vector>

namespace {

using namespace lumo::program;

enum ExitCode { ok = 0, fault = 1, usage = 2, infeasible = 3, numerical = 4, bad_file = 5 };

int complain(const std::string& text, ExitCode code) {
  std::cerr << "lumo: " << one_line(text) << std::endl;
  return code;
}

std::string_view meaning(std::string_view status) {
  if (status == "not_positive_definite") return "the pad gives way, or buckles";
  if (status == "inverted") return "an element is crushed";
  if (status == "max_iterations") return "the residual stays too large";
  if (status == "time_limit") return "out of time";
  return "the solver found no way on";
}

/// Shows the result even where a solve went wrong, for the states before it are sound; files are for good results only.
template <class Result>
int deliver(const Options& options, const Result& result, const std::vector<ScenarioReport>& scenarios, Output& files, Progress& progress) {
  const std::string text = present(options, result, files);
  progress.finish();
  for (const auto& s : scenarios)
    if (s.status != "converged" && s.status != "held") {   // who asked for a solver that holds gets what it holds
      print(text);
      return complain(lumo::detail::text("no equilibrium at ", s.states.empty() ? 0.0 : s.states.back().load_N, " N (", s.status, ": ", meaning(s.status), "), sphere of ", s.diameter_mm,
                                         " mm at ", s.angle_deg, " deg, y = ", s.y_mm, " mm"),
                      numerical);
    }
  hand_out(text, files, progress);
  return ok;
}

/// Commands that are not about one design: what is to be printed.
std::string general(const Options& options, Output& files, Progress& progress, char** arguments) {
  switch (options.command) {
    case Command::doctor: return options.camera ? sense(options, files, progress, arguments) : doctor(options.json);
    case Command::fabricate: return fabricate(options, files);
    case Command::optimize: optimize(options.space, options.transcript); return "";
    case Command::campaign_run: return campaign_run(options, progress);
    case Command::campaign_status: return campaign_status(options);
    case Command::campaign_verify: return campaign_verify(options);
    case Command::campaign_export: return campaign_export(options);
    case Command::campaign_select: return campaign_select(options, progress);
    case Command::campaign_report: return campaign_report(options, progress);
    case Command::study_carrier:
    case Command::study_void: return study(options, files, progress);
    case Command::study_readings: return study_readings(options, files, progress);
    default: return sense(options, files, progress, arguments);
  }
}

int run(const Options& options, char** arguments) {
  check_design(options);   // the default one, where none was asked for
  Output files(options.out);
  Progress progress(options.quiet);
  switch (options.command) {
    case Command::section: return deliver(options, make_section(options), {}, files, progress);
    case Command::mesh: return deliver(options, make_mesh(options, progress), {}, files, progress);
    case Command::press: {
      const auto result = make_press(options, progress);
      return deliver(options, result, {result.scenario}, files, progress);
    }
    case Command::trace: {
      const auto result = make_trace(options, progress);
      return deliver(options, result, {result.scenario}, files, progress);
    }
    case Command::evaluate: {
      const auto result = make_evaluation(options, progress);
      return deliver(options, result, result.scenarios, files, progress);
    }
    case Command::study_solver: {
      const auto result = make_solver_study(options, progress);
      std::vector<ScenarioReport> presses;
      for (const SolverRow& row : result.rows) presses.push_back(row.scenario);
      return deliver(options, result, presses, files, progress);
    }
    default: hand_out(general(options, files, progress, arguments), files, progress); return ok;
  }
}

}  // namespace

int main(int argc, char** argv) {
  settle_blas(argv);
  open_standard_streams();
  stop_on_interrupt();
  try {
    std::string text;
    const auto options = parse({argv, std::size_t(argc)}, text);
    if (options) return run(*options, argv);
    print(text);
    return ok;
  } catch (const UsageError& e) {
    return complain(e.what(), usage);
  } catch (const lumo::InvalidArgument& e) {
    return complain(e.what(), usage);
  } catch (const lumo::InfeasibleDesign& e) {
    return complain(e.what(), infeasible);
  } catch (const lumo::NumericalError& e) {
    return complain(e.what(), numerical);
  } catch (const lumo::InputError& e) {
    return complain(e.what(), bad_file);
  } catch (const lumo::StoreError& e) {
    return complain(e.what(), bad_file);
  } catch (const std::bad_alloc&) {
    return complain("out of memory", numerical);
  } catch (const std::exception& e) {
    return complain(e.what(), fault);
  }
}
