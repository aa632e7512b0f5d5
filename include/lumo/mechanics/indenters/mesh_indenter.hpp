#pragma once

#include "lumo/geometry/signed_distance.hpp"
#include "lumo/mechanics/indenters/indenter.hpp"

#include <algorithm>
#include <memory>

namespace lumo {

/// Rigid tool of any closed triangle surface, by the exact distance to its triangles: thin walls, sharp tips and small
/// parts on long shafts are where the surface has them. The surface's own coordinates are the tool's frame. Copies
/// share the surface. `MeshIndenter tool(read_surface("knob.stl"))`.
///
/// The gradient turns steadily outside of convex edges. It jumps across the planes that halve convex edges inside, and
/// concave ones outside, by the angle between the facets. Presses bear that: the law's energy has no step there, so
/// that a line search descends. Rounding the edges instead, on a grid, made another tool of a blade or a cone.
class MeshIndenter {
 public:
  /// Throws MeshError for a surface that bounds no solid (see validate_surface).
  explicit MeshIndenter(const TriangleSurface& surface) : field_(std::make_shared<const Field>(surface)) {
    Eigen::AlignedBox3d box;
    for (const auto& t : surface.triangles)
      for (const int n : t) {
        const Vec3d& v = surface.vertices[std::size_t(n)];
        radius_m_ = std::max(radius_m_, v.norm());
        box.extend(v);
      }
    contact_radius_m_ = 0.5 * box.sizes().minCoeff();
  }

  bool operator==(const MeshIndenter& other) const {
    const TriangleSurface &a = surface(), &b = other.surface();
    return field_ == other.field_ || (a.vertices == b.vertices && a.triangles == b.triangles);
  }

  double radius_m() const { return radius_m_; }
  double contact_radius_m() const { return contact_radius_m_; }
  double distance(const Vec3d& p) const { return field_->exact.distance(p); }
  DistanceSample sample(const Vec3d& p) const {
    const SignedDistance::Sample s = field_->exact.sample(p);
    return {s.distance, s.gradient, s.hessian};
  }
  const TriangleSurface& surface() const { return field_->surface; }

 private:
  struct Field {
    explicit Field(const TriangleSurface& s) : surface(checked(s)), exact(surface) {}
    Field(const Field&) = delete;  // the distance points into the surface
    Field& operator=(const Field&) = delete;

    static const TriangleSurface& checked(const TriangleSurface& s) {
      validate_surface(s);
      return s;
    }

    TriangleSurface surface;
    SignedDistance exact;
  };

  std::shared_ptr<const Field> field_;
  double radius_m_ = 0.0, contact_radius_m_ = 0.0;
};

inline void validate(const MeshIndenter& m) {
  require_in_range("radius about a mesh indenter's origin", m.radius_m() * 1e3, 0.05, 1000.0, "mm");
}

static_assert(Indenter<MeshIndenter>);

}  // namespace lumo
