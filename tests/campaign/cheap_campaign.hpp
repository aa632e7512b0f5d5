#pragma once

#include "lumo/campaign/campaign.hpp"

#include <cmath>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace lumo {

// Slow to compile: once for all, in cheap_campaign.cpp.
extern template class GaussianProcess<>;
extern template class Optimizer<RbfKernel, LogNehvi, FreshCandidates>;
extern template class CampaignState<Optimizer<RbfKernel, LogNehvi, FreshCandidates>>;

}  // namespace lumo

/// A search in closed form: two objectives on a lattice of three variables under one constraint.
namespace cheap_campaign {

using Search = lumo::Optimizer<lumo::RbfKernel, lumo::LogNehvi, lumo::FreshCandidates>;
using Evaluate = std::function<lumo::TrialResult(const lumo::Design&)>;
using Watch = std::function<void(const lumo::CampaignState<Search>&, int, const lumo::TrialResult&)>;

inline lumo::Problem problem(int evaluations, std::uint64_t seed = 3) {
  lumo::Problem p;
  p.space.variables = {{"a", 0.0, 10.0, 0.5, ""}, {"b", 0.0, 10.0, 0.5, ""}, {"c", 1.0, 6.0, 0.5, ""}};
  p.space.constraints = {{.name = "a + b", .coefficients = {1.0, 1.0, 0.0}, .upper = 12.0, .unit = ""}};
  p.objectives = {{"f", true, 0.0}, {"g", true, 0.0}};
  p.initial = {{1.0, 1.0, 1.0}, {5.0, 5.0, 3.0}};
  p.evaluations = evaluations;
  p.seed = seed;
  return p;
}

inline std::vector<double> outputs(const lumo::Design& x) {
  return {std::exp(-0.05 * ((x[0] - 7.0) * (x[0] - 7.0) + (x[1] - 3.0) * (x[1] - 3.0))) + 0.1 * x[2],
      std::exp(-0.05 * ((x[0] - 2.0) * (x[0] - 2.0) + (x[1] - 8.0) * (x[1] - 8.0))) + 1.0 / x[2]};
}

/// Some of its designs fail.
inline lumo::TrialResult evaluate(const lumo::Design& x) {
  if (std::lround(2.0 * x[0] + 6.0 * x[1]) % 11 == 4) return {{}, false, "press: inverted, no UTF-8: \xff", "r", "n"};
  return {outputs(x), false, "", std::string(500, 'r') + std::string("\0\xff", 2), "took some time"};
}

/// The search in a store, with so many designs under way.
template <lumo::Store S>
void run(S& store, int evaluations, std::optional<int> pending, const Evaluate& evaluate, const Watch& watch = {}) {
  lumo::CampaignConfig config;
  config.poll_s = 0.02;
  config.pending = pending;
  const Watch seen = watch ? watch : Watch([](const auto&, int, const lumo::TrialResult&) {});
  lumo::run_campaign(store, Search(problem(evaluations)), evaluate, seen, config);
}

}  // namespace cheap_campaign
