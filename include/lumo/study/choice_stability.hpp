#pragma once

#include "lumo/core/executor.hpp"
#include "lumo/objective/selection.hpp"
#include "lumo/optimize/optimizer.hpp"

#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace lumo {

/// What a search of `evaluations` trials would have chosen with each of `seeds` seeds, were the objectives the
/// posterior means of Gaussian processes of the trials told so far: how much of the choice is the search's luck. Both
/// objectives are maximised, reference (0, 0). `make_optimizer(problem)` gives a fresh optimiser; `watch()` is called
/// after each search, from any thread. Empty where a search found nothing to choose. Throws InvalidArgument with fewer
/// than two told trials.
template <class MakeOptimizer, Executor E, class Watch>
std::vector<std::optional<Design>> choices_over_seeds(const Problem& problem, const std::vector<Trial>& trials,
                                                      int seeds, int evaluations, const MakeOptimizer& make_optimizer,
                                                      const E& executor, const Watch& watch) {
  std::vector<const Trial*> told;
  for (const Trial& t : trials)
    if (t.state == Trial::State::observed) told.push_back(&t);
  if (told.size() < 2)
    throw InvalidArgument(message("a model of the results needs at least 2 told trials, has ", told.size()));

  const auto n = Eigen::Index(told.size()), d = Eigen::Index(problem.space.variables.size());
  TrainingData data{Eigen::MatrixXd(d, n), Eigen::VectorXd(n), Eigen::VectorXd(d), Eigen::VectorXd(d)};
  for (Eigen::Index i = 0; i < d; ++i)
    data.lower[i] = problem.space.variables[std::size_t(i)].lower,
    data.upper[i] = problem.space.variables[std::size_t(i)].upper;
  std::vector<GaussianProcess<>> models;
  for (std::size_t k = 0; k < problem.objectives.size(); ++k) {
    for (Eigen::Index j = 0; j < n; ++j) {
      data.x.col(j) = Eigen::Map<const Eigen::VectorXd>(told[std::size_t(j)]->x.data(), d);
      data.y[j] = told[std::size_t(j)]->outputs[k];
    }
    models.push_back(GaussianProcess<>::fit(data));
  }

  std::vector<std::optional<Design>> choices(std::size_t(seeds), std::nullopt);
  executor.for_each(choices.size(), [&](std::size_t s) {
    Problem searched = problem;
    searched.seed = std::uint64_t(s) + 1;
    searched.evaluations = evaluations;
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
