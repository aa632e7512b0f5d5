#include "commands/pressing.hpp"
#include "computing/press.hpp"
#include "report/present.hpp"

namespace lumo::program {

namespace {

struct Trace : PressCommand {
  Result run(Output& files, Progress& progress) const {
    const TraceResult result = make_trace(asked(), threads, progress);
    return {present(asked(), json, result, files), failure_of(asked(), result.press.seen.scenarios)};
  }
};

}  // namespace

void add_trace(CommandLine& line) { line.add<Trace>("trace", "Press, then trace light: response of each region"); }

}  // namespace lumo::program
