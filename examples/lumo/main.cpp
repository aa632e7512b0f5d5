// The command-line program: runs the command that was typed, and turns errors into one line and an exit code.
#include "commands/commands.hpp"
#include "computing/contacts.hpp"
#include "console/interrupt.hpp"
#include "console/output.hpp"
#include "console/version.hpp"

#include "lumo/campaign/journal.hpp"

#include <new>
#include <string>

int main(int argc, char** argv) {
  using namespace lumo::program;
  settle_blas(argv);
  open_standard_streams();
  stop_on_interrupt();
  try {
    CommandLine line("lumo", "Mechanics, optics and design of soft lit finger pads.",
        lumo::message("lumo ", version, ", results ", results_version),
        "Exit codes: 0 ok, 1 a fault of lumo itself, 2 usage, 3 infeasible design, 4 numerical failure, 5 "
        "bad file, 130 interrupted.\n"
        "Results go to standard output, progress to standard error.");
    line.name_group("campaign", "Search for the best design; the store continues after any interruption");
    line.name_group("lab", "Logs of a virtual rig: computed mechanics and light, a camera, a motor and their errors");
    line.name_group("study", "What a feature of the design is worth, over many designs");
    add_commands(line);
    std::string text;
    if (const auto run = line.parse({argv, std::size_t(argc)}, text)) return run();
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
