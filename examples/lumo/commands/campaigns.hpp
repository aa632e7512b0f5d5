#pragma once

#include "commands/commands.hpp"

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

/// What a store holds, as text or JSON, and how long it is to so many evaluations. Throws StoreError.
std::string campaign_status(const std::string& store, bool as_json, int evaluations);

}  // namespace lumo::program
