#include "campaign/store_laws.hpp"
#include "lumo/support/sqlite.hpp"
#include "temporary_folder.hpp"

namespace {

struct FilePlace {
  TemporaryFolder folder;
  lumo::SqliteStore open(const std::string& name, const std::string& problem) const { return {folder / name, problem}; }
  lumo::SqliteStore read(const std::string& name) const { return lumo::SqliteStore(folder / name); }
};

}  // namespace

TEST_CASE("A store in a file obeys the laws of stores") {
  const FilePlace place;
  SECTION("entries") { store_laws::keeps_entries(place); }
  SECTION("problem") { store_laws::refuses_another_problem(place); }
  SECTION("answers that wait") { store_laws::keeps_deliveries(place); }
  SECTION("claims") { store_laws::claims_end_with_their_worker(place); }
  SECTION("a crowd") { store_laws::claims_do_not_fail_for_others(place); }
  SECTION("several processes") { store_laws::several_processes_append_once(place); }
}

TEST_CASE("A journal in a file does not depend on the number of workers") {
  store_laws::journals_do_not_depend_on_workers(FilePlace{});
}
