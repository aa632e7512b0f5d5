#include "asking/space.hpp"
#include "asking/transcript.hpp"
#include "commands/commands.hpp"
#include "console/text.hpp"
#include "store/campaign_problem.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iostream>
#include <limits>
#include <optional>
#include <set>
#include <utility>

namespace lumo::program {

namespace {

void send(const Json& message) {
  std::cout << message.dump() << std::endl;
  if (!std::cout) throw InputError("cannot write to standard output");
}

/// Values as the space file would have them: whole numbers on a lattice of whole numbers.
Json typed(const Design& x, const DesignSpace& space) {
  Json values = Json::array();
  for (std::size_t i = 0; i < x.size(); ++i) {
    const Variable& v = space.variables[i];
    constexpr double largest = 9e15;  // beyond, not every whole number is a double
    const bool whole = v.step > 0.0 && v.step == std::floor(v.step) && v.origin == std::floor(v.origin) &&
                       std::abs(x[i]) < largest && x[i] == std::floor(x[i]);
    values.push_back(whole ? Json(std::int64_t(x[i])) : Json(x[i]));
  }
  return values;
}

Json ask_event(const Trial& trial, const DesignSpace& space) {
  return {{"ask", {{"id", trial.id}, {"x", typed(trial.x, space)}}}};
}

int whole(const Json& object, const char* key) {
  if (!object.contains(key) || !object[key].is_number_integer())
    throw InvalidArgument(std::string("needs a whole number \"") + key + "\"");
  const auto value = object[key].get<std::int64_t>();
  if (value < 0 || value > std::numeric_limits<int>::max())
    throw InvalidArgument(lumo::message("trial ", value, " was never asked"));
  return int(value);
}

std::vector<double> numbers(const Json& object, const char* key) {
  if (!object.contains(key) || !object[key].is_array())
    throw InvalidArgument(std::string("needs a list of numbers \"") + key + "\"");
  std::vector<double> out;
  for (const Json& v : object[key]) {
    if (!v.is_number())
      throw InvalidArgument(std::string("has ") + v.dump(-1, ' ', true, Json::error_handler_t::replace) + " in \"" +
                            key + "\", must be a finite number");
    out.push_back(v.get<double>());
  }
  return out;
}

void only(const Json& object, const char* what, std::initializer_list<const char*> known) {
  if (!object.is_object()) throw InvalidArgument(std::string(what) + " must be an object {...}");
  for (const auto& [key, value] : object.items())
    if (std::none_of(known.begin(), known.end(), [&k = key](const char* name) { return k == name; }))
      throw InvalidArgument(
          std::string(what) + " has an unknown key " + Json(key).dump(-1, ' ', true, Json::error_handler_t::replace));
}

/// Applies a tell or fail, from standard input or from a transcript, and returns it as it is kept. Throws
/// InvalidArgument, and changes nothing then.
template <class Optimizer> Json answer(Optimizer& optimizer, const Json& message) {
  only(message, "answer", {"tell", "fail"});
  if (message.size() != 1) throw InvalidArgument("answer must be {\"tell\": ...} or {\"fail\": ...}");
  if (message.contains("tell")) {
    const Json& tell = message["tell"];
    only(tell, "tell", {"id", "y", "y_err"});
    optimizer.tell(
        whole(tell, "id"), numbers(tell, "y"), tell.contains("y_err") ? numbers(tell, "y_err") : std::vector<double>{});
    const Trial& reported = optimizer.trials()[tell["id"].template get<std::size_t>()];
    Json kept = {{"id", tell["id"]}, {"y", reported.outputs}};
    if (!reported.errors.empty()) kept["y_err"] = reported.errors;
    return {{"tell", kept}};
  }
  const Json& fail = message["fail"];
  only(fail, "fail", {"id", "retry", "why"});
  const int id = whole(fail, "id");
  if (fail.contains("retry") && !fail["retry"].is_boolean())
    throw InvalidArgument("fail has a \"retry\" that is neither true nor false");
  if (fail.contains("why") && !fail["why"].is_string()) throw InvalidArgument("fail has a \"why\" that is no text");
  const bool retry = fail.value("retry", false);
  const std::string why = fail.value("why", std::string());
  optimizer.fail(id, retry, why);
  return {{"fail", {{"id", id}, {"retry", retry}, {"why", why}}}};
}

template <class Optimizer> void replay(Optimizer& optimizer, const Transcript& transcript, const std::string& path) {
  for (const auto& event : transcript.events()) try {
      if (event.content.contains("ask"))
        optimizer.restore(whole(event.content["ask"], "id"), numbers(event.content["ask"], "x"));
      else answer(optimizer, event.content);
    } catch (const Error& e) {
      throw InputError(lumo::message("transcript '", path, "' line ", event.line, ": ", one_line(e.what())));
    }
}

void note(const std::string& text) { std::cerr << "lumo: " << text << std::endl; }

/// Names each value that is an outlier, once.
template <class Optimizer> void name_outliers(const Optimizer& optimizer, std::set<std::pair<int, int>>& named) {
  for (const auto& o : optimizer.outliers())
    if (named.emplace(o.id, o.output).second)
      note(lumo::message(o.id < 0 ? "known result " : "trial ", o.id < 0 ? -1 - o.id : o.id, ": ",
          one_line(optimizer.problem().objectives[std::size_t(o.output)].name), " = ", o.value,
          " is an outlier: the other values lie from ", o.low, " to ", o.high, "; the search takes it ",
          o.better ? "as not evaluated" : "for a failure"));
}

/// Why failures end the search; empty while they do not.
template <class Optimizer>
std::string too_many_failures(const Optimizer& optimizer, double share, const std::set<int>& own) {
  const FailureLimit limit{.above = share};
  for (const FailureTally& tally : {design_failures(optimizer.trials()), machine_failures(optimizer.trials(), own)})
    if (limit.exceeded(tally)) return "search stops: " + limit.reason(tally, optimizer.trials());
  return "";
}

template <class Optimizer> void send_front(const Optimizer& optimizer) {
  const Problem& p = optimizer.problem();
  const auto standing = optimizer.standing();
  Json front = Json::array();
  for (const Outcome& o : standing.front) {
    Json one = {
        {"x", typed(o.id < 0 ? p.known[std::size_t(-1 - o.id)].x : optimizer.trials()[std::size_t(o.id)].x, p.space)},
        {"y", o.objectives}};
    if (!o.deviations.empty()) one["y_err"] = o.deviations;
    if (o.id < 0) one["known"] = -1 - o.id;
    front.push_back(std::move(one));
  }
  Json last = {{"front", front}, {"hypervolume", standing.hypervolume}};
  if (standing.low != standing.high) last["interval_90"] = {standing.low, standing.high};
  last["values"] = values_words(standing.modelled);
  send(last);
}

/// Says which initial designs no search would have asked.
void name_designs_outside(const Problem& p) {
  for (std::size_t i = 0; i < p.initial.size(); ++i) try {
      p.space.check(p.initial[i]);
    } catch (const InfeasibleDesign& e) {
      note(lumo::message(
          "initial[", i, "] is asked as it is, and counts in no front unless it lies inside: ", e.what()));
    }
}

template <class Optimizer> void ask_and_tell(Optimizer& optimizer, const std::string& path, const SpaceFile& space) {
  std::optional<Transcript> transcript;
  if (!path.empty()) {
    transcript.emplace(path, space.whole);
    if (!transcript->change().empty()) note("'" + path + "' goes on with a change: " + transcript->change());
    replay(optimizer, *transcript, path);
  }
  const auto keep = [&](const Json& event) {
    if (transcript) transcript->append(event);
  };
  const std::string resumable = path.empty() ? "" : "; transcript '" + path + "' holds all answers";

  std::vector<Trial> open;  // asked before an interruption
  for (const Trial& t : optimizer.trials())
    if (t.state == Trial::State::pending) open.push_back(t);
  std::size_t reopened = 0, number = 0;
  std::set<std::pair<int, int>> named;
  std::set<int> own;  // trials that were answered from standard input
  std::string end;
  while (true) {
    name_outliers(optimizer, named);
    if (end = too_many_failures(optimizer, space.failures, own); !end.empty()) break;
    std::optional<Trial> trial;
    if (reopened < open.size() && optimizer.observed() < optimizer.problem().evaluations) trial = open[reopened++];
    else if ((trial = optimizer.ask())) keep(ask_event(*trial, optimizer.problem().space));
    if (!trial) break;
    send(ask_event(*trial, optimizer.problem().space));

    std::string line;
    do {
      if (!std::getline(std::cin, line))
        throw InputError(lumo::message("standard input ended after ", number, " lines, with ", optimizer.observed(),
            " of ", optimizer.problem().evaluations, " evaluations answered and trial ", trial->id, " not answered",
            resumable));
      ++number;
    } while (line.find_first_not_of(" \t\r") == std::string::npos);
    try {
      keep(answer(optimizer, parse_strictly(line)));
      own.insert(trial->id);
    } catch (const InvalidArgument& e) {
      throw InputError(lumo::message("standard input line ", number, ": ", one_line(e.what()), resumable));
    }
  }
  if (optimizer.status() == OptimizerStatus::exhausted)
    note(lumo::message("every feasible design that can be found has been asked, with ", optimizer.observed(), " of ",
        optimizer.problem().evaluations, " evaluations answered"));
  send_front(optimizer);
  if (!end.empty()) throw NumericalError(end);
}

struct Optimize : Common {
  std::string space, transcript, known;

  void declare(CLI::App& app) {
    add_text(app, "--space", space, "FILE", "Variables, constraints, objectives and budget (JSON)")->required();
    add_text(app, "--known", known, "FILE",
        "Earlier results (CSV: variables, objectives, perhaps <objective>_err), which the models know from the start");
    add_text(app, "--transcript", transcript, "FILE",
        "Keeps all that is asked and answered; continues from it where it exists");
  }
  Result run(Output&, Progress&) const {
    const SpaceFile file = read_space(space, known);
    name_designs_outside(file.problem);
    with_optimizer(file.problem, file.source, [&](auto optimizer) { ask_and_tell(optimizer, transcript, file); });
    return std::string();
  }
};

}  // namespace

void add_optimize(CommandLine& line) {
  line.add<Optimize>("optimize", "Optimise any objectives by ask and tell: JSON lines on standard output and input");
}

}  // namespace lumo::program
