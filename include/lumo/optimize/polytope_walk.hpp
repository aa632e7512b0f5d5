#pragma once

#include "lumo/core/design_space.hpp"
#include "lumo/core/sobol.hpp"
#include "lumo/model/normal.hpp"
#include "lumo/optimize/problem.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace lumo {

/// Random walk over the feasible designs of a space that random points hardly ever hit. Each move goes to a uniformly
/// random place of the feasible part of a line, so that designs become uniform over the space, wherever the walk began.
/// Lines run along an axis, along a pair of axes so that one constraint keeps its sum, or in any direction of the
/// continuous variables. Source: Smith, "Efficient Monte Carlo Procedures for Generating Points Uniformly Distributed
/// over Bounded Regions", Oper. Res. 32 (1984).
class PolytopeWalk {
 public:
  /// Refers to the space.
  explicit PolytopeWalk(const DesignSpace& space) : space_(space) {
    for (std::size_t i = 0; i < space.variables.size(); ++i)
      if (space.variables[i].step == 0.0) continuous_.push_back(i);
  }

  /// The design after `moves` moves from a feasible one; `shifted(i, value, by)` is the variable's value after a
  /// change, on its lattice if it has one.
  template <class Shifted> Design after(Design x, int moves, std::uint64_t key, const Shifted& shifted) const {
    for (int k = 0; k < moves; ++k) {
      const std::uint64_t draw = combine(key, std::uint64_t(k));
      const Line line = random_line(draw);
      const auto [low, high] = feasible(line, x);
      if (!(low <= high)) continue;
      const double u = uniform(combine(draw, 1)),
                   t = line.whole ? std::min(low + std::floor(u * (high - low + 1.0)), high) : low + u * (high - low);
      Design y = x;
      for (const auto& [i, by] : line.steps) y[i] = shifted(i, x[i], t * by);
      if (space_.contains(y)) x = std::move(y);
    }
    return x;
  }
  /// Moves that make a design nearly independent of the one before, and ten times as many of one at an edge.
  int between() const { return 10 * int(space_.variables.size()); }

 private:
  struct Line {
    std::vector<std::pair<std::size_t, double>> steps;  ///< variables, and their changes per unit
    bool whole = false;                                 ///< whole units only
  };

  double unit(std::size_t i) const {
    const Variable& v = space_.variables[i];
    return v.step > 0.0 ? v.step : v.upper - v.lower;
  }
  Line random_line(std::uint64_t key) const {
    const auto pick = [&](std::uint64_t label, std::size_t count) {
      return std::size_t(uniform(combine(key, label)) * double(count));
    };
    const std::size_t kinds = continuous_.size() > 1 ? 3 : 2, kind = pick(2, kinds);
    const LinearConstraint* face =
        space_.constraints.empty() ? nullptr : &space_.constraints[pick(3, space_.constraints.size())];
    if (kind == 2) return direction(key, uniform(combine(key, 4)) < 0.5 ? nullptr : face);
    const std::size_t i = pick(5, space_.variables.size());
    if (kind == 0 || !face || face->coefficients[i] == 0.0) return {{{i, unit(i)}}, space_.variables[i].step > 0.0};
    return along(*face, i, pick(6, space_.variables.size()));
  }
  /// Changes two variables so that the sum of a constraint stays as it is.
  Line along(const LinearConstraint& face, std::size_t i, std::size_t k) const {
    if (k == i || face.coefficients[k] == 0.0) return {{{i, unit(i)}}, space_.variables[i].step > 0.0};
    const double ratio = -face.coefficients[i] / face.coefficients[k];
    const bool i_whole = space_.variables[i].step > 0.0, k_whole = space_.variables[k].step > 0.0;
    if (!k_whole) return {{{i, unit(i)}, {k, ratio * unit(i)}}, i_whole};
    if (!i_whole) return {{{i, unit(k) / ratio}, {k, unit(k)}}, true};
    constexpr double most_steps = 16.0;
    for (double steps = 1.0; steps <= most_steps; ++steps) {
      const double other = ratio * steps * unit(i) / unit(k);
      if (std::abs(other) > 0.5 && std::abs(other - std::round(other)) < 1e-9 * std::abs(other))
        return {{{i, steps * unit(i)}, {k, std::round(other) * unit(k)}}, true};
    }
    return {{{i, unit(i)}}, true};
  }
  /// Any direction of the continuous variables, or any in which a constraint keeps its sum.
  Line direction(std::uint64_t key, const LinearConstraint* face) const {
    Line line;
    double rate = 0.0, size = 0.0;  // variables count by their range
    for (std::size_t i : continuous_) {
      line.steps.emplace_back(i, normal_quantile(uniform(combine(combine(key, 7), i))) * unit(i));
      const double c = face ? face->coefficients[i] : 0.0;
      rate += c * line.steps.back().second;
      size += c * c * unit(i) * unit(i);
    }
    if (face && size > 0.0)
      for (auto& [i, by] : line.steps) by -= rate / size * face->coefficients[i] * unit(i) * unit(i);
    return line;
  }
  /// Between which units a line from a design stays within bounds and linear constraints; the first above the second:
  /// nowhere.
  std::pair<double, double> feasible(const Line& line, const Design& x) const {
    double low = -std::numeric_limits<double>::infinity(), high = -low;
    const auto limit = [&](double rate, double below, double above) {
      if (rate < 0.0) std::swap(below, above);
      low = std::max(low, below / rate);
      high = std::min(high, above / rate);
    };
    for (const auto& [i, by] : line.steps)
      if (by != 0.0) limit(by, space_.variables[i].lower - x[i], space_.variables[i].upper - x[i]);
    for (const LinearConstraint& c : space_.constraints) {
      double rate = 0.0, size = 0.0;
      for (const auto& [i, by] : line.steps) {
        rate += c.coefficients[i] * by;
        size += std::abs(c.coefficients[i] * by);
      }
      if (std::abs(rate) <= 1e-12 * size) continue;
      const double sum = c.sum(x);
      limit(rate, c.lower - sum, c.upper - sum);
    }
    if (!std::isfinite(low) || !std::isfinite(high)) return {1.0, 0.0};
    constexpr double rounding = 1e-9;
    return line.whole ? std::pair{std::ceil(low - rounding), std::floor(high + rounding)} : std::pair{low, high};
  }

  const DesignSpace& space_;
  std::vector<std::size_t> continuous_;
};

}  // namespace lumo
