#pragma once

#include "lumo/core/error.hpp"
#include "lumo/geometry/surface_check.hpp"
#include "lumo/mesh/fill_check.hpp"
#include "lumo/mesh/mesher.hpp"
#include "lumo/mesh/size_field.hpp"
#include "lumo/support/process/fork_server.hpp"
#include "lumo/support/process/tetgen_job.hpp"

#include <cmath>
#include <cstddef>
#include <memory>
#include <new>

namespace lumo {

/// Fills surfaces with TetGen (Si 2015, Delaunay refinement), in a process of its own: whatever TetGen does, the caller
/// sees a mesh or a MeshError. Construct it before the program starts threads: it forks a helper then (see ForkServer).
/// Copies share the helper and take turns; for two meshes at once, construct two. The library in a process of its own,
/// and not TetGen's program: wanted lengths are a function of place, which only the library asks (`tetunsuitable`).
struct TetgenMesher {
  /// For one run of TetGen [s]; after a crash there are up to three more, in turned frames
  double time_limit_s = 60.0;
  std::size_t memory_limit_bytes = std::size_t{2} << 30;  ///< for TetGen alone; not applied under AddressSanitizer
  // Beyond 1.2 and 18° refinement need not end: the finger of θ = 5,10,10,6,3 takes 0.9 s at 2 and 14° (8960
  // tetrahedra), 1.6 s at 1.2 (21320) and 1 s at 18° (11804), but is not done after 20 s at 1.1 or at 25°.
  /// Circumradius / shortest edge; 1.2 … 100; smaller means better shapes, more elements
  double radius_edge_ratio = 2.0;
  double min_dihedral_deg = 14.0;   ///< [°] refine below, as far as the surface allows; 0 … 18
  double max_dihedral_deg = 140.0;  ///< [°] improve above, without promise; 130 takes four times as long
  double size_factor = 0.8;         ///< longest circumradius / wanted edge length

  std::shared_ptr<ForkServer> helper = std::make_shared<ForkServer>(&tetgen_job);  ///< not for users

  /// The same input gives the same bits. Every edge of the input is an edge, or a chain of edges, of the mesh.
  /// The wanted edge length is evaluated here, in the calling thread, inside the bounding box; what it throws passes
  /// through. Throws MeshError; InvalidArgument if a number above is out of its range.
  LinearTets fill(const MeshInput& input) const;
};

static_assert(Mesher<TetgenMesher>);

namespace detail {

[[noreturn]] inline void throw_job_failure(const JobResult& result, double time_s, std::size_t memory) {
  using Reason = MeshError::Reason;
  switch (result.outcome) {
    case JobOutcome::timed_out:
      throw MeshError(
          Reason::timed_out, message("TetGen was stopped: it took longer than the limit of ", time_s, " s"));
    case JobOutcome::out_of_memory:
      throw MeshError(Reason::out_of_memory,
          message("TetGen was stopped: it needed more memory than the limit of ", memory, " bytes"));
    case JobOutcome::lost:
      throw MeshError(
          Reason::out_of_memory, "TetGen's helper process was lost three times: killed, or without memory for its job");
    default: break;
  }
  if (result.detail > 0) throw MeshError(Reason::crashed, message("TetGen died of signal ", result.detail));
  throw MeshError(Reason::crashed, message("TetGen or its helper process gave up, code ", -result.detail));
}

}  // namespace detail

inline LinearTets TetgenMesher::fill(const MeshInput& input) const try {
  require_positive("TetGen time limit", time_limit_s, "s");
  require_in_range("TetGen radius-edge ratio", radius_edge_ratio, 1.2, 100.0, "");
  require_in_range("TetGen smallest dihedral angle", min_dihedral_deg, 0.0, 18.0, "degrees");
  require_in_range("TetGen largest dihedral angle", max_dihedral_deg, 110.0, 180.0, "degrees");
  require_in_range("TetGen size factor", size_factor, 0.1, 10.0, "");
  const SurfaceReport surface = validate_surface(input);

  // A power of two brings the body to about unit size without rounding: TetGen has absolute tolerances.
  const double scale = std::exp2(-std::ilogb((surface.high - surface.low).maxCoeff()));
  const SizeField sizes = SizeField::sample(input.edge, surface.low, surface.high);
  TetgenRequest request;
  request.knobs = {radius_edge_ratio, min_dihedral_deg, size_factor, max_dihedral_deg, input.keep_surface, 0};
  for (const Vec3d& vertex : input.vertices)
    request.coordinates.insert(request.coordinates.end(), {scale * vertex.x(), scale * vertex.y(), scale * vertex.z()});
  for (const Facet& facet : input.facets) {
    request.counts.push_back(static_cast<std::int32_t>(facet.loop.size()));
    request.corners.insert(request.corners.end(), facet.loop.begin(), facet.loop.end());
    request.markers.push_back(
        static_cast<std::int32_t>(request.counts.size()));  // its number + 1: any patch is legal, and nothing is merged
  }
  for (const Vec3d& hole : surface.cavities)
    request.holes.insert(request.holes.end(), {scale * hole.x(), scale * hole.y(), scale * hole.z()});
  request.root = {scale * sizes.low.x(), scale * sizes.low.y(), scale * sizes.low.z(), scale * sizes.side};
  request.cells = sizes.cells;
  for (SizeField::Cell& cell : request.cells)
    for (double& length : cell.corners) length *= scale;

  JobResult result;
  for (const int turn : {0, 1, 2, 3}) {  // see tetgen_frame
    request.knobs.turn = turn;
    for (int attempt = 0; attempt < 3; ++attempt) {  // a lost helper must not change the mesh
      result = helper->run(encode(request), {time_limit_s, memory_limit_bytes});
      if (result.outcome != JobOutcome::lost) break;
    }
    if (result.outcome != JobOutcome::crashed) break;
  }
  if (result.outcome != JobOutcome::done) detail::throw_job_failure(result, time_limit_s, memory_limit_bytes);
  return checked_fill(input, surface, decode_answer(result.data), 1.0 / scale);
} catch (const std::bad_alloc&) {
  throw MeshError(MeshError::Reason::out_of_memory, "no memory left to prepare or read a mesh");
} catch (const std::length_error&) {
  throw MeshError(MeshError::Reason::crashed, "TetGen's answer is incomplete");
}

}  // namespace lumo
