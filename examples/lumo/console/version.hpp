#pragma once

namespace lumo::program {

inline constexpr const char* version = LUMO_PROGRAM_VERSION;  // the build passes the project's own

}  // namespace lumo::program
