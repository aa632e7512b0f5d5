#pragma once

// The only place that includes TetGen: one job, run in a process of its own. See support/tetgen.hpp.

#include "lumo/mesh/fill_check.hpp"
#include "lumo/mesh/size_field.hpp"
#include "lumo/support/process/process.hpp"

// TetGen's header declares its library interface, which throws where the program would exit, only if TETLIBRARY is
// defined.
#ifndef TETLIBRARY
#define TETLIBRARY
#endif
#include <tetgen.h>

#include <Eigen/Geometry>

#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <span>
#include <stdexcept>
#include <type_traits>
#include <vector>

namespace lumo {

/// All that TetGen needs for one mesh, as plain numbers.
struct TetgenRequest {
  struct Knobs {
    double radius_edge_ratio = 0.0;
    double min_dihedral_deg = 0.0;
    double size_factor = 0.0;  ///< a tetrahedron is split if its circumradius is above this × the wanted edge length
    double max_dihedral_deg = 0.0;
    std::int32_t keep_surface = 0;
    std::int32_t turn = 0;  ///< which of the job's frames to work in, 0 for the given one
  };
  Knobs knobs;
  std::vector<double> coordinates;   ///< 3 per vertex
  std::vector<std::int32_t> counts;  ///< corners of each facet
  std::vector<std::int32_t> corners;
  std::vector<std::int32_t> markers;  ///< of each facet, > 0
  std::vector<double> holes;          ///< 3 per cavity: a point inside it
  std::array<double, 4> root{};       ///< low corner and side of the size field
  std::vector<SizeField::Cell> cells;
};

namespace detail {

template <class T> void append_values(JobBytes& bytes, const std::vector<T>& values) {
  static_assert(std::is_trivially_copyable_v<T>);
  const std::uint64_t count = values.size();
  const auto* head = reinterpret_cast<const char*>(&count);
  bytes.insert(bytes.end(), head, head + sizeof count);
  const auto* data = reinterpret_cast<const char*>(values.data());
  bytes.insert(bytes.end(), data, data + count * sizeof(T));
}

/// Throws std::length_error if the bytes end too early.
template <class T> void take_values(std::span<const char>& bytes, std::vector<T>& values) {
  std::uint64_t count = 0;
  if (bytes.size() < sizeof count) throw std::length_error("message ends early");
  std::memcpy(&count, bytes.data(), sizeof count);
  bytes = bytes.subspan(sizeof count);
  if (count > bytes.size() / sizeof(T)) throw std::length_error("message ends early");
  values.resize(count);
  if (count > 0) std::memcpy(static_cast<void*>(values.data()), bytes.data(), count * sizeof(T));
  bytes = bytes.subspan(count * sizeof(T));
}

}  // namespace detail

inline JobBytes encode(const TetgenRequest& request) {
  JobBytes bytes;
  detail::append_values(bytes, std::vector<TetgenRequest::Knobs>{request.knobs});
  detail::append_values(bytes, request.coordinates);
  detail::append_values(bytes, request.counts);
  detail::append_values(bytes, request.corners);
  detail::append_values(bytes, request.markers);
  detail::append_values(bytes, request.holes);
  detail::append_values(bytes, std::vector<double>(request.root.begin(), request.root.end()));
  detail::append_values(bytes, request.cells);
  return bytes;
}

inline TetgenRequest decode_request(std::span<const char> bytes) {
  TetgenRequest request;
  std::vector<TetgenRequest::Knobs> knobs;
  std::vector<double> root;
  detail::take_values(bytes, knobs);
  detail::take_values(bytes, request.coordinates);
  detail::take_values(bytes, request.counts);
  detail::take_values(bytes, request.corners);
  detail::take_values(bytes, request.markers);
  detail::take_values(bytes, request.holes);
  detail::take_values(bytes, root);
  detail::take_values(bytes, request.cells);
  request.knobs = knobs.at(0);
  for (std::size_t i = 0; i < 4; ++i) request.root[i] = root.at(i);
  return request;
}

inline JobBytes encode(const RawFill& answer) {
  JobBytes bytes;
  detail::append_values(bytes, answer.coordinates);
  detail::append_values(bytes, answer.tets);
  detail::append_values(bytes, answer.faces);
  detail::append_values(bytes, answer.facets);
  return bytes;
}

inline RawFill decode_answer(std::span<const char> bytes) {
  RawFill answer;
  detail::take_values(bytes, answer.coordinates);
  detail::take_values(bytes, answer.tets);
  detail::take_values(bytes, answer.faces);
  detail::take_values(bytes, answer.facets);
  return answer;
}

/// TetGen's callback has no context argument. Set in the job's own process only.
struct TetgenSizes {
  SizeField field;
  double factor = 1.0;
  Mat3d back = Mat3d::Identity();  ///< from the job's frame to the given one
};
inline const TetgenSizes* tetgen_sizes = nullptr;

/// Whether a tetrahedron is too large: circumradius against the wanted edge length at its middle.
inline bool tetgen_too_large(double* pa, double* pb, double* pc, double* pd, double*, double) {
  using Point = Eigen::Map<const Eigen::Vector3d>;
  const Vec3d a = Point(pa);
  const Vec3d u = Point(pb) - a;
  const Vec3d v = Point(pc) - a;
  const Vec3d w = Point(pd) - a;
  const Vec3d numerator = u.squaredNorm() * v.cross(w) + v.squaredNorm() * w.cross(u) + w.squaredNorm() * u.cross(v);
  const double volume6 = std::abs(u.dot(v.cross(w)));
  const double limit = tetgen_sizes->factor * tetgen_sizes->field(tetgen_sizes->back * (a + 0.25 * (u + v + w)));
  return numerator.norm() > 2.0 * volume6 * limit;
}

/// TetGen 1.5 fails an assertion on about 1 in 100 turned prisms, where corners of a flat facet are a rounding error
/// off its plane. In another frame the rounding errors are others, and it passes.
inline Mat3d tetgen_frame(int turn) {
  if (turn == 0) return Mat3d::Identity();
  return Eigen::Quaterniond(4.0, 1.0, 2.0 * turn, 3.0).normalized().toRotationMatrix();
}

namespace detail {

/// What TetGen reads: views of numbers that must live as long as it runs.
struct TetgenInput {
  tetgenio io;
  std::vector<double> points, holes;  ///< in the job's frame
  std::vector<tetgenio::polygon> polygons;
  std::vector<tetgenio::facet> facets;

  TetgenInput(TetgenRequest& request, const Mat3d& frame)
      : points(request.coordinates),
        holes(request.holes),
        polygons(request.counts.size()),
        facets(request.counts.size()) {
    if (request.knobs.turn != 0)
      for (std::vector<double>* numbers : {&points, &holes})
        for (std::size_t i = 0; i + 2 < numbers->size(); i += 3) {
          Eigen::Map<Eigen::Vector3d> point(&(*numbers)[i]);
          point = frame * Vec3d(point);
        }
    io.numberofpoints = static_cast<int>(points.size() / 3);
    io.pointlist = points.data();
    io.numberoffacets = static_cast<int>(request.counts.size());
    int first = 0;
    for (std::size_t i = 0; i < facets.size(); ++i) {
      polygons[i] = {request.corners.data() + first, request.counts[i]};
      facets[i] = {&polygons[i], 1, nullptr, 0};
      first += request.counts[i];
    }
    io.facetlist = facets.data();
    io.facetmarkerlist = request.markers.data();
    io.numberofholes = static_cast<int>(holes.size() / 3);
    io.holelist = holes.data();
  }
};

/// TetGen's output in the given frame; the given vertices get their own bits back.
inline RawFill tetgen_answer(
    const tetgenio& output, const TetgenRequest& request, const TetgenInput& input, const Mat3d& frame) {
  using Point = Eigen::Map<Eigen::Vector3d>;
  using GivenPoint = Eigen::Map<const Eigen::Vector3d>;
  RawFill answer;
  answer.coordinates.assign(output.pointlist, output.pointlist + 3 * output.numberofpoints);
  for (std::size_t i = 0; request.knobs.turn != 0 && i + 2 < answer.coordinates.size(); i += 3) {
    Point point(&answer.coordinates[i]);
    const bool given = i + 2 < input.points.size() && point == GivenPoint(&input.points[i]);
    point = given ? Vec3d(GivenPoint(&request.coordinates[i])) : Vec3d(frame.transpose() * Vec3d(point));
  }
  answer.tets.assign(output.tetrahedronlist, output.tetrahedronlist + 4 * output.numberoftetrahedra);
  answer.faces.assign(output.trifacelist, output.trifacelist + 3 * output.numberoftrifaces);
  answer.facets.assign(output.trifacemarkerlist, output.trifacemarkerlist + output.numberoftrifaces);
  return answer;
}

}  // namespace detail

/// Fills the request's surface. Runs in the job's own process: TetGen may throw, crash or never end, and nothing is
/// freed.
inline JobBytes tetgen_job(std::span<const char> bytes) {
  TetgenRequest request = decode_request(bytes);
  const Mat3d frame = tetgen_frame(request.knobs.turn);
  auto* input = new detail::TetgenInput(request, frame);  // as long as the process: TetGen's arrays mix new and malloc
  auto* output = new tetgenio;
  TetgenSizes sizes{
      {Vec3d(request.root[0], request.root[1], request.root[2]), request.root[3], std::move(request.cells)},
      request.knobs.size_factor, frame.transpose()};
  if (!sizes.field.cells.empty()) {
    tetgen_sizes = &sizes;
    input->io.tetunsuitable = tetgen_too_large;
  }
  tetgenbehavior behavior;
  char options[] = "pqQ";
  char keep[] = "pqQY";
  char* switches = request.knobs.keep_surface != 0 ? keep : options;
  if (!behavior.parse_commandline(0, &switches)) throw std::invalid_argument("TetGen refuses its options");
  // As numbers, not as text: TetGen reads text in the host's locale.
  behavior.minratio = request.knobs.radius_edge_ratio;
  behavior.mindihedral = request.knobs.min_dihedral_deg;
  behavior.optmaxdihedral = request.knobs.max_dihedral_deg;  // above: flips, then smoothing, then splitting
  behavior.optminsmtdihed = request.knobs.max_dihedral_deg;
  behavior.optminslidihed = request.knobs.max_dihedral_deg;
  tetrahedralize(&behavior, &input->io, output, nullptr, nullptr);
  return encode(detail::tetgen_answer(*output, request, *input, frame));
}

}  // namespace lumo
