#pragma once

#include "lumo/core/short_number.hpp"

#include <string>

namespace lumo::detail {

/// A length in mm with at most six digits after the point: nanometres. The same in every locale.
inline std::string in_mm(double length_m) { return short_number(1e3 * length_m, 6); }

}  // namespace lumo::detail
