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
    for (const KnownResult& k : problem_.known) {
      check_outputs("known result", k.outputs, k.errors);
      if (problem_.space.contains(k.x)) taken_.insert(sampler_.canonical(k.x));
    }
    known_ = taken_.size();
    DesignSet planned = taken_;
    for (const Design& x : problem_.initial)
      if (planned.insert(as_asked(x)).second) starts_.push_back(as_asked(x));
    for (Design& x : sampler_.fresh(std::size_t(problem_.sobol), combine(problem_.seed, 0), planned))
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
  /// All results that there are, as columns: known ones (ids −1, −2, …), then the observed trials by id.
  struct Results {
    std::vector<int> ids;
    Eigen::MatrixXd x;        ///< d × n
    Eigen::MatrixXd outputs;  ///< outputs × n, in their own units and sense
    Eigen::MatrixXd
        errors;  ///< outputs × n: standard errors, 0 where none was reported; empty where none was reported at all
  };
  Results results() const {
    const auto d = Eigen::Index(sampler_.dimensions());
    const Eigen::Index n = Eigen::Index(problem_.known.size()) + count(Trial::State::observed);
    Results r{{}, Eigen::MatrixXd(d, n), Eigen::MatrixXd(outputs_, n), Eigen::MatrixXd::Zero(outputs_, n)};
    const auto add = [&](int id, const Design& x, const std::vector<double>& outputs, const std::vector<double>& e) {
      const auto i = Eigen::Index(r.ids.size());
      r.ids.push_back(id);
      r.x.col(i) = Eigen::Map<const Eigen::VectorXd>(x.data(), d);
      r.outputs.col(i) = Eigen::Map<const Eigen::VectorXd>(outputs.data(), outputs_);
      if (!e.empty()) r.errors.col(i) = Eigen::Map<const Eigen::VectorXd>(e.data(), outputs_);
    };
    for (std::size_t k = 0; k < problem_.known.size(); ++k)
      add(-1 - int(k), problem_.known[k].x, problem_.known[k].outputs, problem_.known[k].errors);
    for (const Trial& t : trials_)
      if (t.state == Trial::State::observed) add(t.id, t.x, t.outputs, t.errors);
    if ((r.errors.array() == 0.0).all()) r.errors.resize(0, 0);
    return r;
  }
  /// Does the front count the result of this design?
  bool stands(int id, const Design& x) const {
    return problem_.space.encloses(x) && (id >= 0 || problem_.known[std::size_t(-1 - id)].stands);
  }
  /// Results before the first that a model chose.
  std::size_t result_starts() const {
    std::size_t count = problem_.known.size();
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
    if (taken_.size() - known_ >= starts_.size()) return std::nullopt;
    for (const Design& x : starts_)
      if (!taken_.contains(x)) return x;
    return std::nullopt;
  }
  /// Adds a pending trial. Throws InvalidArgument or InfeasibleDesign if it cannot have been asked.
  const Trial& open(int id, std::type_identity_t<Design> x) {
    if (id != int(trials_.size()))
      throw InvalidArgument(
          message("trial has id ", id, ", must have ", trials_.size(), ", the number of trials before it"));
    x = as_asked(std::move(x));
    int before = 0;
    for (const Trial& t : trials_) {
      if (t.x != x || (t.state == Trial::State::failed && t.retry)) continue;
      if (++before >= problem_.repeats || t.state == Trial::State::failed)
        throw InvalidArgument(message("trial ", id, " repeats the design of trial ", t.id));
    }
    taken_.insert(x);
    trials_.push_back({id, std::move(x), Trial::State::pending, {}, {}, false, {}});
    return trials_.back();
  }
  /// Trials of a design that were answered, or are pending; failures of the machine do not count.
  int evaluations(const Design& x) const {
    return int(std::count_if(trials_.begin(), trials_.end(),
        [&](const Trial& t) { return t.x == x && !(t.state == Trial::State::failed && t.retry); }));
  }
  /// Throw InvalidArgument if the trial is not pending, or the outputs are too few, too many or not finite; so for
  /// their standard errors, unless there are none.
  void tell(int id, std::vector<double> outputs, std::vector<double> errors = {}) {
    Trial& trial = pending(id);
    check_outputs(message("trial ", id), outputs, errors);
    trial.outputs = std::move(outputs);
    trial.errors = std::move(errors);
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

 private:
  void check_outputs(const std::string& whose, const std::vector<double>& y, const std::vector<double>& errors) const {
    if (int(y.size()) != outputs_)
      throw InvalidArgument(message(whose, " has ", y.size(), " values, must have ", outputs_));
    if (!errors.empty() && int(errors.size()) != outputs_)
      throw InvalidArgument(message(whose, " has ", errors.size(), " standard errors, must have ", outputs_));
    for (const double v : y)
      if (!(std::abs(v) <= largest_output))
        throw InvalidArgument(message(whose, " has a value of ", v, ", must be a finite number within +-1e150"));
    for (const double e : errors)
      if (!(e >= 0.0 && e <= largest_output))
        throw InvalidArgument(message(whose, " has a standard error of ", e, ", must lie in [0, 1e150]"));
  }
  /// An initial design may be wherever it was said to be; throws as DesignSpace::check() for all others.
  Design as_asked(Design x) const {
    if (problem_.initial_anywhere && !problem_.space.contains(x) &&
        std::find(problem_.initial.begin(), problem_.initial.end(), x) != problem_.initial.end())
      return x;
    problem_.space.check(x);
    return sampler_.canonical(std::move(x));
  }
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
  DesignSet taken_;        ///< asked, and known on the lattice
  std::size_t known_ = 0;  ///< of them
};

}  // namespace lumo
