#pragma once

#include "lumo/sense/estimate.hpp"

#include <string>

namespace lumo::program {

/// Calls `use` with the maker of the localiser of that name, "peak" or "bayes".
template <class Use> auto with_maker(const std::string& name, Use use) {
  return name == "peak" ? use(sense::peak_localizer) : use(sense::bayes_localizer);
}

}  // namespace lumo::program
