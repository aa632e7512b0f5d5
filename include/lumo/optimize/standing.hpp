#pragma once

#include "lumo/model/surrogate.hpp"
#include "lumo/optimize/acquisition.hpp"
#include "lumo/optimize/directed_hypervolume.hpp"
#include "lumo/optimize/hypervolume.hpp"
#include "lumo/optimize/log_nehvi.hpp"
#include "lumo/optimize/trials.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace lumo {

/// Outputs, of `outputs`, that objective `j` is made of.
template <Reduction R> std::vector<Eigen::Index> outputs_of(const R& reduction, int outputs, int j) {
  std::vector<Eigen::Index> rows;
  for (int k = 0; k < outputs; ++k)
    if (reduction.objective(k) == j) rows.push_back(k);
  return rows;
}

/// Objectives (objectives × n), larger is better, of outputs (outputs × n) in their own sense.
template <Reduction R> Eigen::MatrixXd objectives_of(const R& reduction, const Problem& problem, Eigen::MatrixXd y) {
  for (Eigen::Index k = 0; k < y.rows(); ++k)
    y.row(k) *= problem.objectives[std::size_t(reduction.objective(int(k)))].signed_value(1.0);
  return y.cols() ? Eigen::MatrixXd(reduction.objectives(y))
                  : Eigen::MatrixXd(Eigen::Index(problem.objectives.size()), 0);
}

/// The designs that no other dominates, from the best in the first objective on, and what they are worth. Where there
/// is noise (Problem::noise), values are the models' means; else they are those that were reported, as those of
/// outliers always are. Known results inside the space count if they stand (KnownResult).
struct Standing {
  std::vector<Outcome> front;
  double hypervolume = 0.0;                ///< that the front dominates above the reference point
  double low = 0.0, high = 0.0;            ///< its central 90 % interval; equal to it where it is exact
  std::vector<std::string> modelled = {};  ///< objectives whose values are the models' means
};

/// Designs inside the space with what is believed of their outputs.
template <CovarianceKernel Kernel, Reduction R> class Beliefs {
 public:
  /// `models` and `evidence` as those of Optimizer, made of the results `inliers`; no models: reported values stand.
  /// Trials and models are referred to.
  Beliefs(const Trials& trials, R reduction, const std::vector<GaussianProcess<Kernel>>& models,
      const Evidence& evidence, const std::vector<Eigen::Index>& inliers)
      : trials_(&trials), reduction_(std::move(reduction)), models_(&models) {
    const Trials::Results r = trials.results();
    find_noise(r);
    std::vector<Eigen::Index> kept;
    std::set<Design> seen;
    for (std::size_t i = 0; i < r.ids.size(); ++i) {
      const auto column = r.x.col(Eigen::Index(i));
      const Design x(column.data(), column.data() + column.size());
      if (trials.stands(r.ids[i], x) && (!any_noise() || seen.insert(x).second)) kept.push_back(Eigen::Index(i));
    }
    for (const Eigen::Index i : kept) {
      ids_.push_back(r.ids[std::size_t(i)]);
      known_to_models_.push_back(std::binary_search(inliers.begin(), inliers.end(), i));
    }
    x_ = r.x(Eigen::all, kept);
    outputs_ = r.outputs(Eigen::all, kept);
    if (any_noise()) {
      find_scale(r.outputs(Eigen::all, inliers), evidence.outputs);
      believe_models();
    }
    objectives_ = objectives_of(reduction_, problem(), outputs_);
  }

  /// Of the designs: ids of their trials, −1 − k for the known result k. Several evaluations of a design with noise
  /// count once.
  const std::vector<int>& ids() const { return ids_; }
  const Eigen::MatrixXd& designs() const { return x_; }
  bool any_noise() const { return std::find(noisy_.begin(), noisy_.end(), true) != noisy_.end(); }
  /// Do the models know the design? They do not know outliers.
  bool modelled(std::size_t design) const { return known_to_models_[design]; }

  /// Every design with its objectives in their own units and sense. Deviations are there where objectives are single
  /// outputs and one is noisy; of a reported value 0.
  std::vector<Outcome> outcomes() const {
    std::vector<Outcome> out;
    for (Eigen::Index i = 0; i < objectives_.cols(); ++i) out.push_back(outcome(i));
    if (!any_noise() || !reduction_.identity()) return out;
    for (Eigen::Index j = 0; j < objectives_.rows(); ++j) {
      Eigen::VectorXd deviations = Eigen::VectorXd::Zero(x_.cols());
      if (noisy_[std::size_t(j)])
        deviations = scale_[j] * (*models_)[std::size_t(j)].predict(x_).variance.array().max(0.0).sqrt().matrix();
      for (std::size_t i = 0; i < out.size(); ++i)
        out[i].deviations.push_back(modelled(i) ? deviations[Eigen::Index(i)] : 0.0);
    }
    return out;
  }

  Standing standing() const {
    Standing out;
    for (std::size_t j = 0; j < noisy_.size(); ++j)
      if (noisy_[j]) out.modelled.push_back(problem().objectives[j].name);
    const std::vector<Eigen::Index> front = pareto_front(objectives_);
    for (const Eigen::Index i : front) out.front.push_back(outcome(i));
    const HypervolumeEstimate volume = volume_of(objectives_, 512);
    constexpr double of_90_percent = 1.645;
    out.hypervolume = volume.value;
    out.low = volume.value - of_90_percent * volume.error;
    out.high = volume.value + of_90_percent * volume.error;
    if (any_noise() && !front.empty()) put_interval(out, front);
    return out;
  }

 private:
  const Problem& problem() const { return trials_->problem(); }
  const Objective& objective(int j) const { return problem().objectives[std::size_t(j)]; }
  Outcome outcome(Eigen::Index i) const {
    Outcome o{ids_[std::size_t(i)], {}, {}};
    for (Eigen::Index j = 0; j < objectives_.rows(); ++j)
      o.objectives.push_back(objective(int(j)).signed_value(objectives_(j, i)));
    return o;
  }

  // An objective is noisy if that was said of one of its outputs, or the data are e³ times likelier with noise: without
  // any, Branin's and Currin's functions give e⁰, with that of a public tutorial (a fourth of their spread) e²⁰ at
  // least.
  void find_noise(const Trials::Results& r) {
    constexpr double beyond_doubt = 3.0;
    constexpr std::size_t enough = 8;
    noisy_.assign(problem().objectives.size(), false);
    for (std::size_t k = 0; k < models_->size(); ++k) {
      const bool reported = r.errors.cols() > 0 && (r.errors.row(Eigen::Index(k)).array() > 0.0).any();
      if (problem().noise == Noise::present || reported ||
          (r.ids.size() >= enough && (*models_)[k].evidence_of_noise() > beyond_doubt))
        noisy_[std::size_t(reduction_.objective(int(k)))] = true;
    }
  }
  // Unit of the evidence by objective: from the value that lies furthest from its reference.
  void find_scale(const Eigen::MatrixXd& raw, const Eigen::MatrixXd& scaled) {
    scale_.setOnes(Eigen::Index(noisy_.size()));
    Eigen::VectorXd furthest = Eigen::VectorXd::Zero(scale_.size());
    for (Eigen::Index k = 0; k < raw.rows(); ++k)
      for (Eigen::Index i = 0; i < raw.cols(); ++i) {
        const int j = reduction_.objective(int(k));
        if (!(std::abs(scaled(k, i)) > furthest[j])) continue;
        furthest[j] = std::abs(scaled(k, i));
        scale_[j] = std::abs(raw(k, i) - objective(j).reference) / furthest[j];
      }
  }
  // A model's value in the unit and sense of its objective.
  double in_units(double modelled, int j) const {
    return objective(j).reference + objective(j).signed_value(modelled * scale_[j]);
  }
  void believe_models() {
    for (Eigen::Index k = 0; k < outputs_.rows(); ++k) {
      const int j = reduction_.objective(int(k));
      if (!noisy_[std::size_t(j)]) continue;
      const Eigen::VectorXd mean = (*models_)[std::size_t(k)].mean(x_);
      for (Eigen::Index i = 0; i < x_.cols(); ++i)
        if (modelled(std::size_t(i))) outputs_(k, i) = in_units(mean[i], j);
    }
  }
  HypervolumeEstimate volume_of(const Eigen::MatrixXd& y, Eigen::Index directions) const {
    Eigen::VectorXd reference(Eigen::Index(noisy_.size()));
    for (Eigen::Index j = 0; j < reference.size(); ++j)
      reference[j] = objective(int(j)).signed_value(objective(int(j)).reference);
    if (reference.size() <= LogNehvi::exact_objectives) return {lumo::hypervolume(y, reference), 0.0};
    return estimated_hypervolume(y, reference, directions);
  }
  // Joint draws of an output at the designs of a front: designs × draws.
  Eigen::MatrixXd drawn(Eigen::Index k, const std::vector<Eigen::Index>& front, int draws) const {
    Eigen::MatrixXd values = outputs_(k, front).transpose().replicate(1, draws);
    const int j = reduction_.objective(int(k));
    if (!noisy_[std::size_t(j)]) return values;
    const Eigen::MatrixXd normals = base_normals(Eigen::Index(front.size()), draws, combine(23, std::uint64_t(k)));
    const auto sample = (*models_)[std::size_t(k)].sample(x_(Eigen::all, front), normals);
    for (std::size_t i = 0; i < front.size() && sample; ++i)
      if (modelled(std::size_t(front[i])))
        for (int s = 0; s < draws; ++s) values(Eigen::Index(i), s) = in_units((*sample)(Eigen::Index(i), s), j);
    return values;
  }
  void put_interval(Standing& out, const std::vector<Eigen::Index>& front) const {
    constexpr int draws = 256, tail = draws / 20;
    constexpr Eigen::Index directions_of_draw = 32;
    std::vector<Eigen::MatrixXd> outputs;
    for (Eigen::Index k = 0; k < outputs_.rows(); ++k) outputs.push_back(drawn(k, front, draws));
    Eigen::MatrixXd y(outputs_.rows(), Eigen::Index(front.size())),
        squares = Eigen::MatrixXd::Zero(objectives_.rows(), y.cols());
    std::vector<double> volumes;
    for (int s = 0; s < draws; ++s) {
      for (Eigen::Index k = 0; k < y.rows(); ++k) y.row(k) = outputs[std::size_t(k)].col(s).transpose();
      const Eigen::MatrixXd drawn_objectives = objectives_of(reduction_, problem(), y);
      squares += (drawn_objectives - objectives_(Eigen::all, front)).cwiseAbs2() / draws;
      volumes.push_back(volume_of(drawn_objectives, directions_of_draw).value);
    }
    std::sort(volumes.begin(), volumes.end());
    out.low = std::min(out.hypervolume, volumes[tail]);
    out.high = std::max(out.hypervolume, volumes[draws - 1 - tail]);
    for (std::size_t i = 0; i < front.size(); ++i)
      for (Eigen::Index j = 0; j < squares.rows(); ++j)
        out.front[i].deviations.push_back(std::sqrt(squares(j, Eigen::Index(i))));
  }

  const Trials* trials_;
  R reduction_;
  const std::vector<GaussianProcess<Kernel>>* models_;
  std::vector<bool> noisy_;  ///< by objective
  std::vector<int> ids_;
  std::vector<bool> known_to_models_;  ///< by design
  Eigen::MatrixXd x_, outputs_;        ///< outputs in their own unit and sense
  Eigen::MatrixXd objectives_;         ///< larger is better
  Eigen::VectorXd scale_;              ///< by objective: unit of the evidence
};

}  // namespace lumo
