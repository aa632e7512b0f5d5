#pragma once

#include "lumo/core/statistics.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/profile/unloaded_reference.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace lumo::sense {

/// How much of a picture is the last one again. A camera's noise changes most pixels from picture to picture; a video
/// codec, or a camera that averages, repeats them.
class RepeatedPixels {
 public:
  /// Pictures of one size and format; one that differs begins anew.
  void add(const ImageView& v) {
    if (v.empty()) return;
    const bool follows = v.width == last_.width && v.height == last_.height && v.format == last_.format;
    std::size_t lit = 0, same = 0;
    if (follows) {
      const ImageView before = last_.view();
      const int bytes = v.width * channels(v.format);
      for (int y = 0; y < v.height; ++y)
        for (int i = 0; i < bytes; ++i) {
          const int value = v.row(y)[i];
          if (value < least_DN || value > most_DN) continue;
          ++lit;
          same += value == before.row(y)[i];
        }
      const bool again = lit >= least_pixels && same == lit;
      run_ = again ? run_ + 1 : 0;
      longest_ = std::max(longest_, run_);
      if (lit >= least_pixels && !again) share_.push_back(double(same) / double(lit));
    }
    last_ = Image::copy(v);
  }
  /// Share of the lit pixels (of each channel) that keep their very value, in the tenth of all pictures that repeat
  /// most and are not wholly the last one again: a codec renews some pictures, a camera all. 1 where pictures come
  /// again more often in a row than a driver hands them on. 0 where nothing is known.
  double share() const { return longest_ >= longest_run ? 1.0 : share_.empty() ? 0.0 : quantile(share_, 0.9); }

 private:
  static constexpr int least_DN = 20, most_DN = 250;  ///< black and full pixels repeat by themselves
  static constexpr std::size_t least_pixels = 100;
  static constexpr int longest_run = 4;
  Image last_;
  int run_ = 0, longest_ = 0;  ///< pictures that are wholly the last one again, one after the other
  std::vector<double> share_;
};

/// How pictures repeat themselves.
struct Repeats {
  double unchanged = 0.0;   ///< share of lit pixels that keep their value (RepeatedPixels)
  double block_bins = 1.0;  ///< bins that one block of a codec covers, whose errors are then one
};

/// Limits of what is believed of pictures that are said to show the unloaded finger; chosen on the virtual lab.
struct UnloadedLimits {
  std::size_t least = 8;          ///< pictures, below which none is left out
  double light_sigmas = 9.0;      ///< from the others' light, in their scatter, beyond which a picture disagrees …
  double light_share = 0.04;      ///< … if it is also this share of the light off
  double left_sigmas = 5.0;       ///< the same once some were left out: what is like them goes, too
  double shape_sigmas = 10.0;     ///< the same of one place against the others …
  double shape_DN = 2.0;          ///< … if it is also this much
  double repeated_share = 0.6;    ///< of unchanged pixels, above which scatter says little of the next second's
  double fresh_share = 0.34;      ///< of pictures that are not the last one again, below which the same holds
  double repeated_DN = 1.5;       ///< least noise of a profile's value then: a codec's steps
  double repeated_scatter = 1.5;  ///< … and of the largest deviation, what is more than that, times √block_bins
  double largest_scatter = 0.04;  ///< of one response, share of the light, that a finger at rest has
  double band_together = 1.6;  ///< scatter of an eighth of the finger over that of places that vary by themselves …
  double band_DN = 0.3;        ///< … and scatter of one place, above which light moves along the finger in bands
};

/// The reference of a stretch, and what was found in it.
struct CheckedReference {
  UnloadedReference reference;
  int pictures = 0;          ///< of the stretch
  int left_out = 0;          ///< that disagree with the rest of it
  int repeated = 0;          ///< that are the one before again; they count once
  bool repeats = false;      ///< pixels repeat from picture to picture, and noise has a floor
  double least_noise = 0.0;  ///< that floor [DN]; 0: none
  double scatter = 0.0;      ///< of one response, share of the light (median over the finger)
  bool scatters = false;     ///< more than a finger at rest does
  double together = 0.0;     ///< part of that scatter that all places have together, share of the light
  double bands = 0.0;        ///< scatter by light that moves along the finger in bands, share of the light; 0: none
  double saturated = 0.0;    ///< share of full pixels, mean over the pictures
};

namespace detail {

/// Middle and scatter of the half of all numbers that lie closest together (the shorth: Andrews et al. 1972), in
/// standard deviations of a normal.
inline std::pair<double, double> closest_half(std::vector<double> v) {
  std::sort(v.begin(), v.end());
  const std::size_t h = v.size() / 2 + 1;
  const std::size_t best = closest_together(v, h);
  double sum = 0.0;
  for (std::size_t i = best; i < best + h; ++i) sum += v[i];
  return {sum / double(h), 0.5 * (v[best + h - 1] - v[best]) / half_of_normal};
}

/// Deviations from the pointwise median profile, each profile scaled to its light: profiles × places.
inline Eigen::MatrixXd shape_deviations(const std::vector<const Profile*>& profiles) {
  const auto n = Eigen::Index(profiles.size()), places = profiles.front()->value.size();
  Eigen::MatrixXd value(places, n);
  for (Eigen::Index k = 0; k < n; ++k) value.col(k) = profiles[std::size_t(k)]->value;
  const Eigen::VectorXd middle = pointwise_median(value);
  const double light = std::max(middle.mean(), 1e-9);
  for (Eigen::Index k = 0; k < n; ++k) value.col(k) -= value.col(k).mean() / light * middle;
  return value;
}

/// Scatter of means over neighbouring places, an eighth of all, over that of as many that vary by themselves.
inline double scatter_together(const Eigen::MatrixXd& deviation) {
  const Eigen::Index width = std::max<Eigen::Index>(2, deviation.rows() / 8), windows = deviation.rows() - width + 1;
  const double single = deviation.squaredNorm() / double(deviation.size());
  if (windows < 1 || !(single > 0.0)) return 1.0;
  double sum = 0.0;
  for (Eigen::Index first = 0; first < windows; ++first)
    sum += deviation.middleRows(first, width).colwise().mean().squaredNorm();
  return std::sqrt(double(width) * sum / double(windows * deviation.cols()) / single);
}

/// Those whose light is that of the closest half. Where some are far off, that half may hold some of them: what is left
/// is then judged again by its own scatter, until it stays.
inline std::vector<const Profile*> of_one_light(
    const std::vector<const Profile*>& profiles, const UnloadedLimits& limits) {
  std::vector<double> light;
  for (const Profile* p : profiles) light.push_back(p->value.mean());
  const std::pair<double, double> half = closest_half(light);  // clang 14 captures no structured bindings
  double middle = half.first;
  const auto within = [&](const std::vector<const Profile*>& from, double off) {
    std::vector<const Profile*> kept;
    for (const Profile* p : from)
      if (std::abs(p->value.mean() - middle) <= std::max(off, limits.light_share * std::abs(middle))) kept.push_back(p);
    return kept;
  };
  std::vector<const Profile*> kept = within(profiles, limits.light_sigmas * half.second);
  for (std::size_t before = profiles.size(); kept.size() < before && kept.size() >= limits.least;) {
    before = kept.size();
    light.clear();
    for (const Profile* p : kept) light.push_back(p->value.mean());
    middle = median(light);
    for (double& l : light) l = std::abs(l - middle);
    kept = within(kept, limits.left_sigmas * median(light) / half_of_normal);
  }
  return kept;
}

}  // namespace detail

/// The profiles that agree with each other: neither all their light nor that of one place is far off. `left_out` counts
/// the others.
inline std::vector<const Profile*> agreeing(
    std::vector<const Profile*> profiles, int& left_out, const UnloadedLimits& limits = {}) {
  if (profiles.size() < limits.least) return profiles;
  const std::vector<const Profile*> alike = detail::of_one_light(profiles, limits);
  const Eigen::MatrixXd deviation = detail::shape_deviations(alike).cwiseAbs();
  const double typical = median({deviation.data(), deviation.data() + deviation.size()}) / half_of_normal,
               far = std::max(limits.shape_sigmas * typical, limits.shape_DN);
  std::vector<const Profile*> kept;
  for (std::size_t k = 0; k < alike.size(); ++k)
    if (deviation.col(Eigen::Index(k)).maxCoeff() <= far) kept.push_back(alike[k]);
  if (kept.empty()) kept = alike;
  left_out += int(profiles.size() - kept.size());
  return kept;
}

/// The reference from profiles that are said to be of the unloaded finger, in the order of time. Without profiles its
/// count is 0. Throws InvalidArgument as UnloadedReference::add.
inline CheckedReference checked_reference(
    const std::vector<const Profile*>& stretch, const Repeats& repeats = {}, const UnloadedLimits& limits = {}) {
  CheckedReference r;
  r.pictures = int(stretch.size());
  std::vector<const Profile*> fresh;
  for (const Profile* p : stretch)
    if (fresh.empty() || p->value.size() != fresh.back()->value.size() || p->value != fresh.back()->value)
      fresh.push_back(p);
  r.repeated = r.pictures - int(fresh.size());
  for (const Profile* p : fresh) {  // of one length and finite, or refused
    UnloadedReference one;
    one.add(*fresh.front());
    one.add(*p);
  }
  if (fresh.empty()) return r;
  const std::vector<const Profile*> kept = agreeing(fresh, r.left_out, limits);
  for (const Profile* p : kept) r.reference.add(*p);
  r.repeats =
      repeats.unchanged > limits.repeated_share || double(fresh.size()) < limits.fresh_share * double(r.pictures);
  if (r.repeats) {
    const double step = limits.repeated_DN,
                 seen = limits.repeated_scatter * detail::shape_deviations(fresh).cwiseAbs().maxCoeff();
    r.least_noise = step + std::sqrt(repeats.block_bins) * std::max(0.0, seen - step);
  }
  if (kept.size() >= limits.least) {
    const Eigen::MatrixXd deviation = detail::shape_deviations(kept);
    const double together = detail::scatter_together(deviation),
                 single = deviation.norm() / std::sqrt(double(deviation.size()));
    if (together > limits.band_together && single > limits.band_DN) {
      r.bands = single / std::max(r.reference.mean().mean(), 1e-9);
      r.least_noise = std::max(r.least_noise, limits.repeated_scatter * together * single);
    }
  }
  r.reference.set_least_noise(r.least_noise);
  const Eigen::VectorXd noise = r.reference.noise(), share = noise.cwiseQuotient(r.reference.mean().cwiseMax(1e-9));
  r.scatter = median({share.data(), share.data() + share.size()});
  std::vector<double> light;
  for (const Profile* p : kept) {
    light.push_back(p->value.mean());
    r.saturated += p->saturated / double(kept.size());
  }
  r.together = rms(Eigen::Map<const Eigen::VectorXd>(light.data(), Eigen::Index(light.size())).array() -
                   r.reference.mean().mean()) /
               std::max(r.reference.mean().mean(), 1e-9);
  r.scatters = !r.repeats && r.scatter > limits.largest_scatter;
  return r;
}

}  // namespace lumo::sense
