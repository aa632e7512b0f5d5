#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace lumo {

/// Density of rays over the unit square of numbers that stand for the directions of an emitter (RayPattern::ray),
/// constant in cells. More rays go where light was found to change, as Neyman allots samples (1934), and each is worth
/// less for it.
class DirectionDensity {
 public:
  /// Cells in √(1 − u), the cosine to the axis under a cosine law, and in v, the azimuth.
  static constexpr std::size_t rows = 32, columns = 16, cells = rows * columns;

  /// `squares`: per cell, row by row, the sum of squares of what evenly sent rays brought.
  explicit DirectionDensity(const std::vector<double>& squares) {
    std::array<double, cells> mass{};
    double all = 0.0;
    for (std::size_t k = 0; k < cells; ++k) all += mass[k] = std::sqrt(squares[k] * area(k));
    for (std::size_t i = 0; i < rows; ++i) {
      std::array<double, columns>& along = along_[i];
      for (std::size_t j = 0; j < columns; ++j) {
        const std::size_t k = i * columns + j;
        density_[k] = all > 0.0 ? even + (1.0 - even) * mass[k] / (all * area(k)) : 1.0;
        along[j] = (j > 0 ? along[j - 1] : 0.0) + density_[k] * area(k);
      }
      up_[i] = (i > 0 ? up_[i - 1] : 0.0) + along.back();
    }
  }

  static std::size_t cell(double u, double v) {
    const auto index = [](double x, std::size_t n) { return std::min(std::size_t(x * double(n)), n - 1); };
    return index(1.0 - std::sqrt(1.0 - u), rows) * columns + index(v, columns);
  }

  struct Place {
    double u, v, density;  ///< the density is 1 on average
  };
  /// Takes evenly spread numbers in (0, 1) to this density, in their order.
  Place operator()(double u, double v) const {
    const auto [i, s] = locate(up_, u);
    const auto [j, t] = locate(along_[i], v);
    return {edge(i) + s * (edge(i + 1) - edge(i)), (double(j) + t) / columns, density_[i * columns + j]};
  }

 private:
  static constexpr double even = 0.3;  ///< share of the rays that goes everywhere, for what was not found

  /// Lower edge of a row, in u.
  static double edge(std::size_t row) {
    const double c = 1.0 - double(row) / rows;
    return 1.0 - c * c;
  }
  static double area(std::size_t cell) { return (edge(cell / columns + 1) - edge(cell / columns)) / columns; }
  struct Step {
    std::size_t index;
    double within;
  };
  /// The step of growing `sums` in which the share `x` of all lies.
  template <std::size_t N> static Step locate(const std::array<double, N>& sums, double x) {
    const double y = x * sums.back();
    const std::size_t k = std::min(std::size_t(std::upper_bound(sums.begin(), sums.end(), y) - sums.begin()), N - 1);
    const double below = k > 0 ? sums[k - 1] : 0.0;
    return {k, std::clamp((y - below) / (sums[k] - below), 0.0, 1.0)};
  }

  std::array<double, cells> density_{};
  std::array<double, rows> up_{};                          ///< rays up to the end of each row
  std::array<std::array<double, columns>, rows> along_{};  ///< likewise along each row
};

/// What some rays have shown of the light of a body and its states, for later traces on the same mesh. Responses that
/// are compared share it. Empty: nothing is known.
struct RayGuide {
  std::vector<std::vector<DirectionDensity>> directions;  ///< of emitters in air, per colour and orbit of RayPattern
  /// Power that a triangle sends on [W/m²], if it is Lambertian, of the undeformed body. Small bright faces beside
  /// emitters in air are rarely found backwards: paths start from them, in proportion to this.
  std::vector<double> sent_W_m2;
  double bright_W_m2 = 0.0;            ///< from which on that is done
  double area_m2 = 0.0, sent_W = 0.0;  ///< of these triangles in all
};

}  // namespace lumo
