#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/geometry/facet_triangles.hpp"
#include "lumo/morphology/body.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

namespace lumo {

/// Where the mirror images of a body's regions lie in a plane of its symmetry.
struct RegionImages {
  enum class Kind {
    regions,  ///< each region's image is the region `image` names
    unseen,   ///< no image lies in a region: the body is seen from one side
    unknown   ///< neither, or not to be found out: contacts do not stand for their mirror images
  };
  Kind kind = Kind::unknown;
  std::vector<int> image;
};

/// Mirror images of the regions in the plane across `axis` (0: x, 1: y), by asking Body::region at points of the
/// surface and at their images; `unknown` where the body is not symmetric, and for a region without such a point.
/// Without facets what the body gives is believed. Throws InvalidArgument for a region_image_x or _y that region()
/// contradicts.
inline RegionImages region_images(const Body& body, int axis);

namespace detail {

// Asks region() at points that are spread over the facets by area, and at all their images.
class RegionSurvey {
 public:
  RegionSurvey(const Body& body, int axis)
      : body_(body),
        axis_(axis),
        given_(axis == 0 ? body.region_image_x : body.region_image_y),
        image_(std::size_t(body.regions), unasked) {
    require_sound_map();
    if (given_ && given_->empty())
      for (int r = 0; r < body.regions; ++r) given_->push_back(r);
    ask();
  }

  RegionImages answer() const {
    using Kind = RegionImages::Kind;
    if (given_) return {Kind::regions, *given_};
    if (conflict_) return {};
    if (std::all_of(image_.begin(), image_.end(), [](int r) { return r == -1; })) return {Kind::unseen, {}};
    for (std::size_t r = 0; r < image_.size(); ++r)
      if (image_[r] < 0 || image_[std::size_t(image_[r])] != int(r)) return {};
    return {Kind::regions, image_};
  }

 private:
  static constexpr int unasked = -2;
  static constexpr double points = 16384.0;  // in all; a triangle has at least four

  const char* name() const { return axis_ == 0 ? "region_image_x" : "region_image_y"; }
  void require_sound_map() const {
    if (!given_ || given_->empty()) return;
    if (given_->size() != image_.size())
      throw InvalidArgument(message(name(), " has ", given_->size(), " regions, the body has ", image_.size()));
    for (const int r : *given_) require_in_range(name(), r, 0, body_.regions - 1, "");
  }
  void ask() {
    struct Part {
      std::array<Vec3d, 3> corners;
      double area;
      const Shape* shape;
    };
    std::vector<Part> parts;
    double area = 0.0;
    for (std::size_t f = 0; f < body_.facets.size(); ++f) {
      const Facet& facet = body_.facets[f];
      if (facet.patch == Body::mirror_patch || !body_.patches.at(std::size_t(facet.patch)).visible) continue;
      const auto triangles =
          facet_triangles(body_.vertices, facet.loop, polygon_normal(body_.vertices, facet.loop), int(f), 0.0);
      if (!triangles) continue;  // the mesher says what is wrong with it
      for (const SurfaceTriangle& t : *triangles) {
        std::array<Vec3d, 3> c;
        for (std::size_t k = 0; k < 3; ++k) c[k] = body_.vertices[std::size_t(t.corners[k])];
        parts.push_back({c, (c[1] - c[0]).cross(c[2] - c[0]).norm(), &body_.patches[std::size_t(facet.patch)].shape});
        area += parts.back().area;
      }
    }
    for (const Part& p : parts) {
      const int count = std::max(4, int(points * p.area / area));
      for (int k = 1; k <= count; ++k) {  // not from 0, which lies on an edge
        // Additive sequence of the plastic number (Roberts 2018): even, and seldom where regions meet.
        double u = std::fmod(0.5 + 0.7548776662466927 * k, 1.0), v = std::fmod(0.5 + 0.5698402909980532 * k, 1.0);
        if (u + v > 1.0) {
          u = 1.0 - u;
          v = 1.0 - v;
        }
        const auto& [a, b, c] = p.corners;
        const Vec3d at = closest_point(*p.shape, (1.0 - u - v) * a + u * b + v * c);
        ask_images(at, outward_normal(*p.shape, at));
      }
    }
  }
  // A point of the sector stands for one in each of the others.
  void ask_images(const Vec3d& p, const Vec3d& n) {
    Vec3d mirror(1.0, 1.0, 1.0);
    mirror[axis_] = -1.0;
    for (unsigned sector = 0; sector < 4; ++sector) {
      if (((sector & 1u) && !body_.symmetry.x) || ((sector & 2u) && !body_.symmetry.y)) continue;
      const Vec3d s(sector & 1u ? -1.0 : 1.0, sector & 2u ? -1.0 : 1.0, 1.0);
      const Vec3d here = s.cwiseProduct(p), there = mirror.cwiseProduct(here), normal = s.cwiseProduct(n);
      const int r = region(here, normal);
      if (r >= 0) note(r, region(there, mirror.cwiseProduct(normal)), here);
    }
  }
  int region(const Vec3d& p, const Vec3d& n) const {
    const int r = body_.region(p, n);
    return r >= 0 && r < body_.regions ? r : -1;
  }
  void note(int r, int other, const Vec3d& at) {
    if (given_ && (*given_)[std::size_t(r)] != other)
      throw InvalidArgument(message(name(), " says that region ", r, " has its mirror image in region ",
          (*given_)[std::size_t(r)], ", but region() gives ", other, " for that of (", at.x() * 1e3, ", ", at.y() * 1e3,
          ", ", at.z() * 1e3, ") mm"));
    int& known = image_[std::size_t(r)];
    if (known == unasked) known = other;
    else if (known != other) conflict_ = true;
  }

  const Body& body_;
  int axis_;
  std::optional<std::vector<int>> given_;
  std::vector<int> image_;
  bool conflict_ = false;
};

}  // namespace detail

inline RegionImages region_images(const Body& body, int axis) {
  if (!(axis == 0 ? body.symmetry.x : body.symmetry.y) || (body.regions > 0 && !body.region)) return {};
  if (body.regions == 0) return {RegionImages::Kind::regions, {}};
  return detail::RegionSurvey(body, axis).answer();
}

}  // namespace lumo
