#pragma once

#include "commands/commands.hpp"

#include <string>

namespace lumo::program {

/// A command about one campaign's store.
struct StoreCommand : Common {
  std::string store;

  void declare(CLI::App& app) {
    add_store(app);
    add_common(app, *this);
  }
  void add_store(CLI::App& app) { add_text(app, "--store", store, "FILE", "File that keeps the campaign")->required(); }
};

/// What a store holds, as text or JSON. Throws StoreError.
std::string campaign_status(const std::string& store, bool as_json);

}  // namespace lumo::program
