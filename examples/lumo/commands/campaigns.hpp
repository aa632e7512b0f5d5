#pragma once

#include "commands/commands.hpp"

#include <string>

namespace lumo::program {

inline void add_store(CLI::App& app, std::string& store) {
  add_text(app, "--store", store, "FILE", "File that keeps the campaign")->required();
}

/// A command about one campaign's store.
struct StoreCommand : Common {
  std::string store;

  void declare(CLI::App& app) {
    add_store(app, store);
    add_common(app, *this);
  }
};

/// What a store holds, as text or JSON. Throws StoreError.
std::string campaign_status(const std::string& store, bool as_json);

}  // namespace lumo::program
