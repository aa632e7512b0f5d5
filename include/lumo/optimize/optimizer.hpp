#pragma once

#include "lumo/model/surrogate.hpp"
#include "lumo/optimize/candidate_source.hpp"
#include "lumo/optimize/log_nehvi.hpp"
#include "lumo/optimize/outliers.hpp"
#include "lumo/optimize/repeats.hpp"
#include "lumo/optimize/standing.hpp"
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

  /// Outputs of a pending trial, and their standard errors if they are known. Throws InvalidArgument if it is not
  /// pending, or the numbers are too few, too many or not finite.
  void tell(int id, std::vector<double> outputs, std::vector<double> errors = {}) {
    trials_.tell(id, std::move(outputs), std::move(errors));
  }

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

  /// The designs that no other dominates, and what they are worth.
  Standing standing() const { return beliefs().standing(); }
  std::vector<Outcome> front() const { return standing().front; }
  /// All designs that may stand there, with what is believed of them: known results, then trials by id.
  std::vector<Outcome> believed() const { return beliefs().outcomes(); }
  double hypervolume() const { return standing().hypervolume; }

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
    const Trials::Results r = trials_.results();
    std::vector<Outlier> out;
    for (int j = 0; j < int(problem().objectives.size()); ++j) {
      const std::vector<Eigen::Index> rows = rows_of(j);
      const Eigen::MatrixXd y = objective(j).signed_value(1.0) * r.outputs(rows, Eigen::all);
      const ValueBulk bulk({y.data(), y.data() + y.size()}, trials_.result_starts() * rows.size(), config_.outliers);
      for (Eigen::Index i = 0; i < y.cols(); ++i)
        for (Eigen::Index k = 0; k < y.rows(); ++k) {
          if (!bulk.worse(y(k, i)) && !bulk.better(y(k, i))) continue;
          const double first = objective(j).signed_value(bulk.low()), last = objective(j).signed_value(bulk.high());
          out.push_back({r.ids[std::size_t(i)], int(rows[std::size_t(k)]), objective(j).signed_value(y(k, i)),
              bulk.better(y(k, i)), std::min(first, last), std::max(first, last)});
        }
    }
    std::stable_sort(out.begin(), out.end(), [](const Outlier& a, const Outlier& b) { return a.id < b.id; });
    return out;
  }

  /// Models of the outputs as they are in evidence(). Empty before there are two results.
  const std::vector<GaussianProcess<Kernel>>& models() const {
    const int results = int(problem().known.size()) + observed();
    if (results < 2 || modelled_ == results) return models_;
    const Evidence e = evidence();
    models_.clear();
    for (Eigen::Index k = 0; k < e.outputs.rows(); ++k)
      models_.push_back(GaussianProcess<Kernel>::fit(
          {e.x, e.outputs.row(k).transpose(), e.lower, e.upper,
              e.errors.cols() ? Eigen::VectorXd(e.errors.row(k).transpose()) : Eigen::VectorXd()},
          config_.model));
    modelled_ = results;
    return models_;
  }

  /// Results and pending trials as models see them: without outliers, outputs less their reference, larger is better,
  /// in units of the spread of their objective.
  Evidence evidence() const {
    Evidence e;
    const Trials::Results r = trials_.results();
    const std::vector<Eigen::Index> kept = inliers();
    e.x = r.x(Eigen::all, kept);
    e.pending = trials_.designs(Trial::State::pending);
    e.outputs = r.outputs(Eigen::all, kept);
    if (r.errors.cols() > 0 && problem().noise != Noise::none) e.errors = r.errors(Eigen::all, kept);
    for (int j = 0; j < int(problem().objectives.size()); ++j) {
      const std::vector<Eigen::Index> rows = rows_of(j);
      Eigen::ArrayXXd y =
          objective(j).signed_value(1.0) * (e.outputs(rows, Eigen::all).array() - objective(j).reference);
      const double largest = y.size() ? y.abs().maxCoeff() : 0.0;  // so that squares neither overflow nor vanish
      double spread = 1.0;
      if (largest > 0.0) {
        y /= largest;
        const double deviation = std::sqrt((y - y.mean()).square().mean());
        if (deviation > 1e-14) y /= spread = deviation;
        if (e.errors.cols() > 0) e.errors(rows, Eigen::all) *= 1.0 / largest / spread;
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
  std::vector<Eigen::Index> rows_of(int j) const { return outputs_of(config_.reduction, trials_.outputs(), j); }
  /// Results without outliers, as columns of Trials::results().
  std::vector<Eigen::Index> inliers() const {
    std::set<int> absurd;
    for (const Outlier& o : outliers()) absurd.insert(o.id);
    const std::vector<int> ids = trials_.results().ids;
    std::vector<Eigen::Index> kept;
    for (std::size_t i = 0; i < ids.size(); ++i)
      if (!absurd.contains(ids[i])) kept.push_back(Eigen::Index(i));
    return kept;
  }

  Beliefs<Kernel, R> beliefs() const {
    return {trials_, config_.reduction, problem().noise == Noise::none ? no_models() : models(), evidence(), inliers()};
  }
  static const std::vector<GaussianProcess<Kernel>>& no_models() {
    static const std::vector<GaussianProcess<Kernel>> none;
    return none;
  }

  /// Model of the success of evaluations; nullopt if none has failed for a reason of its design, or given a value that
  /// is absurdly bad.
  std::optional<SuccessModel<Kernel>> success(const Evidence& e) const {
    Eigen::MatrixXd failed = trials_.designs(Trial::State::failed);
    std::set<int> absurd;
    for (const Outlier& o : outliers())
      if (!o.better) absurd.insert(o.id);
    const Trials::Results r = trials_.results();
    for (std::size_t i = 0; i < r.ids.size(); ++i) {
      if (!absurd.contains(r.ids[i])) continue;
      failed.conservativeResize(Eigen::NoChange, failed.cols() + 1);
      failed.rightCols(1) = r.x.col(Eigen::Index(i));
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
    const Trials::Results r = trials_.results();
    std::vector<Eigen::Index> kept;
    for (const Eigen::Index i : inliers())
      if (trials_.stands(r.ids[std::size_t(i)], design(r, i))) kept.push_back(i);
    std::vector<Design> standing;
    for (const Eigen::Index i : pareto_front(objectives_of(config_.reduction, problem(), r.outputs(Eigen::all, kept))))
      if (const Design x = design(r, kept[std::size_t(i)]); problem().space.contains(x)) standing.push_back(x);
    const Evidence known = evidence(), e = inside(known);
    const auto utility = config_.acquisition.prepare(models_, config_.reduction, e, combine(key, 1));
    const CandidateRequest request{trials_.sampler(), trials_.taken(), standing, combine(key, 2)};
    const auto model = success(known);
    const auto score = [&](const Eigen::MatrixXd& x) -> Eigen::VectorXd {
      return model ? model->expected(utility(x), x) : utility(x);
    };
    std::optional<Design> fresh = config_.source.best(request, score);
    if (problem().repeats == 1) return fresh;
    return or_repeated(std::move(fresh), e, score);
  }
  /// The fresh design, or one that is better evaluated again.
  std::optional<Design> or_repeated(std::optional<Design> fresh, const Evidence& e, const Score& score) const {
    const auto b = beliefs();
    if (!b.any_noise() || !config_.reduction.identity() || e.reference.size() > LogNehvi::exact_objectives)
      return fresh;
    std::vector<bool> may;
    for (std::size_t i = 0; i < b.ids().size(); ++i)
      may.push_back(b.modelled(i) && b.ids()[i] >= 0 &&
                    trials_.evaluations(trials()[std::size_t(b.ids()[i])].x) < problem().repeats);
    const auto again = best_repeat(models_, e, b.designs(), may);
    if (!again) return fresh;
    if (fresh && std::log(std::max(again->worth, 1e-300)) <= score(design_columns({*fresh}, fresh->size()))[0])
      return fresh;
    return trials()[std::size_t(b.ids()[std::size_t(again->design)])].x;
  }
  static Design design(const Trials::Results& r, Eigen::Index i) {
    return {r.x.col(i).data(), r.x.col(i).data() + r.x.rows()};
  }
  /// Evidence of designs that may stand in the front: all others inform the models, but nothing has to be better than
  /// they.
  Evidence inside(Evidence e) const {
    const std::vector<int> ids = trials_.results().ids;
    const std::vector<Eigen::Index> columns = inliers();
    std::vector<Eigen::Index> kept;
    for (Eigen::Index i = 0; i < e.x.cols(); ++i)
      if (trials_.stands(
              ids[std::size_t(columns[std::size_t(i)])], Design(e.x.col(i).data(), e.x.col(i).data() + e.x.rows())))
        kept.push_back(i);
    if (Eigen::Index(kept.size()) == e.x.cols()) return e;
    e.x = Eigen::MatrixXd(e.x(Eigen::all, kept));
    e.outputs = Eigen::MatrixXd(e.outputs(Eigen::all, kept));
    if (e.errors.cols() > 0) e.errors = Eigen::MatrixXd(e.errors(Eigen::all, kept));
    return e;
  }

  Config config_;
  Trials trials_;
  bool exhausted_ = false;
  mutable std::vector<GaussianProcess<Kernel>> models_;  // fitted when they are first asked for
  mutable int modelled_ = 0;                             ///< results that the models know
};

}  // namespace lumo
