#pragma once

#include "lumo/model/surrogate.hpp"
#include "lumo/optimize/candidate_source.hpp"
#include "lumo/optimize/log_nehvi.hpp"
#include "lumo/optimize/outliers.hpp"
#include "lumo/optimize/trials.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace lumo {

/// Bayesian optimisation by ask and tell: it never calls an objective. First come the problem's initial designs, then
/// Sobol points, then the candidate of highest acquisition under Gaussian processes of the observed trials, given those
/// still pending. Once a trial has failed for a reason of its design, the acquisition is multiplied by the probability
/// of success. Answers may come in any order. Law: a proposal is a function of the problem, the
/// configuration and the trials before it, to the bit; so whoever keeps the trials can restore() them and go on. No
/// design is asked twice, except after a failure that may be retried.
template <CovarianceKernel Kernel = RbfKernel, class AcquisitionPolicy = LogNehvi,
    CandidateSource Source = LocalSearchCandidates, Reduction R = EachOutput>
requires Acquisition<AcquisitionPolicy, std::vector<GaussianProcess<Kernel>>, R>
class Optimizer {
 public:
  struct Config {
    typename GaussianProcess<Kernel>::Config model = {};
    AcquisitionPolicy acquisition = {};
    Source source = {};
    R reduction = {};  ///< outputs → objectives, after those of an objective that is minimised have changed sign
    OutlierRule outliers = {};
    int retries = 2;  ///< of one design after failures that may be retried
  };

  /// Throws InvalidArgument for a problem that cannot be solved, InfeasibleDesign for an initial design outside the
  /// space.
  explicit Optimizer(Problem problem, Config config = {})
      : config_(std::move(config)),
        trials_(problem, config_.reduction.outputs(int(problem.objectives.size())), config_.retries) {}

  /// The next design to evaluate, now pending; nullopt if there is none: status() states why.
  std::optional<Trial> ask() {
    if (observed() + pending() >= problem().evaluations) return std::nullopt;
    auto x = trials_.scheduled();
    if (!x) x = chosen();
    exhausted_ = !x;
    if (!x) return std::nullopt;
    return trials_.open(int(trials().size()), std::move(*x));
  }

  /// Outputs of a pending trial. Throws InvalidArgument if it is not pending, or the outputs are too few, too many or
  /// not finite.
  void tell(int id, std::vector<double> outputs) { trials_.tell(id, std::move(outputs)); }

  /// A pending trial that failed; with `retry` it may be asked again under a new id. Throws InvalidArgument if it is
  /// not pending.
  void fail(int id, bool retry, std::string why) {
    trials_.fail(id, retry, std::move(why));
    exhausted_ = exhausted_ && !retry;
  }

  /// Takes over the next trial of an earlier run, pending; tell() or fail() follow. Throws InvalidArgument or
  /// InfeasibleDesign if it cannot have been asked.
  void restore(int id, Design x) { trials_.open(id, std::move(x)); }

  OptimizerStatus status() const {
    if (observed() >= problem().evaluations) return OptimizerStatus::finished;
    if (observed() + pending() >= problem().evaluations) return OptimizerStatus::waiting;
    if (exhausted_) return pending() > 0 ? OptimizerStatus::waiting : OptimizerStatus::exhausted;
    return OptimizerStatus::running;
  }

  const Problem& problem() const { return trials_.problem(); }
  const std::vector<Trial>& trials() const { return trials_.trials(); }  ///< by id
  int observed() const { return trials_.count(Trial::State::observed); }
  int pending() const { return trials_.count(Trial::State::pending); }

  /// Observed trials that no other dominates, from the best in the first objective on. An outlier counts with its
  /// own value.
  std::vector<Outcome> front() const {
    const std::vector<int> ids = trials_.observed_ids();
    const Eigen::MatrixXd y = objectives();
    std::vector<Outcome> out;
    for (const Eigen::Index i : pareto_front(y)) {
      out.push_back({ids[std::size_t(i)], {}});
      for (Eigen::Index j = 0; j < y.rows(); ++j)
        out.back().objectives.push_back(problem().objectives[std::size_t(j)].signed_value(y(j, i)));
    }
    return out;
  }

  /// A value that lies absurdly far from the others of its objective. The models of values do without its trial; to the
  /// model of success one that is worse than the others is a failure.
  struct Outlier {
    int id = 0, output = 0;
    double value = 0.0;
    bool better = false;
    double low = 0.0, high = 0.0;  ///< between which the others lie
  };
  /// By trial. Whether a value is an outlier may change with those that follow.
  std::vector<Outlier> outliers() const {
    const std::vector<int> ids = trials_.observed_ids();
    const Eigen::MatrixXd outputs = trials_.observed_outputs();
    std::vector<Outlier> out;
    for (int j = 0; j < int(problem().objectives.size()); ++j) {
      const std::vector<Eigen::Index> rows = rows_of(j);
      const Eigen::MatrixXd y = objective(j).signed_value(1.0) * outputs(rows, Eigen::all);
      const ValueBulk bulk({y.data(), y.data() + y.size()}, trials_.observed_starts() * rows.size(), config_.outliers);
      for (Eigen::Index i = 0; i < y.cols(); ++i)
        for (Eigen::Index k = 0; k < y.rows(); ++k) {
          if (!bulk.worse(y(k, i)) && !bulk.better(y(k, i))) continue;
          const double first = objective(j).signed_value(bulk.low()), last = objective(j).signed_value(bulk.high());
          out.push_back({ids[std::size_t(i)], int(rows[std::size_t(k)]), objective(j).signed_value(y(k, i)),
              bulk.better(y(k, i)), std::min(first, last), std::max(first, last)});
        }
    }
    std::stable_sort(out.begin(), out.end(), [](const Outlier& a, const Outlier& b) { return a.id < b.id; });
    return out;
  }

  /// Volume that the front dominates above the reference point, in the product of the objectives' units.
  double hypervolume() const {
    Eigen::VectorXd reference(Eigen::Index(problem().objectives.size()));
    for (Eigen::Index j = 0; j < reference.size(); ++j)
      reference[j] = objective(int(j)).signed_value(objective(int(j)).reference);
    return lumo::hypervolume(objectives(), reference);
  }

  /// Models of the observed outputs as they are in evidence(). Empty before two trials are observed.
  const std::vector<GaussianProcess<Kernel>>& models() {
    if (observed() < 2 || modelled_ == observed()) return models_;
    const Evidence e = evidence();
    models_.clear();
    for (Eigen::Index k = 0; k < e.outputs.rows(); ++k)
      models_.push_back(
          GaussianProcess<Kernel>::fit({e.x, e.outputs.row(k).transpose(), e.lower, e.upper}, config_.model));
    modelled_ = observed();
    return models_;
  }

  /// Observed and pending trials as models and acquisition see them: without outliers, outputs less their reference,
  /// larger is better, in units of the spread of their objective.
  Evidence evidence() const {
    Evidence e;
    const std::vector<Eigen::Index> kept = inliers();
    e.x = trials_.designs(Trial::State::observed)(Eigen::all, kept);
    e.pending = trials_.designs(Trial::State::pending);
    e.outputs = trials_.observed_outputs()(Eigen::all, kept);
    for (int j = 0; j < int(problem().objectives.size()); ++j) {
      const std::vector<Eigen::Index> rows = rows_of(j);
      Eigen::ArrayXXd y =
          objective(j).signed_value(1.0) * (e.outputs(rows, Eigen::all).array() - objective(j).reference);
      const double largest = y.size() ? y.abs().maxCoeff() : 0.0;  // so that squares neither overflow nor vanish
      if (largest > 0.0) {
        y /= largest;
        const double spread = std::sqrt((y - y.mean()).square().mean());
        if (spread > 1e-14) y /= spread;
      }
      e.outputs(rows, Eigen::all) = y.matrix();
    }
    const auto& variables = problem().space.variables;
    e.lower.resize(Eigen::Index(variables.size()));
    e.upper.resize(Eigen::Index(variables.size()));
    for (std::size_t i = 0; i < variables.size(); ++i) {
      e.lower[Eigen::Index(i)] = variables[i].lower;
      e.upper[Eigen::Index(i)] = variables[i].upper;
    }
    e.reference = Eigen::VectorXd::Zero(Eigen::Index(problem().objectives.size()));
    return e;
  }

 private:
  const Objective& objective(int j) const { return problem().objectives[std::size_t(j)]; }

  /// Outputs that an objective is made of.
  std::vector<Eigen::Index> rows_of(int j) const {
    std::vector<Eigen::Index> rows;
    for (int k = 0; k < trials_.outputs(); ++k)
      if (config_.reduction.objective(k) == j) rows.push_back(k);
    return rows;
  }
  /// Observed trials without outliers, as columns of the observed ones.
  std::vector<Eigen::Index> inliers() const {
    std::set<int> absurd;
    for (const Outlier& o : outliers()) absurd.insert(o.id);
    const std::vector<int> ids = trials_.observed_ids();
    std::vector<Eigen::Index> kept;
    for (std::size_t i = 0; i < ids.size(); ++i)
      if (!absurd.contains(ids[i])) kept.push_back(Eigen::Index(i));
    return kept;
  }

  /// Objectives of the observed trials (objectives × n) in their units, larger is better.
  Eigen::MatrixXd objectives() const {
    Eigen::MatrixXd y = trials_.observed_outputs();
    for (Eigen::Index k = 0; k < y.rows(); ++k)
      y.row(k) *= objective(config_.reduction.objective(int(k))).signed_value(1.0);
    return y.cols() ? Eigen::MatrixXd(config_.reduction.objectives(y))
                    : Eigen::MatrixXd(Eigen::Index(problem().objectives.size()), 0);
  }

  /// Model of the success of evaluations; nullopt if none has failed for a reason of its design, or given a value that
  /// is absurdly bad.
  std::optional<SuccessModel<Kernel>> success(const Evidence& e) const {
    Eigen::MatrixXd failed = trials_.designs(Trial::State::failed);
    std::set<int> absurd;
    for (const Outlier& o : outliers())
      if (!o.better) absurd.insert(o.id);
    for (const int id : absurd) {
      failed.conservativeResize(Eigen::NoChange, failed.cols() + 1);
      failed.rightCols(1) = Eigen::Map<const Eigen::VectorXd>(trials()[std::size_t(id)].x.data(), failed.rows());
    }
    if (failed.cols() == 0) return std::nullopt;
    return SuccessModel<Kernel>(e.x, failed, e.lower, e.upper, config_.model);
  }

  /// The candidate of highest acquisition; a fresh design while there is too little for a model.
  std::optional<Design> chosen() {
    const std::uint64_t key = combine(combine(problem().seed, 1), trials().size());
    if (models().empty()) {
      auto fresh = trials_.sampler().fresh(1, key, trials_.taken());
      return fresh.empty() ? std::nullopt : std::optional(std::move(fresh.front()));
    }
    const std::vector<int> ids = trials_.observed_ids();
    const std::vector<Eigen::Index> kept = inliers();
    std::vector<Design> standing;
    for (const Eigen::Index i : pareto_front(Eigen::MatrixXd(objectives()(Eigen::all, kept))))
      standing.push_back(trials()[std::size_t(ids[std::size_t(kept[std::size_t(i)])])].x);
    const Evidence e = evidence();
    const auto utility = config_.acquisition.prepare(models_, config_.reduction, e, combine(key, 1));
    const CandidateRequest request{trials_.sampler(), trials_.taken(), standing, combine(key, 2)};
    const auto model = success(e);
    if (!model) return config_.source.best(request, utility);
    return config_.source.best(
        request, [&](const Eigen::MatrixXd& x) -> Eigen::VectorXd { return model->expected(utility(x), x); });
  }

  Config config_;
  Trials trials_;
  bool exhausted_ = false;
  std::vector<GaussianProcess<Kernel>> models_;
  int modelled_ = 0;  ///< observed trials that the models know
};

}  // namespace lumo
