#include "lumo/support/postgres.hpp"

#include "version.hpp"

int main() {
  try {
    const lumo::PostgresStore log("postgresql:///campaigns?host=/no/such/folder");
  } catch (const lumo::StoreError&) {
    return is_wanted_version() ? 0 : 1;
  }
  return 1;
}
