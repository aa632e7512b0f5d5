#include "campaign/store_laws.hpp"
#include "lumo/support/postgres.hpp"
#include "lumo/support/sqlite.hpp"
#include "postgres_server.hpp"
#include "temporary_folder.hpp"

#include <functional>
#include <memory>

namespace {

struct ServerPlace {
  PostgresServer server;
  lumo::PostgresStore open(const std::string& name, const std::string& problem) const {
    return {server.address(name), problem};
  }
  lumo::PostgresStore read(const std::string& name) const { return lumo::PostgresStore(server.address(name)); }
};

/// Says why where there is no server; the tests' packages have one.
bool without_server() {
  const std::string why = PostgresServer::missing();
  if (!why.empty()) WARN("skipped: " << why);
  return !why.empty();
}

}  // namespace

TEST_CASE("A store in a database obeys the laws of stores") {
  if (without_server()) return;
  const ServerPlace place;
  store_laws::keeps_entries(place);
  store_laws::refuses_another_problem(place);
  store_laws::keeps_deliveries(place);
  store_laws::claims_end_with_their_worker(place);
  store_laws::claims_do_not_fail_for_others(place);
  store_laws::several_processes_append_once(place);
}

TEST_CASE("A journal in a database does not depend on the number of workers") {
  if (without_server()) return;
  store_laws::journals_do_not_depend_on_workers(ServerPlace{});
}

namespace {

std::string refusal_of(const std::function<void()>& act) {
  try {
    act();
  } catch (const lumo::StoreError& e) {
    const std::string said = e.what();
    CHECK(said.find('\n') == std::string::npos);
    CHECK(said.find("secret") == std::string::npos);
    return said;
  }
  FAIL("nothing was thrown");
  return {};
}

}  // namespace

TEST_CASE("A database that cannot be used is one clear line without a password, and nothing is written") {
  if (without_server()) return;
  using lumo::PostgresStore;
  const PostgresServer server;
  const auto open = [](const std::string& address) { return [=] { PostgresStore(address, "p"); }; };
  const auto read = [](const std::string& address) { return [=] { PostgresStore store(address); }; };
  server.sql("CREATE ROLE reader LOGIN PASSWORD 'secret-1'");
  server.sql("CREATE ROLE worker LOGIN PASSWORD 'secret-2'");
  const auto role = [&](const std::string& who, const std::string& password, const std::string& schema = "lumo") {
    return server.address(schema, who + ':' + password);
  };
  {
    PostgresStore store(server.address(), "p");
    store_laws::fill(store, 3);
  }
  server.sql("GRANT USAGE ON SCHEMA lumo TO reader, worker");
  server.sql("GRANT SELECT ON ALL TABLES IN SCHEMA lumo TO reader, worker");

  using Catch::Contains;
  CHECK_THAT(refusal_of(open(role("reader", "secret-wrong"))),
      Contains("store postgresql://reader@/postgres?host=") && Contains("password authentication failed"));
  CHECK_THAT(refusal_of(open(server.address("lumo", "lumo", "nowhere"))), Contains("\"nowhere\" does not exist"));
  CHECK_THAT(refusal_of(open(server.address("lumo", "nobody:secret-1"))), Contains("authentication failed"));
  CHECK_THAT(refusal_of(read(server.address("other"))), Contains("no schema 'other'"));
  CHECK_THAT(refusal_of(open(role("reader", "secret-1"))), Contains("'reader' may read it, not write"));
  CHECK_THAT(refusal_of(open(role("reader", "secret-1", "mine"))), Contains("permission denied"));
  CHECK_THAT(refusal_of(open("postgresql://lumo@/postgres?host=/no/such/folder")), Contains("No such file"));
  CHECK(PostgresStore(role("reader", "secret-1")).entries().size() == 4);

  // Least rights of a worker: it adds and cannot change what is there.
  server.sql("GRANT INSERT ON lumo.entry, lumo.task, lumo.delivery TO worker");
  server.sql("GRANT UPDATE ON lumo.head, lumo.task TO worker");
  server.sql("GRANT DELETE ON lumo.delivery TO worker");
  {
    PostgresStore store(role("worker", "secret-2"), "p");
    store_laws::fill(store, 5);
    CHECK(store.claim_first({3, 4}) == 3);
    CHECK(store.deliver(2, store_laws::entry(20)));
    CHECK(store.entries().size() == 6);
  }

  server.sql("CREATE SCHEMA mixed");
  server.sql("CREATE TABLE mixed.accounts(a int)");
  CHECK_THAT(refusal_of(open(server.address("mixed"))), Contains("'mixed' is not a store of lumo"));
  server.sql("CREATE VIEW lumo.more AS SELECT 1");
  CHECK_THAT(refusal_of(read(server.address())), Contains("'more' that lumo has not made"));
  server.sql("DROP VIEW lumo.more");
  server.sql("CREATE FUNCTION f() RETURNS trigger LANGUAGE plpgsql AS 'BEGIN RETURN NULL; END'");
  server.sql("CREATE TRIGGER t BEFORE INSERT ON lumo.entry FOR EACH ROW EXECUTE FUNCTION f()");
  CHECK_THAT(refusal_of(open(server.address())), Contains("'entry' that lumo has not made"));
  server.sql("DROP TRIGGER t ON lumo.entry");
  server.sql("UPDATE lumo.entry SET content = 'x' WHERE number = 3");
  CHECK_THAT(refusal_of(read(server.address())), Contains("is damaged at entry 3"));
  server.sql("UPDATE lumo.about SET format = 7");
  CHECK_THAT(refusal_of(read(server.address())), Contains("format 7, this version of lumo reads 1"));
}

TEST_CASE("An address is refused without repeating it, and its name has no password") {
  using lumo::PostgresStore;
  CHECK(PostgresStore::name_of("postgresql://ann:secret@db.example:5433/pads?schema=flat&sslmode=require") ==
        "postgresql://ann@db.example:5433/pads?sslmode=require&schema=flat");
  CHECK(PostgresStore::name_of("postgresql://h/d?password=secret&user=ann") == "postgresql://ann@h/d");
  CHECK(PostgresStore::name_of("postgresql:///d?host=/run/pg&schema=lumo") == "postgresql:///d?host=/run/pg");
  CHECK(PostgresStore::name_of("postgresql://[::1]:5432/d") == "postgresql://[::1]:5432/d");
  for (const char* bad : {"postgresql://u:se@cret@h/d", "postgresql://u:se/cret@h/d",
           "postgresql://u:secret@h/d?no_such=1", "postgresql://u:secret@h:port/d",
           "postgresql://u:secret@h/d?schema=a%20b", "postgresql://u:secret@h/d?schema=",
           "postgresql://u:secret@h/d?schema=Pads", "postgresql://u:secret@h/d?schema=pg_pads"})
    try {
      PostgresStore::name_of(bad);
      FAIL(bad);
    } catch (const lumo::InvalidArgument& e) {
      INFO(e.what());
      CHECK(std::string(e.what()).find("cret") == std::string::npos);
      CHECK_THAT(e.what(), Catch::Contains("must be postgresql://"));
    }
}

TEST_CASE("An answer that is finished while the server is gone is kept in a file, and handed in once") {
  if (without_server()) return;
  PostgresServer server;
  lumo::PostgresConfig impatient;
  impatient.patience_s = 0.3;
  impatient.retry_s = 0.05;
  impatient.rescue_folder = server.folder().path.string();
  for (const int pending : {1, 3}) {  // appended, and kept beside
    const std::string schema = "gone_" + std::to_string(pending);
    std::string why;
    int evaluations = 0;
    {
      lumo::PostgresStore store(server.address(schema), "p", impatient);
      try {
        cheap_campaign::run(store, 12, pending, [&](const lumo::Design& x) {
          if (++evaluations == 4) server.stop(SIGKILL);
          return cheap_campaign::evaluate(x);
        });
      } catch (const lumo::StoreError& e) {
        why = e.what();
      }
    }
    CHECK(evaluations == 4);
    CHECK_THAT(why, Catch::Contains("the connection was lost") && Catch::Contains(schema + ".rescued-"));
    CHECK(why.find('\n') == std::string::npos);
    server.start();
    lumo::PostgresStore store(server.address(schema), "p", impatient);
    cheap_campaign::run(store, 12, pending, [&](const lumo::Design& x) {
      ++evaluations;
      return cheap_campaign::evaluate(x);
    });
    lumo::MemoryJournal alone("p");
    int expected = 0;
    cheap_campaign::run(alone, 12, pending, [&](const lumo::Design& x) {
      ++expected;
      return cheap_campaign::evaluate(x);
    });
    CHECK(evaluations == expected);  // the fourth was not evaluated again
    CHECK(store.entries().size() == alone.entries().size());
    store.verify();
    CHECK(server.folder().entries() == 1);  // the server's own
  }
}

namespace {

/// A worker that a fault may hit at any moment.
pid_t start_worker(const std::string& address, int evaluations, int pending, unsigned random) {
  return start_child([=]() mutable {
    lumo::PostgresConfig patient;
    patient.retry_s = 0.05;
    std::mt19937 times(random);
    const lumo::Stopwatch since;
    std::unique_ptr<lumo::PostgresStore> store;
    while (!store) try {  // the server may be starting
        store = std::make_unique<lumo::PostgresStore>(address, "p", patient);
      } catch (const lumo::StoreError&) {
        if (since.seconds() > 60.0) throw;
        ::usleep(50'000);
      }
    cheap_campaign::run(*store, evaluations, pending, [&](const lumo::Design& x) {
      ::usleep(useconds_t(times() % 30'000));
      return cheap_campaign::evaluate(x);
    });
  });
}

/// Campaigns by four workers, of which, of whose sessions and whose server one is killed again and again.
void campaigns_under_faults(int faults) {
  PostgresServer server;
  const int evaluations = 40, pending = 6;
  const TemporaryFolder folder;
  lumo::SqliteStore whole(folder / "whole", "p");
  cheap_campaign::run(whole, evaluations, pending, cheap_campaign::evaluate);
  std::mt19937 random(17);
  for (int fault = 0, campaign = 0; fault < faults; ++campaign) {
    const std::string address = server.address("faults_" + std::to_string(campaign));
    std::vector<pid_t> workers;
    const auto start = [&] { return start_worker(address, evaluations, pending, unsigned(random())); };
    for (int k = 0; k < 4; ++k) workers.push_back(start());
    for (; fault < faults; ++fault) {
      ::usleep(useconds_t(random() % 120'000));
      pid_t& victim = workers[random() % workers.size()];
      int status = 0;
      if (::waitpid(victim, &status, WNOHANG) == victim) {  // the campaign has ended
        CHECK(status == 0);
        victim = start();  // finds nothing to do, and may find it again
        break;
      }
      switch (random() % 8) {
        case 0: server.stop(SIGKILL), server.start(); break;
        case 1: server.stop(SIGQUIT), server.start(); break;
        case 2:
        case 3:
        case 4:
          server.sql(
              "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE application_name = 'lumo' AND pid "
              "<> pg_backend_pid() ORDER BY random() LIMIT 1");
          break;
        default:
          ::kill(victim, SIGKILL);
          ::waitpid(victim, nullptr, 0);
          victim = start();
      }
    }
    for (const pid_t pid : workers) store_laws::wait_for_success(pid);
    const lumo::PostgresStore store(address);
    store.verify();
    CHECK(store.digest() == whole.digest());
  }
}

}  // namespace

TEST_CASE("Workers, sessions and the server are killed: nothing lost, nothing twice, the bits of one process") {
  if (!without_server()) campaigns_under_faults(40);
}

TEST_CASE("1000 faults of workers, sessions and the server", "[long]") {
  if (!without_server()) campaigns_under_faults(1000);
}
