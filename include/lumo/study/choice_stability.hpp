#pragma once

#include "lumo/core/executor.hpp"
#include "lumo/objective/selection.hpp"
#include "lumo/optimize/optimizer.hpp"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace lumo {

/// Searches of one model by different seeds.
struct SeedStudy {
  int seeds = 1;        ///< 1, 2, …
  int evaluations = 1;  ///< of each search
};

/// The choice of a search with each seed, if the objectives were the posterior means of Gaussian processes of the
/// observed trials and their errors: how much of the choice is the search's luck. Both objectives are maximised,
/// reference (0, 0). `make_optimizer(problem)` gives a fresh optimiser; `watch()` is called after each search, from any
/// thread. nullopt for a search that found no choice. Throws InvalidArgument for fewer than two observed trials.
template <class MakeOptimizer, Executor E, class Watch>
std::vector<std::optional<Design>> choices_over_seeds(const Problem& problem, const std::vector<Trial>& trials,
    const SeedStudy& study, const MakeOptimizer& make_optimizer, const E& executor, const Watch& watch) {
  std::vector<const Trial*> observed;
  for (const Trial& t : trials)
    if (t.state == Trial::State::observed) observed.push_back(&t);
  if (observed.size() < 2)
    throw InvalidArgument(message("a model of the results needs at least 2 observed trials, has ", observed.size()));

  const auto n = Eigen::Index(observed.size()), d = Eigen::Index(problem.space.variables.size());
  TrainingData data{Eigen::MatrixXd(d, n), Eigen::VectorXd(n), Eigen::VectorXd(d), Eigen::VectorXd(d)};
  for (Eigen::Index i = 0; i < d; ++i) {
    data.lower[i] = problem.space.variables[std::size_t(i)].lower;
    data.upper[i] = problem.space.variables[std::size_t(i)].upper;
  }
  const bool errors = problem.noise != Noise::none && std::any_of(observed.begin(), observed.end(), [](const Trial* t) {
    return std::any_of(t->errors.begin(), t->errors.end(), [](double e) { return e > 0.0; });
  });
  std::vector<GaussianProcess<>> models;
  for (std::size_t k = 0; k < problem.objectives.size(); ++k) {
    if (errors) data.errors.setZero(n);
    for (Eigen::Index j = 0; j < n; ++j) {
      const Trial& t = *observed[std::size_t(j)];
      data.x.col(j) = Eigen::Map<const Eigen::VectorXd>(t.x.data(), d);
      data.y[j] = t.outputs[k];
      if (errors && !t.errors.empty()) data.errors[j] = t.errors[k];
    }
    models.push_back(GaussianProcess<>::fit(data));
  }

  std::vector<std::optional<Design>> choices(std::size_t(study.seeds), std::nullopt);
  executor.for_each(choices.size(), [&](std::size_t s) {
    Problem searched = problem;
    searched.seed = std::uint64_t(s) + 1;
    searched.evaluations = study.evaluations;
    auto optimizer = make_optimizer(searched);
    std::vector<std::pair<double, double>> found;
    while (const std::optional<Trial> trial = optimizer.ask()) {
      const Eigen::MatrixXd x = Eigen::Map<const Eigen::VectorXd>(trial->x.data(), d);
      found.emplace_back(models[0].mean(x)[0], models[1].mean(x)[0]);
      optimizer.tell(trial->id, {found.back().first, found.back().second});
    }
    if (const auto best = balanced_choice(found)) choices[s] = optimizer.trials()[*best].x;
    watch();
  });
  return choices;
}

}  // namespace lumo
