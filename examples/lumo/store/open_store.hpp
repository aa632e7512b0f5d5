#pragma once

#include "options/options.hpp"

#include "lumo/support/sqlite.hpp"

#ifdef LUMO_PROGRAM_POSTGRES
#include "lumo/support/postgres.hpp"
#endif

#include <string>
#include <utility>

/// Where a campaign is kept, from what was typed: a file, or a database that several machines share.
namespace lumo::program {

inline constexpr const char* no_postgres =
    "this lumo was built without PostgreSQL (package libpq-dev): --store takes a file, no postgresql://";

inline bool is_database(const std::string& store) {
  return store.starts_with("postgresql://") || store.starts_with("postgres://");
}

/// Calls `use` with the database's store. Throws UsageError in a build without PostgreSQL.
template <class Use, class... Arguments> auto with_database([[maybe_unused]] Use&& use,
    [[maybe_unused]] const std::string& store, [[maybe_unused]] const Arguments&... arguments)
    -> decltype(use(std::declval<SqliteStore&>())) {
#ifdef LUMO_PROGRAM_POSTGRES
  PostgresStore database(store, arguments...);
  return use(database);
#else
  throw UsageError(no_postgres);
#endif
}

/// Calls `use` with a store that is there, for reading. Throws StoreError.
template <class Use> auto with_store(const std::string& store, Use&& use) {
  if (is_database(store)) return with_database(use, store);
  SqliteStore file(store);
  return use(file);
}
/// The same of one that is made for this problem if there is none, for writing.
template <class Use> auto with_store(const std::string& store, const std::string& problem, Use&& use) {
  if (is_database(store)) return with_database(use, store, problem);
  SqliteStore file(store, problem);
  return use(file);
}

/// As messages, pages and results name it: without a password. Throws UsageError.
inline std::string shown_store(const std::string& store) {
  if (!is_database(store)) return store;
#ifdef LUMO_PROGRAM_POSTGRES
  return PostgresStore::name_of(store);
#else
  throw UsageError(no_postgres);
#endif
}

}  // namespace lumo::program
