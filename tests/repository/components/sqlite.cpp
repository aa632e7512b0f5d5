#include "lumo/support/sqlite.hpp"

#include "version.hpp"

#include <filesystem>

int main() {
  std::filesystem::remove("components_sqlite.db");
  const lumo::SqliteStore log("components_sqlite.db", "a problem");
  log.verify();
  return log.entries().size() == 1 && is_wanted_version() ? 0 : 1;
}
