#pragma once

#include "lumo/mechanics/indenters/distance_grid.hpp"

#include <algorithm>
#include <memory>

namespace lumo {

/// Rigid tool of any closed triangle surface, by the signed distance on a grid; the surface's own coordinates are the
/// tool's frame. Copies share the grid. `MeshIndenter tool(read_surface("knob.stl"))`.
class MeshIndenter {
 public:
  /// Throws as DistanceGrid does.
  explicit MeshIndenter(const TriangleSurface& surface, int cells = 64)
      : grid_(std::make_shared<const DistanceGrid>(surface, cells)) {
    Eigen::AlignedBox3d box;
    for (const Vec3d& v : surface.vertices) {
      radius_m_ = std::max(radius_m_, v.norm());
      box.extend(v);
    }
    contact_radius_m_ = 0.5 * box.sizes().minCoeff();
  }

  /// The same surface on as fine a grid.
  bool operator==(const MeshIndenter& other) const {
    const TriangleSurface &a = grid_->surface(), &b = other.grid_->surface();
    return grid_ == other.grid_ ||
           (grid_->spacing_m() == other.grid_->spacing_m() && a.vertices == b.vertices && a.triangles == b.triangles);
  }

  double radius_m() const { return radius_m_; }
  double contact_radius_m() const { return contact_radius_m_; }
  double distance(const Vec3d& p) const { return grid_->distance(p); }
  DistanceSample sample(const Vec3d& p) const { return grid_->sample(p); }
  const DistanceGrid& grid() const { return *grid_; }

 private:
  std::shared_ptr<const DistanceGrid> grid_;
  double radius_m_ = 0.0, contact_radius_m_ = 0.0;
};

inline void validate(const MeshIndenter& m) {
  require_in_range("radius about a mesh indenter's origin", m.radius_m() * 1e3, 0.05, 1000.0, "mm");
}

static_assert(Indenter<MeshIndenter>);

}  // namespace lumo
