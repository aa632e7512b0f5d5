#pragma once

#include "lumo/core/sobol.hpp"
#include "lumo/core/types.hpp"
#include "lumo/optimize/polytope_walk.hpp"
#include "lumo/optimize/problem.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <optional>
#include <set>
#include <vector>

namespace lumo {

/// Samples feasible designs of a space: fresh ones spread over it, and moves from a given one. Small lattices are
/// listed, so that their last free design is found and their end is known. Law: all that it returns is feasible, on the
/// lattice to the bit, and a function of its key.
class DesignSampler {
 public:
  static constexpr std::size_t list_limit = 100000;     ///< feasible designs up to which a lattice is listed
  static constexpr std::size_t visit_limit = 4000000;   ///< nodes looked at for that
  static constexpr std::uint32_t try_limit = 1u << 18;  ///< points tried for one set of fresh designs

  /// Throws InvalidArgument for a space without variables, a name twice, bounds that are not finite or are reversed, a
  /// lattice without a node between them, a constraint with the wrong number of coefficients. The space is copied.
  explicit DesignSampler(DesignSpace space) : space_(std::move(space)) {
    if (space_.variables.empty()) throw InvalidArgument("design space has no variables, must have at least 1");
    std::set<std::string> names;
    for (std::size_t i = 0; i < dimensions(); ++i) {
      const Variable& v = space_.variables[i];
      if (!names.insert(v.name).second) throw InvalidArgument(message("variable ", v.name, " is there twice"));
      if (!std::isfinite(v.lower) || !std::isfinite(v.upper) || v.lower > v.upper || !std::isfinite(v.upper - v.lower))
        throw InvalidArgument(message(
            "variable ", v.name, " has bounds ", v.lower, " and ", v.upper, ", must be finite, the lower first"));
      if (!std::isfinite(v.step) || v.step < 0.0)
        throw InvalidArgument(message("variable ", v.name, " has step ", v.step, ", must be finite and >= 0"));
      Axis axis;
      if (v.step > 0.0) {
        const double slack = 1e-9;  // bounds such as 0.3 on a lattice of 0.1 are meant to be nodes
        axis.first_node = std::ceil((v.lower - v.origin) / v.step - slack);
        axis.nodes = std::floor((v.upper - v.origin) / v.step + slack) - axis.first_node + 1.0;
        if (!(axis.nodes >= 1.0) || axis.nodes > 1e15)
          throw InvalidArgument(message("variable ", v.name, " has ", std::max(0.0, axis.nodes), " nodes of step ",
              v.step, " between ", v.lower, " and ", v.upper, ", must have 1 to 1e15"));
      }
      axes_.push_back(axis);
      if (axis.nodes > 0.0 && axis.nodes <= 65536.0)
        for (double k = 0.0; k < axis.nodes; ++k) axes_[i].table.push_back(node(i, k));
    }
    for (const LinearConstraint& c : space_.constraints)
      if (c.coefficients.size() != dimensions() || !(c.lower <= c.upper))
        throw InvalidArgument(
            message("constraint ", c.name, " has ", c.coefficients.size(), " coefficients and limits ", c.lower,
                " and ", c.upper, ", must have ", dimensions(), " and the lower limit first"));
    if (std::all_of(axes_.begin(), axes_.end(), [](const Axis& a) { return a.nodes > 0.0; })) list();
  }

  const DesignSpace& space() const { return space_; }
  std::size_t dimensions() const { return space_.variables.size(); }
  /// Number of feasible designs, where they are few enough to be listed.
  std::optional<std::size_t> feasible_count() const { return listed_ ? std::optional(list_.size()) : std::nullopt; }

  /// Up to `count` different feasible designs that are not in `taken`, uniform over the space; fewer if there are no
  /// more, or none is found in `try_limit` tries. Points of a Sobol sequence, or of a random walk where less than one
  /// in a thousand of them is feasible.
  std::vector<Design> fresh(std::size_t count, std::uint64_t key, const DesignSet& taken) const {
    std::vector<Design> out;
    DesignSet seen;
    const PolytopeWalk walk(space_);
    const auto change = [this](std::size_t i, double x, double by) { return shifted(i, x, by); };
    std::optional<Design> walker;
    const OwenSobol sequence{key};
    const std::uint32_t tries = listed_ ? std::uint32_t(std::min<std::size_t>(64 * count, try_limit)) : try_limit;
    for (std::uint32_t index = 0; index < tries && out.size() < count; ++index) {
      Design x = point(sequence, index);
      if (!space_.contains(x)) {
        const std::uint64_t draw = combine(key, index);
        if (!walker) {  // where repair ends is a face
          if (listed_ || out.size() * 1000 > index || index < 4096 || index % 64 != 0) continue;
          const auto repair = repaired(x, draw);
          if (!repair) continue;
          walker = walk.after(*repair, 10 * walk.between(), draw, change);
        }
        x = *(walker = walk.after(*walker, walk.between(), combine(draw, 1), change));
      }
      if (!taken.contains(x) && seen.insert(x).second) out.push_back(x);
    }
    // Nodes of a listed lattice that random points missed, in an order that depends on the key.
    struct Missed {
      std::uint64_t order;
      std::size_t number;
      auto operator<=>(const Missed&) const = default;
    };
    std::vector<Missed> rest;
    for (std::size_t i = 0; i < list_.size() && out.size() < count; ++i)
      if (!taken.contains(list_[i]) && !seen.contains(list_[i])) rest.push_back({combine(key, i), i});
    std::sort(rest.begin(), rest.end());
    for (std::size_t i = 0; i < rest.size() && out.size() < count; ++i) out.push_back(list_[rest[i].number]);
    return out;
  }

  /// The feasible designs one move away from `x`: along each axis, along pairs of lattice axes and in `extra` random
  /// directions. A move is `reach` times the variable's range, and at least one step of its lattice.
  std::vector<Design> moves(const Design& x, double reach, int extra, std::uint64_t key) const {
    std::vector<Design> out;
    const std::size_t d = dimensions();
    const auto by = [&](std::size_t i) { return reach * (space_.variables[i].upper - space_.variables[i].lower); };
    const auto offer = [&](const Design& y) {
      if (y != x && space_.contains(y)) out.push_back(y);
    };
    for (std::size_t i = 0; i < d; ++i)
      for (const double sign : {-1.0, 1.0}) {
        Design y = x;
        y[i] = shifted(i, x[i], sign * by(i));
        offer(y);
        // One up, its neighbour down (and so on) follows a constraint's face; off lattices, and where pairs are many,
        // the random moves do.
        for (std::size_t k = i + 1; k < d && d <= 8; ++k)
          for (const double other : {-1.0, 1.0}) {
            if (axes_[i].nodes == 0.0 || axes_[k].nodes == 0.0) continue;
            Design z = y;
            z[k] = shifted(k, x[k], other * by(k));
            offer(z);
          }
      }
    for (int e = 0; e < extra; ++e) {
      Design y = x;
      for (std::size_t i = 0; i < d; ++i) {
        const std::uint64_t draw = combine(combine(key, std::uint64_t(e)), i);
        y[i] = shifted(i, x[i], 2.0 * (uniform(draw) - 0.5) * by(i) * 1.5);
      }
      offer(y);
    }
    return out;
  }

  /// Is `reach` too small to make a difference: one step on every lattice, less than 10⁻⁴ of the range elsewhere?
  bool finest(double reach) const {
    for (std::size_t i = 0; i < dimensions(); ++i) {
      const Variable& v = space_.variables[i];
      const double range = v.upper - v.lower;
      if (axes_[i].nodes > 0.0 ? reach * range >= 1.5 * v.step : reach >= 1e-4 && range > 0.0) return false;
    }
    return true;
  }

  /// The same design with lattice values to the bit as the sampler writes them.
  Design canonical(Design x) const {
    for (std::size_t i = 0; i < x.size() && i < dimensions(); ++i)
      if (axes_[i].nodes > 0.0) x[i] = shifted(i, x[i], 0.0);
    return x;
  }

 private:
  /// Values along one axis: a lattice's nodes, or any between the bounds.
  struct Axis {
    double first_node = 0.0, nodes = 0.0;  ///< index of the first node and number of nodes; none: continuous
    std::vector<double> table;
  };

  /// The shortest decimal number for a node: 0.3, not 0.30000000000000004.
  double node(std::size_t i, double k) const {
    if (!axes_[i].table.empty() && k < double(axes_[i].table.size())) return axes_[i].table[std::size_t(k)];
    const Variable& v = space_.variables[i];
    const double x = v.origin + (axes_[i].first_node + k) * v.step;
    char digits[40];
    const char* end = std::to_chars(digits, digits + sizeof digits, x, std::chars_format::general, 14).ptr;
    double rounded = x;
    std::from_chars(digits, end, rounded);
    const double size = std::max({std::abs(x), std::abs(v.origin), std::abs(x - v.origin)});  // of what was added
    return std::clamp(
        std::abs(rounded - x) <= 2.0 * std::numeric_limits<double>::epsilon() * size ? rounded : x, v.lower, v.upper);
  }
  double place(std::size_t i, double unit) const {
    const Variable& v = space_.variables[i];
    if (axes_[i].nodes > 0.0) return node(i, std::clamp(std::floor(unit * axes_[i].nodes), 0.0, axes_[i].nodes - 1.0));
    return std::clamp(v.lower + unit * (v.upper - v.lower), v.lower, v.upper);
  }
  double shifted(std::size_t i, double x, double by) const {
    const Variable& v = space_.variables[i];
    if (axes_[i].nodes == 0.0) return std::clamp(x + by, v.lower, v.upper);
    double steps = std::round(by / v.step);
    if (steps == 0.0 && by != 0.0) steps = by > 0.0 ? 1.0 : -1.0;
    return node(
        i, std::clamp(std::round((x - v.origin) / v.step) - axes_[i].first_node + steps, 0.0, axes_[i].nodes - 1.0));
  }
  void list() {
    Design x(dimensions());
    std::size_t visits = 0;
    listed_ = descend(0, x, visits);
    if (!listed_) list_ = {};
  }
  /// Depth first over the lattice, leaving branches that no choice of the remaining variables can save. False when
  /// there is too much.
  bool descend(std::size_t i, Design& x, std::size_t& visits) {
    if (++visits > visit_limit) return false;
    for (const LinearConstraint& c : space_.constraints) {
      double least = 0.0, most = 0.0, size = 0.0;
      for (std::size_t j = 0; j < dimensions(); ++j) {
        const Variable& v = space_.variables[j];
        const double a = c.coefficients[j] * (j < i ? x[j] : v.lower), b = c.coefficients[j] * (j < i ? x[j] : v.upper);
        least += std::min(a, b);
        most += std::max(a, b);
        size += std::max(std::abs(a), std::abs(b));
      }
      if (least > c.upper + 1e-12 * size || most < c.lower - 1e-12 * size) return true;
    }
    if (i == dimensions()) {
      if (space_.contains(x)) list_.push_back(x);
      return list_.size() <= list_limit;
    }
    for (double k = 0.0; k < axes_[i].nodes; ++k) {
      x[i] = node(i, k);
      if (!descend(i + 1, x, visits)) return false;
    }
    return true;
  }
  /// Projects on the linear constraints in turn until all hold; nullopt if that does not end. For spaces that random
  /// points rarely hit.
  std::optional<Design> repaired(Design x, std::uint64_t key) const {
    for (int sweep = 0; sweep < 100; ++sweep) {
      if (space_.contains(x)) return x;
      for (const LinearConstraint& c : space_.constraints) {
        const double too_much = excess(c, x);
        if (too_much == 0.0) continue;
        double norm = 0.0;  // variables count by their range
        for (std::size_t i = 0; i < x.size(); ++i)
          norm += std::pow(c.coefficients[i] * (space_.variables[i].upper - space_.variables[i].lower), 2);
        if (!(norm > 0.0)) return std::nullopt;
        for (std::size_t i = 0; i < x.size(); ++i) {
          const double range = space_.variables[i].upper - space_.variables[i].lower;
          const double by = -too_much * c.coefficients[i] * range * range / norm;
          x[i] = axes_[i].nodes > 0.0 ? (std::abs(by) > 0.25 * space_.variables[i].step ? shifted(i, x[i], by) : x[i])
                                      : shifted(i, x[i], by);
        }
        settle(c, x, combine(key, std::uint64_t(sweep)));  // what rounding left, or was too little to move any
      }
    }
    return std::nullopt;
  }
  /// Excess of a sum above its upper limit, or (negative) below its lower one, and a little more, so that rounding
  /// does not matter.
  static double excess(const LinearConstraint& c, const Design& x) {
    const double sum = c.sum(x), inside = std::min(1e-9 * std::abs(sum),
                                     std::isfinite(c.upper - c.lower) ? 0.5 * (c.upper - c.lower) : 1.0);
    return sum > c.upper ? sum - c.upper + inside : sum < c.lower ? sum - c.lower - inside : 0.0;
  }
  /// Moves single lattice variables by the steps that the excess is worth, in an order that depends on the key, if that
  /// lessens it.
  void settle(const LinearConstraint& c, Design& x, std::uint64_t key) const {
    for (std::size_t k = 0; k < x.size(); ++k) {
      const double before = excess(c, x);
      if (std::abs(before) <= c.rounding(x)) return;
      const std::size_t i = (std::size_t(key % x.size()) + k) % x.size();
      if (axes_[i].nodes == 0.0 || c.coefficients[i] == 0.0) continue;
      const double steps = -before / (c.coefficients[i] * space_.variables[i].step);
      Design moved = x;
      moved[i] = shifted(i, x[i], std::copysign(std::ceil(std::abs(steps) - 1e-6), steps) * space_.variables[i].step);
      if (std::abs(excess(c, moved)) < std::abs(before)) x = std::move(moved);
    }
  }
  Design point(const OwenSobol& sequence, std::uint32_t index) const {
    Design x(dimensions());
    for (std::size_t i = 0; i < dimensions(); ++i) {
      const std::uint64_t number = i / std::size_t(Sobol::dimensions), key = combine(sequence.seed, number);
      // Later blocks take the points in another order, or their dimensions would go with those of the first.
      const std::uint32_t of_block =
          number == 0 ? index : owen_scramble(index, std::uint32_t(combine(key, Sobol::dimensions) >> 32));
      x[i] = place(i, OwenSobol{key}(of_block, int(i % std::size_t(Sobol::dimensions))));
    }
    return x;
  }

  DesignSpace space_;
  std::vector<Axis> axes_;
  std::vector<Design> list_;
  bool listed_ = false;
};

}  // namespace lumo
