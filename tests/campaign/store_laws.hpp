#pragma once

#include "campaign/cheap_campaign.hpp"
#include "campaign/store_test.hpp"
#include "catch.hpp"
#include "lumo/campaign/campaign.hpp"

#include <sys/wait.h>
#include <chrono>
#include <csignal>
#include <random>
#include <string>
#include <thread>
#include <vector>

/// What every Store must do. A place has `open(name, problem)` and `read(name)`, which give a store of its kind.
namespace store_laws {

inline lumo::JournalEntry entry(std::size_t k) {
  return {std::int64_t(k), lumo::JournalEntry::Kind::tell, "x = " + std::to_string(k * k) + '\n',
      std::string(700, char('a' + k % 26)) + std::string("\0\xff\\'\"$1", 7), "took \xc3 s"};
}

template <class S> void fill(S& store, std::size_t count) {
  while (store.append([&](const std::vector<lumo::JournalEntry>& list) -> std::optional<lumo::JournalEntry> {
    if (list.size() > count) return std::nullopt;
    return entry(list.size());
  })) {
  }
}

inline void wait_for_success(pid_t pid) {
  int status = 1;
  ::waitpid(pid, &status, 0);
  CHECK(WIFEXITED(status));
  CHECK(WEXITSTATUS(status) == 0);
}

/// Any bytes come back, in order; the digests are those of a store in a file.
template <class Place> void keeps_entries(const Place& place) {
  const std::string problem = "a problem\nwith two lines";
  std::string whole;
  {
    auto store = place.open("entries", problem);
    fill(store, 5);
    whole = store.digest();
  }
  auto again = place.open("entries", problem);
  const auto list = again.entries();
  REQUIRE(list.size() == 6);
  CHECK(list[0].kind == lumo::JournalEntry::Kind::problem);
  CHECK(list[0].content == problem);
  for (std::size_t k = 1; k < list.size(); ++k) {
    CHECK(list[k].number == std::int64_t(k));
    CHECK(list[k].kind == entry(k).kind);
    CHECK(list[k].content == entry(k).content);
    CHECK(list[k].notes == entry(k).notes);
    CHECK(list[k].record.empty());
    CHECK(again.record(std::int64_t(k)) == entry(k).record);
  }
  CHECK(again.digest(5) == whole);
  CHECK(whole == "a29742d9a4090fa53c2dc2fd6114897d");  // of any kind of store
  again.verify();
  CHECK_THROWS_AS(again.record(6), lumo::StoreError);
  fill(again, 7);
  const auto reader = place.read("entries");
  CHECK(reader.entries().size() == 8);
  fill(again, 9);
  CHECK(reader.entries().size() == 10);  // sees what others append
  CHECK(reader.digest() == again.digest());
}

template <class Place> void refuses_another_problem(const Place& place) {
  { const auto store = place.open("problem", "{\n \"seed\": 1,\n \"b\": 2}"); }
  try {
    const auto store = place.open("problem", "{\n \"seed\": 2,\n \"b\": 2}");
    FAIL("opened");
  } catch (const lumo::StoreError& e) {
    CHECK(e.reason() == lumo::StoreError::Reason::different);
    CHECK_THAT(e.what(), Catch::Contains("it has \"seed\": 1, asked for is \"seed\": 2"));
  }
  CHECK_THROWS_AS(place.read("nowhere"), lumo::StoreError);
}

template <class Place> void keeps_deliveries(const Place& place) {
  auto store = place.open("deliveries", "p");
  fill(store, 3);
  CHECK(store.delivered().empty());
  CHECK_FALSE(store.delivery(2));
  lumo::JournalEntry answer = entry(40);
  CHECK(store.deliver(2, answer));
  CHECK_FALSE(store.deliver(2, entry(41)));  // the first one stands
  CHECK(store.deliver(1, entry(42)));
  const auto reader = place.read("deliveries");
  CHECK(reader.delivered() == std::vector<std::int64_t>{1, 2});
  const auto kept = reader.delivery(2);
  REQUIRE(kept);
  CHECK(kept->kind == answer.kind);
  CHECK(kept->content == answer.content);
  CHECK(kept->record == answer.record);
  CHECK(kept->notes == answer.notes);
  CHECK(reader.entries().size() == 4);
  reader.verify();
  store.append([&](const auto&) { return kept; });
  CHECK(reader.delivered() == std::vector<std::int64_t>{1});
  CHECK(reader.entries().size() == 5);
  CHECK(reader.record(4) == answer.record);
  CHECK_FALSE(store.deliver(2, answer));  // too late
  CHECK(reader.delivered() == std::vector<std::int64_t>{1});
}

template <class Place> void claims_end_with_their_worker(const Place& place) {
  {
    auto store = place.open("claims", "p");
    fill(store, 6);
  }
  int ready[2];
  REQUIRE(::pipe(ready) == 0);
  const pid_t other = start_child([&] {
    auto store = place.open("claims", "p");
    if (store.claim_first({2, 3}) != 2 || store.claim_first({2, 4}) != 2 || !store.claim(4)) throw lumo::Error("claim");
    store.release(4);
    if (::write(ready[1], "x", 1) != 1) throw lumo::Error("write");
    while (true) ::pause();
  });
  char byte = 0;
  REQUIRE(::read(ready[0], &byte, 1) == 1);
  auto store = place.open("claims", "p");
  CHECK_FALSE(store.claim(2));
  CHECK(store.claim_first({2, 3}) == 3);
  CHECK(store.claim(3));  // its own
  CHECK(store.claim_first({2}) == std::nullopt);
  CHECK(store.claim(4));  // given back
  std::vector<std::int64_t> numbers;
  for (const lumo::Claim& c : store.claims()) {
    numbers.push_back(c.number);
    CHECK_FALSE(c.node.empty());
    CHECK(c.process == std::to_string(c.number == 2 ? other : ::getpid()));
  }
  CHECK(numbers == std::vector<std::int64_t>{2, 3, 4});
  ::kill(other, SIGKILL);
  ::waitpid(other, nullptr, 0);
  for (int k = 0; k < 500 && !store.claim(2); ++k) ::usleep(10'000);  // a server has to notice
  CHECK(store.claim(2));
}

template <class Place> void several_processes_append_once(const Place& place) {
  { const auto store = place.open("several", "p"); }
  std::vector<pid_t> children;
  for (int k = 0; k < 3; ++k)
    children.push_back(start_child([&] {
      auto store = place.open("several", "p");
      fill(store, 40);
    }));
  for (const pid_t pid : children) wait_for_success(pid);
  const auto store = place.read("several");
  CHECK(store.entries().size() == 41);
  store.verify();
}

/// Workers that look for work at once all find some while there is enough.
template <class Place> void claims_do_not_fail_for_others(const Place& place) {
  std::vector<std::int64_t> numbers;
  {
    auto store = place.open("crowd", "p");
    fill(store, 12);
    for (std::int64_t k = 1; k <= 12; ++k) numbers.push_back(k);
  }
  std::vector<pid_t> children;
  for (int k = 0; k < 4; ++k)
    children.push_back(start_child([&] {
      auto store = place.open("crowd", "p");
      for (int n = 0; n < 25; ++n) {
        const auto number = store.claim_first(numbers);
        if (!number) throw lumo::Error("no entry was free");
        store.release(*number);
      }
    }));
  for (const pid_t pid : children) wait_for_success(pid);
}

/// A worker in a process of its own, which takes a random time for each design.
template <class Place>
pid_t start_worker(const Place& place, const std::string& name, int evaluations, int pending, unsigned random) {
  return start_child([&place, name, evaluations, pending, random]() mutable {
    auto store = place.open(name, "p");
    std::mt19937 times(random);
    cheap_campaign::run(store, evaluations, pending, [&](const lumo::Design& x) {
      std::this_thread::sleep_for(std::chrono::microseconds(times() % 8000));
      return cheap_campaign::evaluate(x);
    });
  });
}

/// With a number of designs under way the journal is the same for any number of workers, and of one in memory.
template <class Place> void journals_do_not_depend_on_workers(const Place& place) {
  const int evaluations = 16;
  for (const int pending : {1, 5}) {
    lumo::MemoryJournal alone("p");
    cheap_campaign::run(alone, evaluations, pending, cheap_campaign::evaluate);
    const auto expected = alone.entries();
    for (const int workers : {1, 2, 4}) {
      const std::string name = "workers_" + std::to_string(pending) + '_' + std::to_string(workers);
      std::vector<pid_t> children;
      for (int k = 0; k < workers; ++k)
        children.push_back(start_worker(place, name, evaluations, pending, unsigned(10 * workers + k)));
      for (const pid_t pid : children) wait_for_success(pid);
      const auto store = place.read(name);
      store.verify();
      const auto entries = store.entries();
      REQUIRE(entries.size() == expected.size());
      for (std::size_t k = 0; k < entries.size(); ++k) {
        CHECK(entries[k].kind == expected[k].kind);
        CHECK(entries[k].content == expected[k].content);
        CHECK(store.record(std::int64_t(k)) == alone.record(std::int64_t(k)));
      }
      CHECK(store.delivered().empty());
      CHECK(store.claims().empty());
    }
  }
}

}  // namespace store_laws
