#include "computing/press.hpp"

#include "commands/pressing.hpp"
#include "report/present.hpp"

namespace lumo::program {

namespace {

struct Press : PressCommand {
  Result run(Output& files, Progress& progress) const {
    const PressResult result = make_press(asked(), progress);
    return {present(asked(), json, result, files), failure_of(asked(), result.seen.scenarios)};
  }
};

}  // namespace

void add_press(CommandLine& line) { line.add<Press>("press", "Press a sphere on the pad: force, depth, contact"); }

}  // namespace lumo::program
