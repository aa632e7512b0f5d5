#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/body.hpp"
#include "lumo/morphology/emitter.hpp"
#include "lumo/optics/exit_power.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace lumo {

/// A flat detector outside the body, a parallelogram or an ellipse. It sees light that falls on the side to which
/// `half_u` × `half_v` points.
struct Photodiode {
  Vec3d center{0.0, 0.0, 0.0};       ///< [m]
  Vec3d half_u{1e-3, 0.0, 0.0};      ///< half edge, or half axis [m]
  Vec3d half_v{0.0, 1e-3, 0.0};      ///< likewise
  bool round = false;                ///< an ellipse with these half axes
  double acceptance_rad = 0.5 * pi;  ///< largest angle between the light and the normal

  double area_m2() const { return (round ? pi : 4.0) * half_u.cross(half_v).norm(); }
  Vec3d normal() const { return half_u.cross(half_v).normalized(); }
};

/// Photodiodes, a channel each: the power that falls on them [W], as if none stood in another's light.
class Photodiodes {
 public:
  /// Throws InvalidArgument for no photodiodes, or one without area or acceptance.
  explicit Photodiodes(std::vector<Photodiode> diodes) : diodes_(std::move(diodes)) {
    if (diodes_.empty()) throw InvalidArgument("photodiodes: none given, at least one is needed");
    for (const Photodiode& d : diodes_) {
      if (!d.center.allFinite()) throw InvalidArgument("photodiode: its centre is not finite");
      require_positive("area of a photodiode", d.area_m2(), "m2");
      require_in_range("acceptance angle of a photodiode", d.acceptance_rad * 180.0 / pi, 0.1, 90.0, "deg");
    }
  }

  int channels(const Body&) const { return int(diodes_.size()); }
  /// The first one of several photodiodes behind each other.
  int channel(const Escape& escape) const {
    int best = -1;
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < diodes_.size(); ++k) {
      const Photodiode& d = diodes_[k];
      if (!(escape.direction.dot(d.normal()) < 0.0) || !accepts(d, escape.direction)) continue;
      const double way = (d.center - escape.position).dot(d.normal()) / escape.direction.dot(d.normal());
      if (!(way > 0.0 && way < nearest)) continue;
      const Vec3d p = escape.position + way * escape.direction - d.center, n = d.half_u.cross(d.half_v);
      const double a = p.cross(d.half_v).dot(n) / n.squaredNorm(), b = d.half_u.cross(p).dot(n) / n.squaredNorm();
      if (d.round ? a * a + b * b < 1.0 : std::abs(a) < 1.0 && std::abs(b) < 1.0) {
        best = int(k);
        nearest = way;
      }
    }
    return best;
  }
  int openings() const { return int(diodes_.size()); }
  Connection connect(int k, const Vec3d& from, double u, double v) const {
    const Photodiode& d = diodes_[std::size_t(k)];
    const Vec3d at = d.center + (d.round ? on_unit_disc(u, v, d.half_u, d.half_v)
                                         : Vec3d((2.0 * u - 1.0) * d.half_u + (2.0 * v - 1.0) * d.half_v));
    const Vec3d way = at - from;
    const double length = way.norm();
    if (!(length > 0.0)) return {};
    const Vec3d direction = way / length;
    if (!(direction.dot(d.normal()) < 0.0) || !accepts(d, direction)) return {};
    return {direction, -direction.dot(d.normal()) * d.area_m2() / (length * length)};
  }
  /// Photodiode → its mirror image; nullopt if one has none.
  std::optional<std::vector<int>> image_channels(const Body&, int axis) const {
    Vec3d mirror = Vec3d::Ones();
    mirror[axis] = -1.0;
    std::vector<int> images;
    for (const Photodiode& d : diodes_) {
      const auto image = std::find_if(diodes_.begin(), diodes_.end(), [&](const Photodiode& o) {
        return o.center == mirror.cwiseProduct(d.center) && o.normal() == mirror.cwiseProduct(d.normal()) &&
               o.acceptance_rad == d.acceptance_rad && o.round == d.round &&
               same_edges(o, mirror.cwiseProduct(d.half_u), mirror.cwiseProduct(d.half_v));
      });
      if (image == diodes_.end()) return std::nullopt;
      images.push_back(int(image - diodes_.begin()));
    }
    return images;
  }

 private:
  static bool same_edges(const Photodiode& d, const Vec3d& u, const Vec3d& v) {
    return (d.half_u == u || d.half_u == -u) && (d.half_v == v || d.half_v == -v);
  }
  static bool accepts(const Photodiode& d, const Vec3d& direction) {
    return -direction.dot(d.normal()) > std::cos(d.acceptance_rad) - 1e-12;
  }

  std::vector<Photodiode> diodes_;
};

static_assert(ConnectedReadout<Photodiodes>);

/// Power that stays on opaque patches of the body, as on photodiodes that lie on its face: a channel for each; over the
/// patch's area it is the absorbed part of the irradiance [W/m²]. Mirror images of a patch are one patch. Light that
/// leaves the body is not seen.
class PatchLight {
 public:
  /// Throws InvalidArgument unless each name is that of one patch of `body`, and its optics Absorber or Mirror.
  PatchLight(const Body& body, const std::vector<std::string>& names) {
    for (const std::string& name : names) {
      const auto named = [&](const Patch& p) { return p.name == name; };
      const auto& all = body.patches;
      if (std::count_if(all.begin(), all.end(), named) != 1)
        throw InvalidArgument(message("light is to fall on patch \"", printable(name), "\", the body must have one"));
      const auto patch = std::find_if(all.begin(), all.end(), named);
      if (!std::holds_alternative<Absorber>(patch->optics) && !std::holds_alternative<Mirror>(patch->optics))
        throw InvalidArgument(
            message("light is to stay on patch \"", printable(name), "\", its optics must be Absorber or Mirror"));
      patches_.push_back(int(patch - all.begin()));
    }
  }

  int channels(const Body&) const { return int(patches_.size()); }
  int channel(const Escape&) const { return -1; }
  int landing_channel(const Landing& light) const {
    const auto at = std::find(patches_.begin(), patches_.end(), light.patch);
    return at == patches_.end() ? -1 : int(at - patches_.begin());
  }
  std::optional<std::vector<int>> image_channels(const Body&, int) const { return std::vector<int>{}; }

 private:
  std::vector<int> patches_;
};

static_assert(LandingReadout<PatchLight>);

}  // namespace lumo
