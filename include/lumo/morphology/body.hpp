#pragma once

#include "lumo/core/types.hpp"
#include "lumo/geometry/closed_surface.hpp"
#include "lumo/morphology/emitter.hpp"
#include "lumo/morphology/shape.hpp"
#include "lumo/morphology/silicone.hpp"

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace lumo {

/// A part of a body's closed surface on which all tags are the same.
struct Patch {
  std::string name;
  Shape shape = Plane{};       ///< the exact surface; mesh nodes of the patch lie on it
  bool bonded = false;         ///< fixed to the carrier (closed set: its edge nodes are fixed too)
  bool contactable = false;    ///< the indenter may touch it
  bool meets_carrier = false;  ///< may come to rest on the carrier
  SurfaceOptics optics = Dielectric{};
  bool visible = true;  ///< on the outside: light that leaves here may lie in a region
};

/// A rigid axis-aligned box that the silicone can come to rest on.
struct RigidBox {
  Vec3d center{0.0, 0.0, 0.0};  ///< [m]
  Vec3d half{1.0, 1.0, 1.0};    ///< half edges [m]
  /// Of all its edges and corners, inside the box; 0: sharp [m]. Where silicone slides over sharp edges, what becomes
  /// of a press depends on the steps that lead to it.
  double edge_radius = 0.0;
};

/// Wanted edge length of the mesh [m] at a place: across and along y. Elements are stretched by the ratio of the two.
struct Sizing {
  std::function<double(const Vec3d&)> edge;  ///< across y [m]
  double stretch_y = 1.0;                    ///< edges along y are this much longer
  /// Finer edges [m] at a place when a tool touches the body at another; empty: none are wanted.
  std::function<double(const Vec3d& place, const Vec3d& touch)> edge_under_touch;
};

/// One soft, transparent body on a rigid carrier: all that meshing, mechanics and optics need to know.
/// SI units, finger frame (x lateral, y along the finger, z outward normal).
struct Body {
  static constexpr int mirror_patch = -1;

  std::string name;
  std::vector<Patch> patches;
  std::vector<Vec3d> vertices;  ///< of the boundary of the meshed sector [m]
  /// Closed boundary of the sector x ≥ 0 and/or y ≥ 0 that `symmetry` leaves. Facet::patch: index into `patches`, or
  /// mirror_patch for a face in a symmetry plane.
  std::vector<Facet> facets;
  Symmetry symmetry;  ///< the whole body is the sector and its mirror images
  Sizing sizing;
  double exact_volume_m3 = 0.0;  ///< of the whole body; 0 when not known

  std::vector<RigidBox> carrier;  ///< union of boxes; what patches rest on
  Vec3d pivot{0.0, 0.0, 0.0};     ///< approach directions turn about this point (shifted by the place) [m]

  Medium medium;        ///< inside
  Medium surroundings;  ///< outside (air)
  /// What light in the body meets where a tool touches; Dielectric: a film of air is left between
  SurfaceOptics touched = Dielectric{};
  std::vector<RigidFace> rigid_faces;  ///< carrier faces seen through air
  std::vector<Emitter> emitters;
  /// Height of the film of air over an emitter in air at which it begins to close [m]; 0: where the body reaches the
  /// emitter; nullopt: never.
  std::optional<double> film_closes_m = 0.0;
  int regions = 0;  ///< number of readout regions
  /// Region of a point of the surface, from its position [m] and exact undeformed outward normal: 0 … regions−1, or −1.
  std::function<int(const Vec3d& position, const Vec3d& normal)> region;
  bool regions_in_space = false;  ///< region() is asked for where a point is, not for where it was undeformed
  /// Light that leaves against this direction is not seen; 0: all is.
  Vec3d seen_towards = Vec3d::Zero();
  /// Region → its mirror image in x = 0 and y = 0; empty: itself; nullopt: what region() says of mirror images
  /// (region_images). One that contradicts region() is refused.
  std::optional<std::vector<int>> region_image_x, region_image_y;
};

/// Exact outward normal at the point of a patch nearest to `p`, also in the mirror images of the sector that the patch
/// describes.
inline Vec3d outward_normal(const Body& body, int patch, const Vec3d& p) {
  const Vec3d fold(body.symmetry.x && p.x() < 0.0 ? -1.0 : 1.0, body.symmetry.y && p.y() < 0.0 ? -1.0 : 1.0, 1.0);
  return fold.cwiseProduct(outward_normal(body.patches[std::size_t(patch)].shape, fold.cwiseProduct(p)));
}

}  // namespace lumo
