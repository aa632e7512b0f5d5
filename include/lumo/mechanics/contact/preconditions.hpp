#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mechanics/contact/first_touch.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "lumo/morphology/body.hpp"

#include <algorithm>
#include <cstddef>

namespace lumo {

/// Throws InvalidArgument for a body that no bonded patch and no carrier holds. Patches must be the body's.
inline void require_held(const Body& body, const TetMesh& mesh) {
  for (const BoundaryFace& f : mesh.faces) {
    const Patch& patch = body.patches[std::size_t(f.patch)];
    if (patch.bonded || (patch.meets_carrier && !body.carrier.empty())) return;
  }
  throw InvalidArgument("no patch is bonded: the body can move as a whole");
}

/// Throws InvalidArgument if the tool, where it first touches, has already run into nodes of a patch that it may not
/// touch: contact there is not computed, so that it would go through.
template <Indenter Tool>
void require_free_way(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario, const Touch& touch) {
  constexpr double precision = 1e-6;  // of the body's size, as of its surface
  double size = 0.0, least = 0.0;
  int met = -1;
  for (const BoundaryFace& f : mesh.faces)
    for (std::size_t k = 0; k < std::size_t(mesh.nodes_per_face()); ++k) {
      const Vec3d& p = mesh.nodes[std::size_t(f.nodes[k])];
      size = std::max(size, p.lpNorm<Eigen::Infinity>());
      if (body.patches[std::size_t(f.patch)].contactable) continue;
      const double gap = scenario.indenter.distance(Vec3d(p - touch.origin));
      if (gap >= least) continue;
      least = gap;
      met = f.patch;
    }
  if (least >= -precision * size) return;
  throw InvalidArgument(
      message(detail::approach(scenario), " meets patch \"", printable(body.patches[std::size_t(met)].name),
          "\", which may not be touched, ", -1e3 * least, " mm deep when it first touches the body"));
}

}  // namespace lumo
