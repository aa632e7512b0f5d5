#pragma once

#include "commands/commands.hpp"
#include "console/text.hpp"

#include <string>

namespace lumo::program {

inline void add_store(CLI::App& app, std::string& store) {
  add_text(app, "--store", store, "STORE",
      "File that keeps the campaign, or a database that several machines share: postgresql://HOST/DATABASE")
      ->required();
}

/// A command about one campaign's store.
struct StoreCommand : Common {
  std::string store;

  void declare(CLI::App& app) {
    add_store(app, store);
    add_common(app, *this);
  }
};

/// A hypervolume, of a campaign or its optimiser's standing, with its 90 % interval where it has one.
template <class S> std::string hypervolume_text(const S& s) {
  return "hypervolume " + scientific(s.hypervolume) +
         (s.low == s.high ? "" : " (90 %: " + scientific(s.low) + " to " + scientific(s.high) + ")");
}

/// What a store holds, as text or JSON, and how long it is to so many evaluations. Throws StoreError.
std::string campaign_status(const std::string& store, bool as_json, int evaluations);

}  // namespace lumo::program
