// What it costs to share a campaign: claims, workers that sleep, designs under way, and a simulation of wall times.
//
// usage: lumo_campaign claims ADDRESS SESSIONS SECONDS        claims and answers a second, by so many sessions at once
//        lumo_campaign sleep ADDRESS WORKERS PENDING SECONDS ROUNDS   share of the ideal with workers that sleep
//        lumo_campaign work STORE EVALUATIONS PENDING SECONDS         one worker: of mpirun, of a scheduler, by hand
//        lumo_campaign pending PENDING SEEDS                  hypervolume at 40 evaluations beside the sequential one
//        lumo_campaign simulate MEDIAN SPREAD PROPOSAL        wall times of 160 evaluations of 28 contacts [s]
// ADDRESS: of a PostgreSQL database, each time in a new schema. Prints one JSON object a line.
#include "campaign/cheap_campaign.hpp"

#include "lumo/core/stopwatch.hpp"
#include "lumo/support/postgres.hpp"
#include "lumo/support/sqlite.hpp"

#include <sys/wait.h>
#include <unistd.h>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <queue>
#include <random>
#include <string>
#include <utility>
#include <vector>

namespace {

using namespace lumo;

std::string in_new_schema(const std::string& address) {
  return address + (address.find('?') == std::string::npos ? '?' : '&') + "schema=bench_" + std::to_string(getpid()) +
         '_' + std::to_string(steady_ns() % 1000000007);
}

/// Runs `work(k)` in so many processes at once; false if one of them failed.
bool in_processes(int count, const std::function<void(int)>& work) {
  std::vector<pid_t> children;
  for (int k = 0; k < count; ++k) {
    const pid_t pid = fork();
    if (pid == 0) {
      try {
        work(k);
        _exit(0);
      } catch (const std::exception& e) {
        std::fprintf(stderr, "%s\n", e.what());
        _exit(1);
      }
    }
    children.push_back(pid);
  }
  bool good = true;
  for (const pid_t pid : children) {
    int status = 0;
    waitpid(pid, &status, 0);
    good = good && WIFEXITED(status) && WEXITSTATUS(status) == 0;
  }
  return good;
}

/// A search whose proposals cost nothing: a grid of designs that are known beforehand.
Problem known_designs(int evaluations) {
  Problem p = cheap_campaign::problem(evaluations);
  p.sobol = evaluations;
  return p;
}

int claims(const std::string& address, int sessions, double seconds) {
  const std::string store = in_new_schema(address);
  {
    PostgresStore made(store, "p");
    for (int k = 0; k < 4 * sessions; ++k)
      made.append([&](const auto&) { return std::optional(ask_entry(k, {double(k)})); });
  }
  int counts[2];
  if (pipe(counts) != 0) return 1;
  const bool good = in_processes(sessions, [&](int) {
    PostgresStore mine(store, "p");
    std::vector<std::int64_t> numbers;
    for (int k = 0; k < 4 * sessions; ++k) numbers.push_back(k + 1);
    int count = 0;
    for (const Stopwatch watch; watch.seconds() < seconds; ++count)
      if (const auto number = mine.claim_first(numbers)) mine.release(*number);
      else throw Error("no entry was free");
    if (write(counts[1], &count, sizeof count) != sizeof count) throw Error("cannot write");
  });
  int all = 0;
  for (int k = 0, count = 0; good && k < sessions; ++k, all += count)
    if (read(counts[0], &count, sizeof count) != sizeof count) return 1;
  std::printf("{\"sessions\": %d, \"claims_per_s\": %.1f, \"ms_per_claim\": %.3f}\n", sessions, all / seconds,
      1e3 * sessions * seconds / all);
  return good ? 0 : 1;
}

int sleeping(const std::string& address, int workers, int pending, double seconds, int rounds) {
  const std::string store = in_new_schema(address);
  const int evaluations = workers * rounds;
  { const PostgresStore made(store, "p"); }
  CampaignConfig config;
  config.pending = pending;
  const Stopwatch watch;
  const bool good = in_processes(workers, [&](int k) {
    PostgresStore mine(store, "p");
    std::mt19937_64 random(static_cast<unsigned>(k));
    run_campaign(
        mine, cheap_campaign::Search(known_designs(evaluations)),
        [&](const Design& x) {
          pause_for(seconds * (0.8 + 0.4 * double(random() % 1000) / 1000.0));
          return TrialResult{cheap_campaign::outputs(x), false, "", std::string(4000, 'r'), ""};
        },
        cheap_campaign::Watch([](const auto&, int, const TrialResult&) {}), config);
  });
  const double ideal = seconds * rounds, taken = watch.seconds();
  std::printf(
      "{\"workers\": %d, \"pending\": %d, \"seconds\": %.2f, \"evaluations\": %d, \"wall_s\": %.2f, "
      "\"efficiency\": %.3f}\n",
      workers, pending, seconds, evaluations, taken, ideal / taken);
  return good ? 0 : 1;
}

int work(const std::string& place, int evaluations, int pending, double seconds) {
  std::mt19937_64 random(static_cast<unsigned>(getpid()));
  int own = 0;
  const auto run = [&](auto& store) {
    cheap_campaign::run(store, evaluations, pending, [&](const Design& x) {
      ++own;
      pause_for(seconds * (0.5 + double(random() % 1000) / 1000.0));
      return cheap_campaign::evaluate(x);
    });
    std::printf(
        "{\"process\": %d, \"evaluated\": %d, \"digest\": \"%s\"}\n", int(getpid()), own, store.digest().c_str());
  };
  if (place.starts_with("postgresql://")) {
    PostgresStore store(place, "cheap campaign");
    run(store);
  } else {
    SqliteStore store(place, "cheap campaign");
    run(store);
  }
  return 0;
}

double hypervolume_of(int pending, std::uint64_t seed) {
  MemoryJournal journal("p");
  CampaignConfig config;
  config.pending = pending;
  const cheap_campaign::Search search(cheap_campaign::problem(40, seed));
  run_campaign(
      journal, search,
      [](const Design& x) {
        return TrialResult{cheap_campaign::outputs(x), false, "", "", ""};
      },
      cheap_campaign::Watch([](const auto&, int, const TrialResult&) {}), config);
  CampaignState state(search);
  state.read(journal.entries());
  return state.optimizer().hypervolume();
}

int pending_designs(int pending, int seeds) {
  std::vector<double> shares;
  for (int seed = 1; seed <= seeds; ++seed) {
    const double one = hypervolume_of(1, std::uint64_t(seed)), many = hypervolume_of(pending, std::uint64_t(seed));
    shares.push_back(many / one);
    std::printf("{\"seed\": %d, \"sequential\": %.6f, \"pending_%d\": %.6f, \"share\": %.4f}\n", seed, one, pending,
        many, many / one);
    std::fflush(stdout);
  }
  std::sort(shares.begin(), shares.end());
  double sum = 0.0;
  for (const double s : shares) sum += s;
  std::printf("{\"pending\": %d, \"seeds\": %d, \"mean_share\": %.4f, \"median_share\": %.4f, \"least_share\": %.4f}\n",
      pending, seeds, sum / seeds, shares[shares.size() / 2], shares.front());
  return 0;
}

/// Wall time of a campaign [s]: proposals are made one after the other, each once the answers it waits for are there;
/// a worker takes the next part of the first design that has one.
double wall_time(
    int workers, int pending, bool by_contact, const std::vector<std::vector<double>>& designs, double proposal_s) {
  std::priority_queue<double, std::vector<double>, std::greater<>> free;
  for (int k = 0; k < workers; ++k) free.push(0.0);
  std::vector<double> answered(designs.size());
  double proposed = 0.0, end = 0.0;
  for (std::size_t k = 0; k < designs.size(); ++k) {
    const double known = k < std::size_t(pending) ? 0.0 : answered[k - std::size_t(pending)];
    proposed = std::max(proposed, known) + proposal_s;
    double all = 0.0, done = proposed;
    for (const double t : designs[k]) all += t;
    for (const double t : by_contact ? designs[k] : std::vector<double>{all}) {
      const double finished = std::max(free.top(), proposed) + t;
      free.pop();
      free.push(finished);
      done = std::max(done, finished);
    }
    answered[k] = std::max(k == 0 ? 0.0 : answered[k - 1], done);
    end = std::max(end, done);
  }
  return end;
}

int simulate(double median_s, double spread, double proposal_s) {
  std::mt19937_64 random(1);
  std::lognormal_distribution<double> contact(std::log(median_s), spread);
  std::vector<std::vector<double>> designs(160, std::vector<double>(28));
  for (auto& design : designs)
    for (double& t : design) t = contact(random);
  for (int workers = 1; workers <= 4096; workers *= 2) {
    std::printf("{\"workers\": %d", workers);
    const std::pair<const char*, int> kinds[] = {{"1", 1}, {"8", 8}, {"twice", 2 * workers}};
    for (const auto& [name, pending] : kinds)
      std::printf(", \"design_pending_%s_h\": %.2f, \"contact_pending_%s_h\": %.2f", name,
          wall_time(workers, pending, false, designs, proposal_s) / 3600.0, name,
          wall_time(workers, pending, true, designs, proposal_s) / 3600.0);
    std::printf("}\n");
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> words(argv + 1, argv + argc);
  const auto number = [&](std::size_t k) { return std::atof(words.at(k).c_str()); };
  const auto is = [&](const char* mode, std::size_t count) { return words.size() == count && words[0] == mode; };
  try {
    if (is("claims", 4)) return claims(words[1], int(number(2)), number(3));
    if (is("sleep", 6)) return sleeping(words[1], int(number(2)), int(number(3)), number(4), int(number(5)));
    if (is("work", 5)) return work(words[1], int(number(2)), int(number(3)), number(4));
    if (is("pending", 3)) return pending_designs(int(number(1)), int(number(2)));
    if (is("simulate", 4)) return simulate(number(1), number(2), number(3));
  } catch (const std::exception& e) {
    std::fprintf(stderr, "lumo_campaign: %s\n", e.what());
    return 1;
  }
  std::fprintf(stderr, "usage: lumo_campaign claims|sleep|work|pending|simulate ...: see the head of the source\n");
  return 2;
}
