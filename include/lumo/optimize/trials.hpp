#pragma once

#include "lumo/optimize/design_sampler.hpp"
#include "lumo/optimize/hypervolume.hpp"
#include "lumo/optimize/problem.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace lumo {

/// The trials of one optimisation: asked, observed and failed ones, and the next design if no model is needed. All that
/// an optimiser knows is here: restoring the trials restores the optimiser.
class Trials {
 public:
  static constexpr double largest_output = 1e150;  ///< squares do not overflow

  /// `outputs`: values per observed trial. Throws as Problem::validate() and DesignSampler.
  Trials(Problem problem, int outputs, int retries)
      : problem_(std::move(problem)), sampler_(problem_.space), outputs_(outputs), retries_(retries) {
    problem_.validate();
    DesignSet known;
    for (const Design& x : problem_.initial)
      if (known.insert(sampler_.canonical(x)).second) starts_.push_back(sampler_.canonical(x));
    for (Design& x : sampler_.fresh(std::size_t(problem_.sobol), combine(problem_.seed, 0), known))
      starts_.push_back(std::move(x));
  }

  const Problem& problem() const { return problem_; }
  const DesignSampler& sampler() const { return sampler_; }
  const std::vector<Trial>& trials() const { return trials_; }
  const DesignSet& taken() const { return taken_; }
  int count(Trial::State state) const {
    return int(std::count_if(trials_.begin(), trials_.end(), [state](const Trial& t) { return t.state == state; }));
  }

  int outputs() const { return outputs_; }
  std::vector<int> observed_ids() const {
    std::vector<int> ids;
    for (const Trial& t : trials_)
      if (t.state == Trial::State::observed) ids.push_back(t.id);
    return ids;
  }
  /// Observed trials before the first that a model chose.
  std::size_t observed_starts() const {
    std::size_t count = 0;
    for (const Trial& t : trials_) {
      if (std::find(starts_.begin(), starts_.end(), t.x) == starts_.end()) break;
      count += t.state == Trial::State::observed;
    }
    return count;
  }

  /// A failed trial that may be retried, else the next start; nullopt if a model has to choose. With restored trials of
  /// another seed, there are as many starts in all as without.
  std::optional<Design> scheduled() const {
    for (const Trial& t : trials_)
      if (t.state == Trial::State::failed && t.retry && !superseded(t) && tries_left(t)) return t.x;
    if (taken_.size() >= starts_.size()) return std::nullopt;
    for (const Design& x : starts_)
      if (!taken_.contains(x)) return x;
    return std::nullopt;
  }
  /// Adds a pending trial. Throws InvalidArgument or InfeasibleDesign if it cannot have been asked.
  const Trial& open(int id, std::type_identity_t<Design> x) {
    if (id != int(trials_.size()))
      throw InvalidArgument(
          message("trial has id ", id, ", must have ", trials_.size(), ", the number of trials before it"));
    problem_.space.check(x);
    x = sampler_.canonical(std::move(x));
    if (taken_.contains(x))
      for (const Trial& t : trials_)
        if (t.x == x && !(t.state == Trial::State::failed && t.retry))
          throw InvalidArgument(message("trial ", id, " repeats the design of trial ", t.id));
    taken_.insert(x);
    trials_.push_back({id, std::move(x), Trial::State::pending, {}, false, {}});
    return trials_.back();
  }
  /// Throw InvalidArgument if the trial is not pending, or the outputs are too few, too many or not finite.
  void tell(int id, std::vector<double> outputs) {
    Trial& trial = pending(id);
    if (int(outputs.size()) != outputs_)
      throw InvalidArgument(message("trial ", id, " has ", outputs.size(), " values, must have ", outputs_));
    for (const double y : outputs)
      if (!(std::abs(y) <= largest_output))
        throw InvalidArgument(message("trial ", id, " has a value of ", y, ", must be a finite number within +-1e150"));
    trial.outputs = std::move(outputs);
    trial.state = Trial::State::observed;
  }
  void fail(int id, bool retry, std::string why) {
    Trial& trial = pending(id);
    trial.state = Trial::State::failed;
    trial.retry = retry;
    trial.why = std::move(why);
  }

  /// Inputs (d × n) of the trials in a state, by id; failed ones only where the failure lay in the design.
  Eigen::MatrixXd designs(Trial::State state) const {
    Eigen::MatrixXd x(Eigen::Index(sampler_.dimensions()), count(state));
    Eigen::Index column = 0;
    for (const Trial& t : trials_)
      if (t.state == state && !(state == Trial::State::failed && t.retry))
        x.col(column++) = Eigen::Map<const Eigen::VectorXd>(t.x.data(), x.rows());
    return x.leftCols(column);
  }
  /// Outputs of the observed trials (outputs × n) by id, in their own units and sense.
  Eigen::MatrixXd observed_outputs() const {
    Eigen::MatrixXd y(outputs_, count(Trial::State::observed));
    Eigen::Index column = 0;
    for (const Trial& t : trials_)
      if (t.state == Trial::State::observed)
        y.col(column++) = Eigen::Map<const Eigen::VectorXd>(t.outputs.data(), outputs_);
    return y;
  }

 private:
  Trial& pending(int id) {
    if (id < 0 || id >= int(trials_.size())) throw InvalidArgument(message("trial ", id, " was never asked"));
    Trial& trial = trials_[std::size_t(id)];
    if (trial.state == Trial::State::observed) throw InvalidArgument(message("trial ", id, " was answered before"));
    if (trial.state == Trial::State::failed) throw InvalidArgument(message("trial ", id, " failed before"));
    return trial;
  }
  /// Is there a later trial of its design?
  bool superseded(const Trial& trial) const {
    return std::any_of(trials_.begin() + trial.id + 1, trials_.end(), [&](const Trial& t) { return t.x == trial.x; });
  }
  bool tries_left(const Trial& trial) const {
    return std::count_if(trials_.begin(), trials_.end(), [&](const Trial& t) { return t.x == trial.x; }) <= retries_;
  }

  Problem problem_;
  DesignSampler sampler_;
  int outputs_, retries_;
  std::vector<Design> starts_;
  std::vector<Trial> trials_;
  DesignSet taken_;
};

}  // namespace lumo
