#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/silicone.hpp"
#include "lumo/optics/beer_lambert.hpp"

#include <algorithm>
#include <cmath>
#include <concepts>

namespace lumo {

/// A medium that also scatters light. transmittance() is the share that runs straight on; albedo() is the share of the
/// rest that is scattered. Laws: albedo in [0, 1]; free_path_m(path_m, u) is where light that does not pass `path_m`
/// ends, drawn with the density −dT/ds on [0, path_m]; scattering_cosine(u) is drawn from the phase function, which is
/// the same forwards and backwards (reciprocity).
template <class M>
concept TurbidMedium = TransparentMedium<M> && requires(const M& medium, double x) {
  { medium.albedo() } -> std::convertible_to<double>;
  { medium.free_path_m(x, x) } -> std::convertible_to<double>;
  { medium.scattering_cosine(x) } -> std::convertible_to<double>;
};

/// A turbid medium whose phase function is known as a density, too [1/sr], which scattering_cosine() draws from.
template <class M>
concept PhaseMedium = TurbidMedium<M> && requires(const M& medium, double cosine) {
  { medium.phase(cosine) } -> std::convertible_to<double>;
};

/// Exponential extinction, of which a share is scattering with Henyey and Greenstein's phase function
/// p(cos θ) = (1 − g²)/(4π (1 + g² − 2 g cos θ)^(3/2)), mean cosine g. It is BeerLambert for albedo 0, to the last
/// bit. Source: Henyey & Greenstein, Astrophys. J. 93 (1941); sampling: Witt, Astrophys. J. Suppl. 35 (1977).
class ScatteringMedium {
 public:
  /// Throws InvalidArgument unless index and extinction are BeerLambert's, the albedo lies in [0, 1] and the anisotropy
  /// in [−0.999, 0.999].
  explicit ScatteringMedium(const Medium& medium) : straight_(medium), medium_(medium) {
    require_in_range("scattering albedo", medium.scattering_albedo, 0.0, 1.0, "");
    require_in_range("anisotropy of scattering", medium.anisotropy, -0.999, 0.999, "");
  }

  double refractive_index() const { return straight_.refractive_index(); }
  template <class S> auto transmittance(const S& path_m) const { return straight_.transmittance(path_m); }
  double albedo() const { return medium_.scattering_albedo; }
  double free_path_m(double path_m, double u) const {
    const double depth = medium_.extinction_per_m * path_m;
    return depth > 0.0 ? std::clamp(-std::log1p(u * std::expm1(-depth)) / medium_.extinction_per_m, 0.0, path_m)
                       : u * path_m;
  }
  double scattering_cosine(double u) const {
    const double g = medium_.anisotropy, s = 2.0 * u - 1.0;
    constexpr double nearly_isotropic = 1e-4;  // below it the formula cancels: take its limit
    if (std::abs(g) < nearly_isotropic) return std::clamp(s + 1.5 * g * (1.0 - s * s), -1.0, 1.0);
    const double q = (1.0 - g * g) / (1.0 + g * s);
    return std::clamp((1.0 + g * g - q * q) / (2.0 * g), -1.0, 1.0);
  }
  double phase(double cosine) const {
    const double g = medium_.anisotropy, q = 1.0 + g * g - 2.0 * g * std::clamp(cosine, -1.0, 1.0);
    return (1.0 - g * g) / (4.0 * pi * q * std::sqrt(q));
  }

 private:
  BeerLambert straight_;
  Medium medium_;
};

static_assert(PhaseMedium<ScatteringMedium>);
static_assert(!TurbidMedium<BeerLambert>);

}  // namespace lumo
