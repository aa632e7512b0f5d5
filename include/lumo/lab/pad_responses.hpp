#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/lab/rig.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

namespace lumo {

/// What one indenter does to the light at one side of a pad, computed at places along it and at loads. Powers are per
/// emitted power; of one side, with both sides' numbers used. Places that begin at 0 are of a pad with equal ends:
/// those below are mirror images.
struct PadResponses {
  std::vector<double> theta_mm;  ///< design
  std::string material;
  double diameter_m = 0.0;              ///< of the sphere
  Eigen::VectorXd position_m;           ///< middles of the bins, ascending, symmetric about 0
  Eigen::VectorXd unloaded;             ///< power through each bin
  Eigen::VectorXd place_m;              ///< ascending, from 0 or from one below it
  Eigen::VectorXd load_N;               ///< ascending, > 0
  Eigen::MatrixXd depth_m;              ///< loads × places
  std::vector<Eigen::MatrixXd> change;  ///< by place: bins × loads
  Eigen::VectorXd tilt_place_m;         ///< places at which a tilted approach was computed, ascending
  std::vector<Eigen::MatrixXd>
      tilt;  ///< by tilt place: odd part of the change on the side x > 0 per radian of approach angle, bins × loads
  Eigen::VectorXd error;  ///< by load: RMS standard error of a bin's change, from the tracer's replicates

  bool equal_ends() const { return place_m.size() > 0 && place_m[0] == 0.0; }
};

/// Throws InputError, with `name` before it, where the parts do not fit together or are not finite.
inline void validate(const PadResponses& r, const std::string& name) {
  const auto require = [&](bool good, const char* what) {
    if (!good) throw InputError(message(name, ": responses of a pad: ", what));
  };
  const Eigen::Index bins = r.position_m.size(), loads = r.load_N.size(), places = r.place_m.size(),
                     tilts = r.tilt_place_m.size();
  const auto ascend = [](const Eigen::VectorXd& v) { return std::is_sorted(v.begin(), v.end(), std::less_equal<>()); };
  require(bins >= 3 && r.unloaded.size() == bins && ascend(r.position_m),
      "there must be at least 3 bins, ascending, with unloaded power each");
  const Eigen::VectorXd& position_m = r.position_m;
  require((position_m + position_m.reverse()).cwiseAbs().maxCoeff() < 1e-9, "bins must be symmetric about y = 0");
  require(loads >= 2 && ascend(r.load_N) && r.load_N[0] > 0.0 && r.error.size() == loads,
      "there must be at least 2 loads, ascending");
  require(places >= 2 && ascend(r.place_m) && Eigen::Index(r.change.size()) == places && r.place_m[0] <= 0.0 &&
              r.place_m[places - 1] > 0.0,
      "there must be at least 2 places, ascending from 0 or from one below it to one above");
  require(tilts >= 1 && ascend(r.tilt_place_m) && Eigen::Index(r.tilt.size()) == tilts,
      "there must be a tilted approach at least at one place");
  require(
      r.depth_m.rows() == loads && r.depth_m.cols() == places && r.depth_m.allFinite() && r.depth_m.minCoeff() > 0.0,
      "a depth is missing or not positive");
  require(r.unloaded.allFinite() && r.unloaded.minCoeff() >= 0.0 && r.unloaded.sum() > 0.0,
      "unloaded power must be finite and not negative");
  for (const auto* list : {&r.change, &r.tilt})
    for (const Eigen::MatrixXd& m : *list)
      require(m.rows() == bins && m.cols() == loads && m.allFinite(), "a response is missing or not finite");
}

/// The responses in between: linear from place to place, monotone cubic (Fritsch & Butland 1984) from load to load,
/// starting at 0 N.
class PadLight {
 public:
  /// Throws InputError for responses that do not fit together.
  explicit PadLight(PadResponses responses) : r_(std::move(responses)) {
    validate(r_, "responses");
    for (const Eigen::MatrixXd& m : r_.change) slope_.push_back(slopes(m));
    for (const Eigen::MatrixXd& m : r_.tilt) tilt_slope_.push_back(slopes(m));
    depth_slope_ = slopes(r_.depth_m.transpose());
  }

  const PadResponses& responses() const { return r_; }
  /// The first and the last place.
  std::pair<double, double> reach_m() const {
    const double last = r_.place_m[r_.place_m.size() - 1];
    return {r_.equal_ends() ? -last : r_.place_m[0], last};
  }
  /// Throws InvalidArgument for a place beyond them; `what` names it.
  void require_reached(const char* what, double y_m) const {
    const auto [from, to] = reach_m();
    require_in_range(what, 1e3 * y_m, 1e3 * from, 1e3 * to, "mm");
  }
  /// Where light was computed, mirror images included.
  std::vector<double> places_m() const {
    std::vector<double> all(r_.place_m.begin(), r_.place_m.end());
    if (r_.equal_ends())
      for (const double y : r_.place_m)
        if (y > 0.0) all.insert(all.begin(), -y);
    return all;
  }
  double max_load_N() const { return r_.load_N[r_.load_N.size() - 1]; }
  /// Factor on the light for a mean of `level` on the unloaded side over |y| ≤ 25 mm, or less, so that no bin is above
  /// `brightest` under the last load: as who sets a camera's exposure.
  double scale_to(double level, double brightest) const {
    double sum = 0.0, most = 0.0;
    int bins = 0;
    for (Eigen::Index b = 0; b < r_.position_m.size(); ++b)
      if (std::abs(r_.position_m[b]) <= 25e-3) {
        sum += r_.unloaded[b];
        ++bins;
      }
    for (const Eigen::MatrixXd& change : r_.change)
      most = std::max(most, (r_.unloaded + change.rightCols<1>()).maxCoeff());
    return std::min(level * bins / sum, brightest / std::max(most, 1e-300));
  }
  /// Light of a bin [DN] per emitted power in a camera's pictures.
  double exposure(const CameraRig& camera) const {
    return camera.exposure_DN > 0.0 ? camera.exposure_DN : scale_to(camera.level_DN, camera.brightest_DN);
  }

  /// Change of the power through each bin of the side x > 0 under a contact at y. Places and loads beyond those
  /// computed count as the last ones. The odd part of a tilt is that of the nearest tilt places, moved with the
  /// contact.
  Eigen::VectorXd change(double y_m, double load_N, double tilt_rad = 0.0) const {
    const double place = computed(y_m);
    const auto [k, t] = between(r_.place_m, place);
    Eigen::VectorXd v = (1.0 - t) * at_load(r_.change[k], slope_[k], load_N);
    if (t > 0.0) v += t * at_load(r_.change[k + 1], slope_[k + 1], load_N);
    if (tilt_rad != 0.0) {
      const auto [i, s] = between(r_.tilt_place_m, place);
      add_moved(v, tilt_rad * (1.0 - s), at_load(r_.tilt[i], tilt_slope_[i], load_N),
          place - r_.tilt_place_m[Eigen::Index(i)]);
      if (s > 0.0)
        add_moved(v, tilt_rad * s, at_load(r_.tilt[i + 1], tilt_slope_[i + 1], load_N),
            place - r_.tilt_place_m[Eigen::Index(i) + 1]);
    }
    return place == y_m ? v : Eigen::VectorXd(v.reverse());
  }
  /// `light` of all bins moved along the finger, linear between bins; the end values stay beyond the ends.
  Eigen::VectorXd moved(const Eigen::VectorXd& light, double by_m) const {
    const double width = r_.position_m[1] - r_.position_m[0];
    const Eigen::Index last = light.size() - 1;
    Eigen::VectorXd v(light.size());
    for (Eigen::Index i = 0; i <= last; ++i) {
      const double at = std::clamp(double(i) - by_m / width, 0.0, double(last));
      const auto k = std::min(Eigen::Index(at), last - 1);
      v[i] = light[k] + (at - double(k)) * (light[k + 1] - light[k]);
    }
    return v;
  }
  double depth_m(double y_m, double load_N) const {
    const auto [k, t] = between(r_.place_m, computed(y_m));
    const Eigen::VectorXd all = at_load(r_.depth_m.transpose(), depth_slope_, load_N);
    return (1.0 - t) * all[Eigen::Index(k)] + (t > 0.0 ? t * all[Eigen::Index(k) + 1] : 0.0);
  }
  /// Load that gives a depth, the inverse of the above; beyond the last load with the last slope, 0 for none.
  double load_N(double y_m, double depth_m) const {
    const double most = max_load_N(), end = this->depth_m(y_m, most);
    if (!(depth_m > 0.0)) return 0.0;
    if (depth_m >= end) return most + (depth_m - end) * 0.05 * most / (end - this->depth_m(y_m, 0.95 * most));
    double low = 0.0, high = most;
    for (int k = 0; k < 50; ++k) {
      const double middle = 0.5 * (low + high);
      (this->depth_m(y_m, middle) < depth_m ? low : high) = middle;
    }
    return 0.5 * (low + high);
  }

 private:
  /// A place, or its mirror image, for which there are responses.
  double computed(double y_m) const { return r_.equal_ends() ? std::abs(y_m) : y_m; }

  /// Interval of ascending `x` and the share of it; clamped.
  static std::pair<std::size_t, double> between(const Eigen::VectorXd& x, double at) {
    if (x.size() == 1 || at <= x[0]) return {0, 0.0};
    const Eigen::Index last = x.size() - 1;
    if (at >= x[last]) return {std::size_t(last), 0.0};
    const auto k = Eigen::Index(std::upper_bound(x.begin(), x.end(), at) - x.begin()) - 1;
    return {std::size_t(k), (at - x[k]) / (x[k + 1] - x[k])};
  }

  double load(Eigen::Index k) const { return k == 0 ? 0.0 : r_.load_N[k - 1]; }

  /// Derivatives over the load of rows that are 0 at 0 N; columns 0 N and all loads.
  Eigen::MatrixXd slopes(const Eigen::MatrixXd& value) const {
    const Eigen::Index n = value.cols();
    Eigen::MatrixXd secant(value.rows(), n), slope(value.rows(), n + 1);
    for (Eigen::Index k = 0; k < n; ++k)
      secant.col(k) = (value.col(k) - (k ? Eigen::VectorXd(value.col(k - 1)) : Eigen::VectorXd::Zero(value.rows()))) /
                      (load(k + 1) - load(k));
    slope.col(0) = secant.col(0);
    slope.col(n) = secant.col(n - 1);
    for (Eigen::Index k = 1; k < n; ++k) {
      const double a = load(k) - load(k - 1), b = load(k + 1) - load(k), wa = (a + 2.0 * b) / (3.0 * (a + b));
      for (Eigen::Index i = 0; i < value.rows(); ++i) {
        const double left = secant(i, k - 1), right = secant(i, k);
        slope(i, k) = left * right > 0.0 ? left * right / (wa * right + (1.0 - wa) * left) : 0.0;
      }
    }
    return slope;
  }
  Eigen::VectorXd at_load(const Eigen::MatrixXd& value, const Eigen::MatrixXd& slope, double at) const {
    const Eigen::Index n = value.cols();
    if (!(at > 0.0)) return Eigen::VectorXd::Zero(value.rows());
    if (at >= load(n)) return value.col(n - 1);
    Eigen::Index k = 0;
    while (at >= load(k + 1)) ++k;
    const double h = load(k + 1) - load(k), t = (at - load(k)) / h, u = 1.0 - t;
    Eigen::VectorXd v =
        (t * t * (1.0 + 2.0 * u)) * value.col(k) + (h * t * u * u) * slope.col(k) - (h * t * t * u) * slope.col(k + 1);
    if (k > 0) v += (u * u * (1.0 + 2.0 * t)) * value.col(k - 1);
    return v;
  }
  /// v += share · f(y − shift), f linear between bins and 0 beyond.
  void add_moved(Eigen::VectorXd& v, double share, const Eigen::VectorXd& f, double shift_m) const {
    const double width = r_.position_m[1] - r_.position_m[0];
    const Eigen::Index n = v.size();
    for (Eigen::Index i = 0; i < n; ++i) {
      const double at = double(i) - shift_m / width, whole = std::floor(at);
      const auto k = Eigen::Index(whole);
      const double t = at - whole;
      v[i] += share * ((k >= 0 && k < n ? (1.0 - t) * f[k] : 0.0) + (k + 1 >= 0 && k + 1 < n ? t * f[k + 1] : 0.0));
    }
  }

  PadResponses r_;
  std::vector<Eigen::MatrixXd> slope_, tilt_slope_;
  Eigen::MatrixXd depth_slope_;
};

}  // namespace lumo
