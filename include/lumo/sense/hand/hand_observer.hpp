#pragma once

#include "lumo/core/statistics.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/hand/link_map.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

namespace lumo::sense {

/// A place of a link where the light has changed.
struct HandContact {
  int link = 0;                 ///< number in the hand
  double y_m = 0.0, z_m = 0.0;  ///< centroid, weighted by the residual
  double y_low_m = 0.0, y_high_m = 0.0;
  double peak_DN = 0.0;  ///< largest residual
  double mean_DN = 0.0;  ///< over the region
  double area_m2 = 0.0;
  Eigen::Vector2d pixel{0.0, 0.0};         ///< of the centroid
  std::vector<std::pair<int, int>> cells;  ///< of HandObserver's grid, along and across
};

/// Contacts on a hand by one frame.
struct HandEstimate {
  std::int64_t stamp_ns = 0;
  std::vector<bool> seen;             ///< by link: its holes were found and a reference is there
  std::vector<int> reference;         ///< by link: number of the reference it was compared with, −1: none
  std::vector<LinkMap> map;           ///< by link; where it was seen last
  std::vector<HandContact> contacts;  ///< link by link, from proximal to distal
};

/// Contacts on several links at once, without labels (paper, integrated hand). Each link is found by its mounting holes
/// and compared with the unloaded picture of the nearest joint configuration. Global and slow differences of green are
/// removed. Connected regions whose residual stands above the noise are contacts.
class HandObserver {
 public:
  struct Config {
    double cell_m = 1.0_mm;  ///< of the grid on which a link's side is read
    double threshold = 6.0;  ///< a region must reach so many noises
    double edge = 3.0;       ///< and extends down to so many
    double noise_floor_DN = 1.0;
    double min_area_m2 = 6e-6;
    double max_joint_step_rad = 0.35;  ///< a reference farther away does not count
    HoleSearch holes;
  };

  /// `first`: about where each link is in the first picture. Throws InvalidArgument.
  HandObserver(std::vector<HandLink> links, std::vector<LinkMap> first, Config config)
      : links_(std::move(links)), last_(std::move(first)), config_(std::move(config)) {
    if (links_.empty() || last_.size() != links_.size())
      throw InvalidArgument(message(
          "hand has ", links_.size(), " links and ", last_.size(), " first places, must have as many, at least 1"));
    for (const HandLink& l : links_) validate(l);
    require_in_range("cell of the hand's grid", 1e3 * config_.cell_m, 0.1, 10.0, "mm");
    require_in_range("edge of a region", config_.edge, 0.0, config_.threshold, "noises");
    require_positive("noise floor", config_.noise_floor_DN, "DN");
    library_.resize(links_.size());
    steps_.resize(links_.size());
    noise_.resize(links_.size());
    for (const HandLink& l : links_) {
      const auto cells = [&](double low, double high) {
        return std::max(1, int(std::lround((high - low) / config_.cell_m)));
      };
      grid_.push_back({cells(l.y_low_m, l.y_high_m), cells(l.z_low_m, l.z_high_m)});
      require_in_range("cells of a link's grid", double(grid_.back().along) * grid_.back().across, 1, 20000, "");
    }
  }

  const std::vector<HandLink>& links() const { return links_; }
  const Config& config() const { return config_; }
  int references(int link) const { return int(library_[std::size_t(link)].size()); }
  /// Of a cell, along and across the link.
  std::pair<double, double> cell_m(int link) const {
    const HandLink& l = links_[std::size_t(link)];
    const auto& g = grid_[std::size_t(link)];
    return {(l.y_high_m - l.y_low_m) / g.along, (l.z_high_m - l.z_low_m) / g.across};
  }
  /// Middle of a cell in the link's plane [m].
  std::pair<double, double> place(int link, int along, int across) const {
    const HandLink& l = links_[std::size_t(link)];
    const auto [length, height] = cell_m(link);
    return {l.y_low_m + (along + 0.5) * length, l.z_low_m + (across + 0.5) * height};
  }

  /// Adds a picture of the unloaded hand to the references of each link that is seen; how many were.
  int add_reference(const JointVector& joints, const ImageView& image);

  /// Causal: the estimate depends on this frame, the references, and earlier places of the links.
  HandEstimate observe(std::int64_t stamp_ns, const JointVector& joints, const ImageView& image);
  /// The estimate without a picture or joints.
  HandEstimate unseen(std::int64_t stamp_ns) const {
    return {stamp_ns, std::vector<bool>(links_.size(), false), std::vector<int>(links_.size(), -1), last_, {}};
  }

 private:
  using Grid = Eigen::MatrixXd;  ///< along × across [DN]
  struct Cells {
    int along, across;
  };
  struct Reference {
    std::vector<double> joints;
    LinkMap map;
    Grid green;
  };

  std::vector<double> joints_of(int link, const JointVector& all) const;
  std::pair<int, double> nearest(int link, const std::vector<double>& joints) const;
  std::optional<LinkMap> find(int link, int nearest, const ImageView& image);
  Grid read(int link, const LinkMap& map, const ImageView& image) const;
  Grid levelled(const Grid& difference) const;
  const Grid& noise(int link);
  void regions(
      int link, const Grid& residual, const Grid& sigma, const LinkMap& map, std::vector<HandContact>& contacts) const;

  std::vector<HandLink> links_;
  std::vector<LinkMap> last_;
  Config config_;
  std::vector<Cells> grid_;
  std::vector<std::vector<Reference>> library_;  ///< by link
  /// By link: absolute differences between each reference and its nearest one before.
  std::vector<std::vector<Grid>> steps_;
  std::vector<Grid> noise_;  ///< by link; empty if references were added since
};

inline std::vector<double> HandObserver::joints_of(int link, const JointVector& all) const {
  std::vector<double> own;
  for (const int j : links_[std::size_t(link)].joints) {
    if (j < 0 || j >= all.size())
      throw InvalidArgument(message(
          "link '", printable(links_[std::size_t(link)].name), "' needs joint ", j, ", samples have ", all.size()));
    if (!std::isfinite(all[j])) throw InvalidArgument("positions of joints must be finite");
    own.push_back(all[j]);
  }
  return own;
}

/// Number and distance [rad] of the reference whose farthest joint is nearest; −1 without any.
inline std::pair<int, double> HandObserver::nearest(int link, const std::vector<double>& joints) const {
  std::pair<int, double> best{-1, std::numeric_limits<double>::infinity()};
  const auto& all = library_[std::size_t(link)];
  for (std::size_t r = 0; r < all.size(); ++r) {
    double apart = 0.0;
    for (std::size_t k = 0; k < joints.size(); ++k) apart = std::max(apart, std::abs(joints[k] - all[r].joints[k]));
    if (apart < best.second) best = {int(r), apart};
  }
  return best;
}

/// Searches about the link's last place and about its place at the nearest reference; takes the one whose holes stand
/// out more.
inline auto HandObserver::find(int link, int nearest, const ImageView& image) -> std::optional<LinkMap> {
  const HandLink& l = links_[std::size_t(link)];
  auto found = register_link(image, l, last_[std::size_t(link)], config_.holes);
  if (nearest >= 0) {
    const auto other = register_link(image, l, library_[std::size_t(link)][std::size_t(nearest)].map, config_.holes);
    if (other && (!found || other->contrast_DN > found->contrast_DN)) found = other;
  }
  if (found) last_[std::size_t(link)] = *found;
  return found;
}

/// Green at the cells' middles, bilinear; NaN outside the image.
inline auto HandObserver::read(int link, const LinkMap& map, const ImageView& image) const -> Grid {
  const auto [along, across] = grid_[std::size_t(link)];
  Eigen::MatrixXd g(along, across);
  for (int i = 0; i < along; ++i)
    for (int j = 0; j < across; ++j) {
      const auto [y, z] = place(link, i, j);
      const auto p = map.pixel(y, z);
      const int x0 = int(std::floor(p.x())), y0 = int(std::floor(p.y()));
      if (x0 < 0 || y0 < 0 || x0 + 1 >= image.width || y0 + 1 >= image.height) {
        g(i, j) = std::numeric_limits<double>::quiet_NaN();
        continue;
      }
      const double u = p.x() - x0, v = p.y() - y0;
      g(i, j) = (1 - v) * ((1 - u) * image.green(x0, y0) + u * image.green(x0 + 1, y0)) +
                v * ((1 - u) * image.green(x0, y0 + 1) + u * image.green(x0 + 1, y0 + 1));
    }
  return g;
}

/// Removes the slow part along the link: the straight line through the means across that passes closest to two fifths
/// of them, since contacts may cover more than half of a link. Least quantile of squares (after Rousseeuw 1984) over
/// all pairs of means, then least squares over those near it.
inline auto HandObserver::levelled(const Grid& difference) const -> Grid {
  std::vector<std::array<double, 2>> mean;  // row and mean, of rows that are seen
  for (Eigen::Index i = 0; i < difference.rows(); ++i) {
    double sum = 0.0;
    int count = 0;
    for (Eigen::Index j = 0; j < difference.cols(); ++j)
      if (std::isfinite(difference(i, j))) {
        sum += difference(i, j);
        ++count;
      }
    if (count > 0) mean.push_back({double(i), sum / count});
  }
  double level = mean.empty() ? 0.0 : mean[0][1], slope = 0.0, least = std::numeric_limits<double>::infinity();
  constexpr double inliers = 3.0;  // distances of the quantile that count as near the line
  const std::size_t part = 2 * mean.size() / 5;
  std::vector<double> off(mean.size());
  const auto offs = [&] {
    for (std::size_t k = 0; k < mean.size(); ++k) off[k] = std::abs(mean[k][1] - level - slope * mean[k][0]);
  };
  std::array<double, 2> best{level, slope};
  for (std::size_t a = 0; a < mean.size(); ++a)
    for (std::size_t b = a + 1; b < mean.size(); ++b) {
      slope = (mean[b][1] - mean[a][1]) / (mean[b][0] - mean[a][0]);
      level = mean[a][1] - slope * mean[a][0];
      offs();
      std::nth_element(off.begin(), off.begin() + std::ptrdiff_t(part), off.end());
      if (off[part] < least) {
        least = off[part];
        best = {level, slope};
      }
    }
  level = best[0];
  slope = best[1];
  offs();
  double n = 0.0, x = 0.0, y = 0.0, xx = 0.0, xy = 0.0;
  for (std::size_t k = 0; k < mean.size(); ++k) {
    if (off[k] > inliers * least) continue;
    n += 1.0;
    x += mean[k][0];
    y += mean[k][1];
    xx += mean[k][0] * mean[k][0];
    xy += mean[k][0] * mean[k][1];
  }
  if (const double spread = n * xx - x * x; spread > 0.0) {
    slope = (n * xy - x * y) / spread;
    level = (y - slope * x) / n;
  }
  Eigen::MatrixXd rest = difference;
  for (Eigen::Index i = 0; i < rest.rows(); ++i) rest.row(i).array() -= level + slope * double(i);
  return rest;
}

inline int HandObserver::add_reference(const JointVector& joints, const ImageView& image) {
  int count = 0;
  for (int l = 0; l < int(links_.size()); ++l) {
    const std::vector<double> own = joints_of(l, joints);
    const auto near = nearest(l, own);
    const auto map = find(l, near.first, image);
    if (!map) continue;
    const Grid green = read(l, *map, image);
    auto& all = library_[std::size_t(l)];
    if (near.first >= 0 && near.second <= config_.max_joint_step_rad) {
      steps_[std::size_t(l)].push_back(levelled(green - all[std::size_t(near.first)].green).cwiseAbs());
      noise_[std::size_t(l)].resize(0, 0);
    }
    all.push_back({own, *map, green});
    ++count;
  }
  return count;
}

/// Noise of each cell: the 90 % quantile of the references' differences, as the standard deviation of a normal number.
/// Beside an LED, where a fraction of a pixel counts, it is several times that of the plain side.
inline auto HandObserver::noise(int link) -> const Grid& {
  Eigen::MatrixXd& sigma = noise_[std::size_t(link)];
  if (sigma.size() > 0) return sigma;
  constexpr double share = 0.9, share_sigmas = 1.645;  // a normal number's absolute value stays below so many with it
  const auto [along, across] = grid_[std::size_t(link)];
  sigma = Eigen::MatrixXd::Constant(along, across, config_.noise_floor_DN);
  for (Eigen::Index k = 0; k < sigma.size(); ++k) {
    std::vector<double> size;
    for (const Grid& step : steps_[std::size_t(link)])
      if (std::isfinite(step.data()[k])) size.push_back(step.data()[k]);
    if (!size.empty()) sigma.data()[k] = std::max(config_.noise_floor_DN, quantile(size, share) / share_sigmas);
  }
  return sigma;
}

inline auto HandObserver::observe(std::int64_t stamp_ns, const JointVector& joints, const ImageView& image)
    -> HandEstimate {
  HandEstimate e{stamp_ns, {}, {}, {}, {}};
  for (int l = 0; l < int(links_.size()); ++l) {
    const std::vector<double> own = joints_of(l, joints);
    const auto near = nearest(l, own);
    const auto map = find(l, near.first, image);
    const bool known = map && near.first >= 0 && near.second <= config_.max_joint_step_rad;
    e.seen.push_back(known);
    e.reference.push_back(known ? near.first : -1);
    e.map.push_back(last_[std::size_t(l)]);
    if (known)
      regions(l, levelled(read(l, *map, image) - library_[std::size_t(l)][std::size_t(near.first)].green), noise(l),
          *map, e.contacts);
  }
  return e;
}

inline void HandObserver::regions(
    int link, const Grid& residual, const Grid& sigma, const LinkMap& map, std::vector<HandContact>& contacts) const {
  const auto [along, across] = grid_[std::size_t(link)];
  const auto [cell_length, cell_height] = cell_m(link);
  std::vector<bool> taken(std::size_t(along) * std::size_t(across), false);
  const auto index = [&, n = across](int i, int j) { return std::size_t(i) * std::size_t(n) + std::size_t(j); };
  const auto strong = [&](int i, int j) {
    return std::abs(residual(i, j)) > config_.edge * sigma(i, j);
  };  // false for NaN
  for (int i = 0; i < along; ++i)
    for (int j = 0; j < across; ++j) {
      if (taken[index(i, j)] || !strong(i, j)) continue;
      HandContact c;
      c.link = link;
      c.y_low_m = std::numeric_limits<double>::infinity();
      c.y_high_m = -c.y_low_m;
      c.cells.emplace_back(i, j);
      taken[index(i, j)] = true;
      double weight = 0.0, noises = 0.0;
      for (std::size_t k = 0; k < c.cells.size(); ++k) {
        const auto [a, b] = c.cells[k];
        const auto [y, z] = place(link, a, b);
        const double r = std::abs(residual(a, b));
        weight += r;
        c.y_m += r * y;
        c.z_m += r * z;
        c.peak_DN = std::max(c.peak_DN, r);
        noises = std::max(noises, r / sigma(a, b));
        c.y_low_m = std::min(c.y_low_m, y);
        c.y_high_m = std::max(c.y_high_m, y);
        for (int di = -1; di <= 1; ++di)
          for (int dj = -1; dj <= 1; ++dj) {
            const int p = a + di, q = b + dj;
            if (p < 0 || q < 0 || p >= along || q >= across || taken[index(p, q)] || !strong(p, q)) continue;
            taken[index(p, q)] = true;
            c.cells.emplace_back(p, q);
          }
      }
      c.area_m2 = cell_length * cell_height * double(c.cells.size());
      if (noises < config_.threshold || c.area_m2 < config_.min_area_m2) continue;
      c.y_m /= weight;
      c.z_m /= weight;
      c.mean_DN = weight / double(c.cells.size());
      c.pixel = map.pixel(c.y_m, c.z_m);
      std::sort(c.cells.begin(), c.cells.end());
      contacts.push_back(std::move(c));
    }
}

}  // namespace lumo::sense
