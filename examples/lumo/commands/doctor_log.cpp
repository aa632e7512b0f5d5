// What `lumo doctor LOG` needs beyond `lumo doctor`, which works without any library.
#include "commands/doctor.hpp"
#include "sensing/findings.hpp"

namespace lumo::program {

namespace {

[[maybe_unused]] const bool examines_logs = (examine_log = examined, true);

}  // namespace

}  // namespace lumo::program
