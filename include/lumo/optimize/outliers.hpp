#pragma once

#include "lumo/core/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace lumo {

/// When a value of an objective is an outlier. Ranges are those of the bulk, of all that is none.
struct OutlierRule {
  double worse = 20.0;        ///< ranges between the bulk and a worse value that is an outlier
  double better = 1e6;        ///< and a better one, which may be what is looked for
  std::size_t confirmed = 3;  ///< so many different ones that are better are no outliers
  std::size_t least = 6;      ///< different values below which none is an outlier
  std::size_t early = 8;      ///< different values, at least, among which the bulk begins
  std::size_t few = 3;        ///< so many values may be the bulk, if the others are worse by `penalty` ranges
  double penalty = 1000.0;
};

/// Finds the outliers of an objective: absurd values, of a solver that blew up, and penalties. The bulk begins with the
/// half of the early values that lies closest together, and takes in what lies within some of its ranges; so no single
/// value moves it. Later values, which the search has chosen, crowd around the best one: they extend the bulk, but it
/// does not begin with them.
class ValueBulk {
 public:
  /// `values` in the order of asking, finite, larger is better; the first `starts` of them are spread over the space.
  ValueBulk(const std::vector<double>& values, std::size_t starts, const OutlierRule& rule = {}) {
    std::vector<double> first;
    for (std::size_t i = 0; i < values.size() && (i < starts || first.size() < rule.early); ++i) {
      const auto place = std::lower_bound(first.begin(), first.end(), values[i]);
      if (place == first.end() || *place != values[i]) first.insert(place, values[i]);
    }
    if (first.size() < rule.least) return;
    begin(first, rule);
    std::vector<double> sorted = values;
    std::sort(sorted.begin(), sorted.end());
    sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
    grow(sorted, rule);
    const auto above = std::upper_bound(sorted.begin(), sorted.end(), high_);
    if (std::size_t(sorted.end() - above) >= rule.confirmed) high_ = sorted.back();
    whole_ = sorted.front() >= low_ && sorted.back() <= high_;
  }

  bool whole() const { return whole_; }  ///< no outliers
  bool worse(double y) const { return !whole_ && y < low_; }
  bool better(double y) const { return !whole_ && y > high_; }
  double low() const { return low_; }  ///< ends of the bulk; only where there are outliers
  double high() const { return high_; }

 private:
  void begin(const std::vector<double>& first, const OutlierRule& rule) {
    const std::size_t n = first.size(), half = std::max(rule.least - 2, (n + 1) / 2);
    high_ = first.back();
    for (std::size_t worse = 1; worse + rule.few <= n; ++worse) {
      low_ = first[worse];
      if (low_ - first[worse - 1] > rule.penalty * (high_ - low_)) return;
    }
    const std::size_t closest = closest_together(first, half);
    low_ = first[closest];
    high_ = first[closest + half - 1];
  }
  void grow(const std::vector<double>& sorted, const OutlierRule& rule) {
    auto below = std::lower_bound(sorted.begin(), sorted.end(), low_);
    auto above = std::upper_bound(sorted.begin(), sorted.end(), high_);
    for (bool grown = true; grown;) {
      const double range = high_ - low_;
      grown = false;
      if (below != sorted.begin() && low_ - *(below - 1) <= rule.worse * range) {
        low_ = *--below;
        grown = true;
      }
      if (above != sorted.end() && *above - high_ <= rule.better * range) {
        high_ = *above++;
        grown = true;
      }
    }
  }

  double low_ = 0.0, high_ = 0.0;
  bool whole_ = true;
};

}  // namespace lumo
