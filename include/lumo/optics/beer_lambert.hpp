#pragma once

#include "lumo/core/error.hpp"
#include "lumo/morphology/silicone.hpp"

#include <cmath>
#include <concepts>

namespace lumo {

/// The filling of a body, for light that runs straight through it. Made from the Medium data of a body.
/// Laws: transmittance(0) = 1, T(a + b) = T(a)·T(b), not increasing. The rest is booked as absorbed.
template <class M>
concept TransparentMedium = std::constructible_from<M, Medium> && requires(const M& medium, double path_m) {
  { medium.refractive_index() } -> std::convertible_to<double>;
  { medium.transmittance(path_m) } -> std::convertible_to<double>;
};

/// Exponential extinction along a path. Source: Bouguer 1729, Lambert 1760, Beer 1852; paper §III (μ_ext acts as
/// absorption).
class BeerLambert {
 public:
  /// Throws InvalidArgument unless the index lies in [1, 5] and the extinction in [0, 1e6] 1/m.
  explicit BeerLambert(const Medium& medium) : medium_(medium) {
    require_in_range("refractive index", medium.refractive_index, 1.0, 5.0, "");
    require_in_range("extinction", medium.extinction_per_m, 0.0, 1e6, "1/m");
  }

  double refractive_index() const { return medium_.refractive_index; }
  /// Share of the power left after `path_m` metres.
  template <class S> auto transmittance(const S& path_m) const {
    using std::exp;
    return exp(-medium_.extinction_per_m * path_m);
  }

 private:
  Medium medium_;
};

static_assert(TransparentMedium<BeerLambert>);
static_assert(!TransparentMedium<int>);

}  // namespace lumo
