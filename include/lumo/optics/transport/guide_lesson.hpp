#pragma once

#include "lumo/core/sobol.hpp"
#include "lumo/optics/optical_scene.hpp"
#include "lumo/optics/transport/light_accounts.hpp"
#include "lumo/optics/transport/path_tracer.hpp"
#include "lumo/optics/transport/radiosity.hpp"
#include "lumo/optics/transport/ray_guide.hpp"
#include "lumo/optics/transport/ray_pattern.hpp"

#include <Eigen/Core>

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace lumo {

/// Fills in what Lambertian faces send: `sent` by each of the nodes [W].
inline void learn_sent_light(
    const OpticalScene& surface, const LightNodes& nodes, const std::vector<double>& sent, RayGuide& guide) {
  constexpr double much_brighter = 4.0;  // than they are in their mean
  double power = 0.0, area = 0.0;
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    power += sent[k];
    area += nodes.area(k);
  }
  guide.bright_W_m2 = area > 0.0 ? much_brighter * power / area : 0.0;
  for (std::size_t t = 0; t < surface.triangles().size(); ++t) {
    double mean = 0.0;
    if (const auto& at = nodes.of(int(t)); at[0] >= 0) {
      for (int k : at) mean += sent[std::size_t(k)] / nodes.area(std::size_t(k)) / 3.0;
      const std::array<Vec3d, 3> corner = surface.reference_corners(int(t));
      const double here = 0.5 * (corner[1] - corner[0]).cross(corner[2] - corner[0]).norm();
      guide.area_m2 += here;
      guide.sent_W += here * mean;
    }
    guide.sent_W_m2.push_back(mean);
  }
}

/// Sends the same rays of emitters in air through the undeformed body and through its states, and keeps from where
/// their light changes.
class GuideLesson {
 public:
  GuideLesson(std::vector<RayPattern> patterns, const OwenSobol& sequence)
      : patterns_(std::move(patterns)), sequence_(sequence), squares_(patterns_.size()) {
    for (std::size_t c = 0; c < patterns_.size(); ++c)
      for (const RayPattern::Beam& beam : patterns_[c].beams()) {
        rays_ += beam.source.in_air() ? beam.rays : 0u;
        while (squares_[c].size() <= beam.orbit) squares_[c].emplace_back(DirectionDensity::cells);
      }
  }

  /// The undeformed body, first: what arrives at its Lambertian faces. `launch`: a FilmLaunch.
  template <class Path, class Launch> Tally undeformed(Path& path, const Launch& launch) {
    Tally all;
    bare_.resize(Eigen::Index(path.accounts().channels()), rays_);
    send(path, launch, [&](const Ray& ray, const Tally& tally, const Eigen::VectorXf& found) {
      bare_.col(ray.number) = found;
      all.arrived.insert(all.arrived.end(), tally.arrived.begin(), tally.arrived.end());
      all.ledger.emitted += tally.ledger.emitted;
    });
    return all;
  }

  /// A state. All count alike, however much light changes.
  template <class Path, class Launch> void state(Path& path, const Launch& launch) {
    std::vector<std::pair<double*, double>> changes;
    double sum = 0.0;
    send(path, launch, [&](const Ray& ray, const Tally&, const Eigen::VectorXf& found) {
      const double change = double((found - bare_.col(ray.number)).squaredNorm());
      if (!(change > 0.0)) return;
      changes.emplace_back(&squares_[ray.color][ray.orbit][ray.cell], change);
      sum += change;
    });
    for (const auto& [square, change] : changes) *square += change / sum;
  }

  std::vector<std::vector<DirectionDensity>> directions() const {
    std::vector<std::vector<DirectionDensity>> all;
    for (const auto& of_color : squares_) {
      all.emplace_back();
      for (const std::vector<double>& s : of_color) all.back().emplace_back(s);
    }
    return all;
  }

 private:
  struct Ray {
    Eigen::Index number;
    std::size_t color, orbit, cell;
  };

  template <class Path, class Launch, class Take> void send(Path& path, const Launch& launch, Take&& take) const {
    Eigen::Index number = 0;
    for (std::size_t c = 0; c < patterns_.size(); ++c)
      for (const RayPattern::Beam& beam : patterns_[c].beams())
        for (std::uint32_t i = 0; i < (beam.source.in_air() ? beam.rays : 0u); ++i, ++number) {
          launch(RayPattern::ray(beam, sequence_, i), beam.mirror.cwiseProduct(beam.axis),
              [&](const PrimaryRay& from, double share, bool inside) {
                path.run({.ray = from,
                    .mirror = beam.mirror,
                    .power_W = share * beam.power_W,
                    .inside = inside,
                    .gathers_direct = false});
              });
          const Tally tally = path.accounts().take();
          const auto& channels = tally.ledger.channels;
          take(Ray{number, c, std::size_t(beam.orbit), DirectionDensity::cell(sequence_(i, 0), sequence_(i, 1))}, tally,
              Eigen::Map<const Eigen::VectorXd>(channels.data(), Eigen::Index(channels.size())).template cast<float>());
        }
  }

  std::vector<RayPattern> patterns_;  ///< per colour
  OwenSobol sequence_;
  Eigen::Index rays_ = 0;
  Eigen::MatrixXf bare_;                                   ///< channels × rays [W]
  std::vector<std::vector<std::vector<double>>> squares_;  ///< per colour, orbit and cell
};

}  // namespace lumo
