#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/sobol.hpp"
#include "lumo/model/normal.hpp"
#include "lumo/model/surrogate.hpp"

#include <Eigen/Core>

#include <concepts>
#include <cstdint>
#include <vector>

namespace lumo {

/// Utility of a design: prepared once on models and evidence, then called with candidates (d × n) for its logarithm
/// (n). Laws: a pure function of its arguments; larger is better; −∞ or finite, never NaN; conditioned on observed and
/// pending designs.
template <class A, class Models, class R>
concept Acquisition = requires(const A& acquisition, const Models& models, const R& reduction, const Evidence& evidence,
    std::uint64_t seed, const Eigen::MatrixXd& x) {
  { acquisition.prepare(models, reduction, evidence, seed)(x) } -> std::convertible_to<Eigen::VectorXd>;
};

/// Standard normal numbers, points × draws: each row is an Owen-scrambled Sobol dimension, so that every point sees
/// evenly spread draws. Blocks of 32 dimensions are scrambled independently. Row `point` does not depend on the number
/// of rows. Throws InvalidArgument for negative numbers or more than a million.
inline Eigen::MatrixXd base_normals(Eigen::Index points, Eigen::Index draws, std::uint64_t seed) {
  require_in_range("points of base draws", double(points), 0.0, 1e6, "");
  require_in_range("base draws", double(draws), 0.0, 1e6, "");
  Eigen::MatrixXd z(points, draws);
  for (Eigen::Index i = 0; i < points; ++i) {
    const OwenSobol sequence{combine(seed, std::uint64_t(i / Sobol::dimensions))};
    for (Eigen::Index s = 0; s < draws; ++s)
      z(i, s) = normal_quantile(sequence(std::uint32_t(s), int(i % Sobol::dimensions)));
  }
  return z;
}

/// Points of the base draws: observed designs (if they are noisy) and pending ones.
inline Eigen::MatrixXd base_points(const Evidence& evidence, bool noisy) {
  if (!noisy) return evidence.pending;
  Eigen::MatrixXd base(evidence.x.rows(), evidence.x.cols() + evidence.pending.cols());
  base << evidence.x, evidence.pending;
  return base;
}

/// Objectives that stand in draw `s`: the drawn ones, and the observed ones unless they are drawn, too.
template <Reduction R> Eigen::MatrixXd standing_objectives(const std::vector<Eigen::MatrixXd>& draws, Eigen::Index s,
    const R& reduction, const Evidence& evidence, bool noisy) {
  const Eigen::Index observed = noisy ? 0 : evidence.outputs.cols(), drawn = draws.front().rows();
  Eigen::MatrixXd outputs(Eigen::Index(draws.size()), observed + drawn);
  if (observed > 0) outputs.leftCols(observed) = evidence.outputs;
  for (std::size_t j = 0; j < draws.size(); ++j) outputs.row(Eigen::Index(j)).tail(drawn) = draws[j].col(s).transpose();
  if (outputs.cols() == 0) return Eigen::MatrixXd(evidence.reference.size(), 0);
  return reduction.objectives(outputs);
}

}  // namespace lumo
