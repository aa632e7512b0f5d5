#include "campaign/cheap_campaign.hpp"
#include "campaign/store_test.hpp"
#include "catch.hpp"
#include "lumo/campaign/campaign.hpp"
#include "lumo/support/sqlite.hpp"
#include "temporary_folder.hpp"

#include <sys/wait.h>
#include <chrono>
#include <csignal>
#include <fstream>
#include <limits>
#include <map>
#include <random>
#include <set>
#include <thread>

using namespace lumo;

namespace {

using Cheap = cheap_campaign::Search;

TrialResult cheap(const Design& x) {
  return {cheap_campaign::outputs(x), false, "", std::string(500, 'r'), "took some time"};
}

const auto unwatched = [](const auto&, int, const TrialResult&) {};

template <class Log> CampaignState<Cheap> state_of(const Log& log, int evaluations) {
  CampaignState<Cheap> state(Cheap(cheap_campaign::problem(evaluations)));
  state.read(log.entries());
  return state;
}

}  // namespace

TEST_CASE("A campaign asks what its optimiser would ask, and keeps every result") {
  MemoryJournal log("p");
  Cheap alone(cheap_campaign::problem(20));
  while (const auto t = alone.ask()) alone.tell(t->id, cheap_campaign::outputs(t->x));
  int watched = 0;
  const OptimizerStatus end = run_campaign(
      log, Cheap(cheap_campaign::problem(20)), cheap, [&](const CampaignState<Cheap>& s, int id, const TrialResult& v) {
        ++watched;
        CHECK(s.optimizer().observed() == watched);
        CHECK(s.optimizer().trials()[std::size_t(id)].outputs == v.outputs);
        CHECK(log.record(*s.answered(id)) == v.record);
      });
  CHECK(end == OptimizerStatus::finished);
  CHECK(watched == 20);
  const auto state = state_of(log, 20);
  REQUIRE(state.optimizer().trials().size() == alone.trials().size());
  for (std::size_t k = 0; k < alone.trials().size(); ++k) CHECK(state.optimizer().trials()[k].x == alone.trials()[k].x);
  CHECK(state.optimizer().hypervolume() == alone.hypervolume());

  SECTION("and goes on with a larger budget as if it had always been so large") {
    run_campaign(log, Cheap(cheap_campaign::problem(26)), cheap, unwatched);
    MemoryJournal whole("p");
    run_campaign(whole, Cheap(cheap_campaign::problem(26)), cheap, unwatched);
    const auto a = log.entries(), b = whole.entries();
    REQUIRE(a.size() == b.size());
    for (std::size_t k = 0; k < a.size(); ++k) CHECK(a[k].content == b[k].content);
  }
}

TEST_CASE("Entries keep standard errors, and refuse what is none", "[noise]") {
  const JournalEntry kept = tell_entry(7, {0.1, -2e-30}, {0.0, 1e-3});
  CHECK(kept.content == "7 0.1 -2e-30 +- 0 0.001");
  const TrialEntry read = parse_trial(kept);
  CHECK(read.id == 7);
  CHECK(read.values == std::vector<double>{0.1, -2e-30});
  CHECK(read.errors == std::vector<double>{0.0, 1e-3});
  CHECK(tell_entry(7, {0.1}).content == "7 0.1");  // as ever
  CHECK(parse_trial(tell_entry(7, {0.1})).errors.empty());
  using Kind = JournalEntry::Kind;
  for (const char* damaged : {"7 1 +-", "7 1 +- ", "7 1 +- x", "7 1 +-2", "7 1 +- 2 +- 3", "7 1+- 2"})
    CHECK_THROWS_AS(parse_trial({3, Kind::tell, damaged, "", ""}), StoreError);
  CHECK_THROWS_AS(parse_trial({3, Kind::ask, "7 1 +- 2", "", ""}), StoreError);
}

TEST_CASE("A campaign's models know the errors of its objectives, after any interruption, too", "[noise]") {
  const auto uncertain = [](const Design& x) {
    TrialResult r = cheap(x);
    r.errors = {0.05 + 0.02 * x[2], 0.1};
    return r;
  };
  Cheap alone(cheap_campaign::problem(22));
  while (const auto t = alone.ask()) {
    const TrialResult r = uncertain(t->x);
    alone.tell(t->id, r.outputs, r.errors);
  }
  const TemporaryFolder folder;
  for (int evaluations = 20; evaluations <= 22; ++evaluations) {  // each time from the store
    SqliteStore log(folder / "store", "p");
    run_campaign(log, Cheap(cheap_campaign::problem(evaluations)), uncertain, unwatched);
  }
  const SqliteStore log(folder / "store");
  const auto state = state_of(log, 22);
  REQUIRE(state.optimizer().trials().size() == alone.trials().size());
  for (std::size_t k = 0; k < alone.trials().size(); ++k) {
    CHECK(state.optimizer().trials()[k].x == alone.trials()[k].x);
    CHECK(state.optimizer().trials()[k].errors == alone.trials()[k].errors);
  }
  const Standing standing = state.optimizer().standing();
  CHECK(standing.modelled == std::vector<std::string>{"f", "g"});
  CHECK(standing.low < standing.hypervolume);
  CHECK(standing.high > standing.hypervolume);

  // Nothing of it where there is to be no noise: entries and proposals are those of a search that hears of no errors.
  Problem exact = cheap_campaign::problem(22);
  exact.noise = Noise::none;
  MemoryJournal deaf("p"), plain("p");
  run_campaign(deaf, Cheap(exact), uncertain, unwatched);
  run_campaign(plain, Cheap(cheap_campaign::problem(22)), cheap, unwatched);
  const auto a = deaf.entries(), b = plain.entries();
  REQUIRE(a.size() == b.size());
  for (std::size_t k = 0; k < a.size(); ++k) CHECK(a[k].content == b[k].content);
  bool differs = false;
  for (const JournalEntry& e : log.entries()) differs = differs || e.content != b[std::size_t(e.number)].content;
  CHECK(differs);
}

TEST_CASE("Failures: never scored, a design's own is final, a machine's is tried again, too many stop the campaign") {
  MemoryJournal log("p");
  std::map<Design, int> attempts;
  const auto failing = [&](const Design& x) {
    const int n = ++attempts[x];
    if (std::lround(2.0 * x[0]) % 5 == 2) return TrialResult{{}, false, "mesh: no tetrahedra", "what was there", ""};
    if (std::lround(2.0 * x[1]) % 5 == 2 && n == 1)
      return TrialResult{{}, true, "press d = 10 mm: out of memory", "", ""};
    return cheap(x);
  };
  run_campaign(log, Cheap(cheap_campaign::problem(25)), failing, unwatched);
  const auto state = state_of(log, 25);
  CHECK(state.optimizer().observed() == 25);
  int final = 0, again = 0;
  for (const Trial& t : state.optimizer().trials()) {
    if (t.state != Trial::State::failed) continue;
    (t.retry ? again : final) += 1;
    CHECK(attempts[t.x] == (t.retry ? 2 : 1));
    if (!t.retry) {
      CHECK(t.why == "mesh: no tetrahedra");
      CHECK(log.record(*state.answered(t.id)) == "what was there");
    }
  }
  CHECK(final > 0);
  CHECK(again > 0);
  for (const auto& [x, n] : attempts) CHECK(n <= 2);

  MemoryJournal bad("p");
  int calls = 0;
  const auto mostly_failing = [&](const Design& x) {
    return ++calls % 3 == 0 ? cheap(x) : TrialResult{{}, false, "press: inverted", "", ""};
  };
  CHECK_THROWS_AS(run_campaign(bad, Cheap(cheap_campaign::problem(25)), mostly_failing, unwatched), CampaignError);
  CHECK(calls == 7);  // 5 of 7 failed
  CHECK_THROWS_WITH(run_campaign(bad, Cheap(cheap_campaign::problem(25)), mostly_failing, unwatched),
      Catch::Contains("5 of 7 evaluations failed") && Catch::Contains("press: inverted"));
  CHECK(calls == 7);
}

TEST_CASE("Errors that are no numbers are a failure of the design", "[noise]") {
  for (const double bad : {std::nan(""), -1.0, std::numeric_limits<double>::infinity()}) {
    MemoryJournal log("p");
    int calls = 0;
    run_campaign(
        log, Cheap(cheap_campaign::problem(11)),
        [&](const Design& x) {
          TrialResult r = cheap(x);
          if (++calls == 3) r.errors = {0.1, bad};
          return r;
        },
        unwatched);
    const auto state = state_of(log, 11);
    CHECK(state.optimizer().trials()[2].state == Trial::State::failed);
    CHECK_THAT(state.optimizer().trials()[2].why, Catch::Contains("standard error"));
    CHECK(state.optimizer().observed() == 11);
  }
}

TEST_CASE("Outputs that no optimiser takes are a failure of the design, and the store goes on") {
  const double nan = std::nan("");
  for (const auto& outputs : std::vector<std::vector<double>>{{1.0, nan}, {1.0}, {1.0, 2.0, 3.0}, {1e200, 1.0}}) {
    const TemporaryFolder folder;
    SqliteStore log(folder / "store", "p");
    int calls = 0;
    const auto once_bad = [&](const Design& x) {
      return ++calls == 3 ? TrialResult{outputs, false, "", "what was there", ""} : cheap(x);
    };
    std::string seen;
    CHECK(run_campaign(log, Cheap(cheap_campaign::problem(12)), once_bad,
              [&](const auto&, int, const TrialResult& v) { seen += v.why; }) == OptimizerStatus::finished);
    log.verify();
    const auto state = state_of(log, 12);
    const Trial& bad = state.optimizer().trials()[2];
    CHECK(bad.state == Trial::State::failed);
    CHECK_FALSE(bad.retry);
    CHECK_THAT(bad.why, Catch::Contains("objective: trial 2 has "));
    CHECK(bad.why == seen);
    CHECK(log.record(*state.answered(2)) == "what was there");
    CHECK(calls == 13);
  }
}

TEST_CASE("A campaign that the machine's failures stopped goes on where they have ended") {
  MemoryJournal log("p");
  const auto no_memory = [](const Design&) { return TrialResult{{}, true, "mesh: out of memory", "", ""}; };
  for (int run = 1; run <= 6; ++run) {  // ten designs use up their tries
    CHECK_THROWS_WITH(run_campaign(log, Cheap(cheap_campaign::problem(12)), no_memory, unwatched),
        Catch::Contains("5 of 5 evaluations failed"));
    CHECK(log.entries().size() == std::size_t(1 + 2 * 5 * run));
  }
  CHECK(run_campaign(log, Cheap(cheap_campaign::problem(12)), cheap, unwatched) == OptimizerStatus::finished);
  CHECK(state_of(log, 12).optimizer().observed() == 12);
}

namespace {

/// A log into which another process writes the answer to a trial just before this one's claim succeeds: it has ended
/// since.
struct OvertakenJournal : MemoryJournal {
  using MemoryJournal::MemoryJournal;
  bool answered = false;
  bool claim(std::int64_t number) {
    if (!std::exchange(answered, true))
      append([](const auto&) { return std::optional(tell_entry(0, cheap_campaign::outputs({1.0, 1.0, 1.0}))); });
    return MemoryJournal::claim(number);
  }
};

}  // namespace

TEST_CASE("What another process answered in the meantime is neither evaluated again nor watched") {
  std::map<Design, int> attempts;
  std::set<int> watched;
  const auto counted = [&](const Design& x) { return ++attempts[x], cheap(x); };
  const auto watch = [&](const auto&, int id, const TrialResult&) { CHECK(watched.insert(id).second); };
  OvertakenJournal log("p");
  log.append([](const auto&) { return std::optional(ask_entry(0, {1.0, 1.0, 1.0})); });
  run_campaign(log, Cheap(cheap_campaign::problem(12)), counted, watch);
  CHECK(attempts.count({1.0, 1.0, 1.0}) == 0);
  CHECK(watched.count(0) == 0);
  CHECK(watched.size() == 11);

  MemoryJournal slow("p");  // the answer comes while the design is evaluated
  watched.clear();
  const auto overtaken = [&](const Design& x) {
    if (x == Design{1.0, 1.0, 1.0})
      slow.append([&](const auto&) { return std::optional(tell_entry(0, cheap_campaign::outputs(x))); });
    return cheap(x);
  };
  run_campaign(slow, Cheap(cheap_campaign::problem(12)), overtaken, watch);
  CHECK(watched.count(0) == 0);
  CHECK(watched.size() == 11);
}

TEST_CASE("Entries that no campaign wrote are refused") {
  for (const auto& entry : std::vector<std::pair<std::string, std::string>>{{"ask", "0 1 1"}, {"tell", "0 1 1"},
           {"fail", "0 maybe x"}, {"fail", "x final y"}, {"problem", "0 1"}, {"ask", "7 1 1 1"}, {"ask", "0 1 1 nan"},
           {"ask", "-1 1 1 1"}, {"ask", ""}}) {
    MemoryJournal log("p");
    log.append([&](const auto&) {
      return std::optional(JournalEntry{0, journal_kind(entry.first).value(), entry.second, "", ""});
    });
    INFO(entry.first << ' ' << entry.second);
    CHECK_THROWS_AS(state_of(log, 20), StoreError);
  }
}

namespace {

/// Kills a campaign of 160 evaluations at random moments until it has ended, or there were `kills`; returns how many
/// kills it took.
int kill_and_resume(const std::string& store, const std::string& journal, int kills, std::mt19937& random) {
  std::uniform_real_distribution<double> moment(0.0, 0.2);
  for (int killed = 0;; ++killed) {
    const pid_t pid = start_child([&] {
      SqliteStore log(store, "p");
      run_campaign(
          log, Cheap(cheap_campaign::problem(160)),
          [&](const Design& x) {
            std::ofstream(journal, std::ios::app) << x[0] << ' ' << x[1] << ' ' << x[2] << std::endl;
            return cheap(x);
          },
          unwatched);
    });
    if (killed < kills) {
      std::this_thread::sleep_for(std::chrono::duration<double>(moment(random)));
      kill(pid, SIGKILL);
    }
    int status = 0;
    waitpid(pid, &status, 0);
    if (WIFEXITED(status)) {
      REQUIRE(WEXITSTATUS(status) == 0);
      return killed;
    }
  }
}

void killed_campaigns(int kills) {
  const TemporaryFolder folder;
  SqliteStore whole(folder / "whole", "p");
  run_campaign(whole, Cheap(cheap_campaign::problem(160)), cheap, unwatched);
  std::mt19937 random(11);
  for (int n = 0, run = 0; n < kills; ++run) {
    const std::string store = folder / ("store" + std::to_string(run)),
                      journal = folder / ("journal" + std::to_string(run));
    const int here = kill_and_resume(store, journal, kills - n, random);
    n += here;
    const SqliteStore log(store);
    log.verify();
    CHECK(log.digest() == whole.digest());
    const auto state = state_of(log, 160);
    CHECK(state.optimizer().observed() == 160);
    std::ifstream in(journal);
    std::multiset<std::string> evaluated;
    for (std::string line; std::getline(in, line);) evaluated.insert(line);
    CHECK(int(evaluated.size()) <= 160 + here);  // a kill costs at most the evaluation that it hit
  }
}

}  // namespace

TEST_CASE("200 kills at random moments: nothing lost, nothing twice, the same log to the bit") {
  killed_campaigns(200);
}

TEST_CASE("1000 kills at random moments", "[long]") { killed_campaigns(1000); }

TEST_CASE("Three processes on one store, of which some are killed: each design once") {
  const TemporaryFolder folder;
  const std::string store = folder / "store", journal = folder / "journal";
  { SqliteStore log(store, "p"); }
  const auto start = [&] {
    return start_child([&] {
      SqliteStore log(store, "p");
      CampaignConfig config;
      config.poll_s = 0.01;
      run_campaign(
          log, Cheap(cheap_campaign::problem(40)),
          [&](const Design& x) {
            std::ofstream(journal, std::ios::app) << ask_entry(int(getpid()), x).content + '\n';  // in one write
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
            return cheap(x);
          },
          unwatched, config);
    });
  };
  std::vector<pid_t> workers = {start(), start(), start()};
  std::mt19937 random(5);
  std::set<pid_t> killed;
  for (int k = 0; k < 6; ++k) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100 + random() % 100));
    pid_t& victim = workers[random() % 3];
    kill(victim, SIGKILL);
    int status = 0;
    waitpid(victim, &status, 0);
    if (WIFSIGNALED(status)) killed.insert(victim);
    victim = start();
  }
  for (const pid_t pid : workers) {
    int status = 0;
    waitpid(pid, &status, 0);
    CHECK(WIFEXITED(status));
    CHECK(WEXITSTATUS(status) == 0);
  }
  const SqliteStore log(store);
  log.verify();
  const auto state = state_of(log, 40);
  CHECK(state.optimizer().observed() == 40);
  CHECK(state.optimizer().pending() == 0);
  std::set<Design> designs;
  for (const Trial& t : state.optimizer().trials()) designs.insert(t.x);
  CHECK(designs.size() == state.optimizer().trials().size());
  // A second evaluation of a design is due to a kill that hit the first.
  std::ifstream in(journal);
  std::map<std::string, std::vector<pid_t>> evaluated;
  std::size_t wasted = 0;
  for (std::string line; std::getline(in, line);)
    evaluated[line.substr(line.find(' '))].push_back(pid_t(std::stol(line)));
  CHECK(evaluated.size() == 40);
  for (const auto& [design, processes] : evaluated) {
    for (std::size_t k = 0; k + 1 < processes.size(); ++k) CHECK(killed.contains(processes[k]));
    wasted += processes.size() - 1;
  }
  CHECK(wasted <= killed.size());
}
