#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mesh/quality.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "lumo/morphology/body.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace lumo {

/// Throws MeshError, which says what and where, unless the mesh is valid, each face's patch is one of the body's, and
/// the carrier's boxes are finite, of positive size, and rounded by no more than their half edges.
inline void require_valid(const Body& body, const TetMesh& mesh);

/// Throws MeshError unless nodes of the boundary lie on their patches' exact shapes, within a millionth of the body's
/// size; mesh_body() places them so, middle nodes too. The message names the worst patch and its largest distance.
/// Indices must be in range. Throws InvalidArgument for a shape whose own validate() refuses it.
inline void require_on_shapes(const Body& body, const TetMesh& mesh);

/// The same for the vertices of the body's facets: what is meshed is moved onto the shapes, however far. Throws
/// MeshError, also for a facet of a patch or with a vertex that is not there.
inline void require_on_shapes(const Body& body);

inline void require_valid(const Body& body, const TetMesh& mesh) {
  using Reason = MeshError::Reason;
  require_valid(mesh);
  for (std::size_t f = 0; f < mesh.faces.size(); ++f)
    if (const int patch = mesh.faces[f].patch; patch < 0 || std::size_t(patch) >= body.patches.size())
      throw MeshError(Reason::bad_index, message("mesh face ", f, " is of patch ", patch,
                                             ", the body has patches 0 to ", int(body.patches.size()) - 1));
  for (std::size_t k = 0; k < body.carrier.size(); ++k) {
    const RigidBox& box = body.carrier[k];
    if (!box.center.allFinite() || !box.half.allFinite() || !std::isfinite(box.edge_radius))
      throw MeshError(Reason::not_finite, message("carrier box ", k, " has a number that is not finite"));
    if (const double least = box.half.minCoeff(); !(least > 0.0))
      throw MeshError(
          Reason::degenerate, message("carrier box ", k, " has a half edge of ", least * 1e3, " mm, must be > 0 mm"));
    if (!(box.edge_radius >= 0.0 && box.edge_radius <= box.half.minCoeff()))
      throw MeshError(Reason::degenerate, message("carrier box ", k, " is rounded by ", box.edge_radius * 1e3,
                                              " mm, must lie in [0, ", box.half.minCoeff() * 1e3, "] mm"));
  }
}

namespace detail {

// How far points are off the shapes of the patches that they should lie on.
class ShapeCheck {
 public:
  explicit ShapeCheck(const Body& body) : body_(body) {
    for (const Patch& p : body.patches) try {
        validate(p.shape);
      } catch (const InvalidArgument& e) {
        throw InvalidArgument(message("patch \"", printable(p.name), "\": ", e.what()));
      }
  }

  void add(int patch, const Vec3d& at) {
    const Vec3d p(body_.symmetry.x ? std::abs(at.x()) : at.x(), body_.symmetry.y ? std::abs(at.y()) : at.y(), at.z());
    size_ = std::max(size_, p.lpNorm<Eigen::Infinity>());
    const double apart = (closest_point(body_.patches[std::size_t(patch)].shape, p) - p).norm();
    if (apart <= worst_ || std::isnan(worst_)) return;
    worst_ = apart;
    patch_ = patch;
  }
  void require(const char* points) const {
    constexpr double precision = 1e-6;  // of the body's size: coordinates that went through single precision pass
    if (worst_ <= precision * size_) return;
    throw MeshError(std::isfinite(worst_) ? MeshError::Reason::inaccurate : MeshError::Reason::not_finite,
        message("patch \"", printable(body_.patches[std::size_t(patch_)].name), "\" has ", points, " up to ",
            worst_ * 1e3, " mm off its shape, at most ", precision * size_ * 1e3, " mm"));
  }

 private:
  const Body& body_;
  double size_ = 0.0, worst_ = 0.0;
  int patch_ = -1;
};

}  // namespace detail

inline void require_on_shapes(const Body& body, const TetMesh& mesh) {
  detail::ShapeCheck check(body);
  for (const BoundaryFace& f : mesh.faces)
    for (std::size_t k = 0; k < std::size_t(mesh.nodes_per_face()); ++k)
      check.add(f.patch, mesh.nodes[std::size_t(f.nodes[k])]);
  check.require("nodes");
}

inline void require_on_shapes(const Body& body) {
  detail::ShapeCheck check(body);
  for (std::size_t f = 0; f < body.facets.size(); ++f) {
    const Facet& facet = body.facets[f];
    if (facet.patch == Body::mirror_patch) continue;
    if (facet.patch < 0 || std::size_t(facet.patch) >= body.patches.size())
      throw MeshError(MeshError::Reason::bad_index, message("facet ", f, " is of patch ", facet.patch,
                                                        ", the body has patches 0 to ", int(body.patches.size()) - 1));
    for (const int vertex : facet.loop) {
      if (vertex < 0 || std::size_t(vertex) >= body.vertices.size())
        throw MeshError(MeshError::Reason::bad_index,
            message("facet ", f, " names vertex ", vertex, ", the body has ", body.vertices.size()));
      check.add(facet.patch, body.vertices[std::size_t(vertex)]);
    }
  }
  check.require("vertices");
}

}  // namespace lumo
