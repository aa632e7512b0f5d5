#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/mesh/body_check.hpp"
#include "lumo/mesh/contact_slope.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "lumo/morphology/body.hpp"
#include "lumo/optics/intersector.hpp"
#include "lumo/optics/surface/carrier_cells.hpp"
#include "lumo/optics/surface/quadratic_face.hpp"
#include "lumo/optics/surface_optics.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <string_view>
#include <vector>

namespace lumo {

/// A body's surface in one state, per mesh node; each may be empty (undeformed; no contact; no slopes: normals are
/// recovered from the deformed faces alone).
struct SurfaceState {
  std::span<const Vec3d> displacement = {};    ///< [m]
  std::span<const double> contact_field = {};  ///< > 0 in contact, −infinity where there can be none
  std::span<const ContactSlope> tool_slopes = {}, carrier_slopes = {};
};

/// Place at which a ray met the scene.
struct ScenePoint {
  int face = -1;              ///< boundary face of the mesh; −1 on a carrier face
  double b1 = 0.0, b2 = 0.0;  ///< barycentric in the face (of corners 1 and 2)
  double u = 0.0, v = 0.0;    ///< barycentric in the flat triangle (of corners 1 and 2)
};

/// The surface of a body in one state, as light meets it: every face of the mesh cut into sub_facets² triangles on its
/// quadratic map, plus the carrier faces. Knows exact normals, regions, contact, and the optics of each face.
class OpticalScene {
 public:
  struct Config {
    int sub_facets = 3;  ///< each edge of a quadratic face is cut into this many; linear faces are not cut
    /// Carrier faces stand back by this, or by twice as far as the body is pressed into them if that is more.
    double carrier_gap_m = 20e-6;
    double carrier_cell_m = 2.5e-3;  ///< carrier faces are cut into cells of at most this size
  };

  /// `images`: also label regions for mirror images in the planes of this symmetry.
  /// Throws InvalidArgument for wrong sizes, numbers that are not finite (−infinity is allowed in the field), bad
  /// indices or optics, MeshError for patches off their shapes.
  OpticalScene(const Body& body, const TetMesh& mesh, const SurfaceState& state, Symmetry images, const Config& config)
      : body_(&body), n_(mesh.order == 2 ? config.sub_facets : 1) {
    require_in_range("sub-facets per edge", config.sub_facets, 1, 64, "");
    require_in_range("carrier gap", config.carrier_gap_m * 1e6, 0.0, 1000.0, "um");
    require_in_range("carrier cell", config.carrier_cell_m * 1e3, 1e-3, 1e6, "mm");
    if (mesh.order != 1 && mesh.order != 2)
      throw InvalidArgument(message("optical scene: mesh order ", mesh.order, ", must be 1 or 2"));
    for (const Patch& p : body.patches) validate(p.optics);
    for (const RigidFace& f : body.rigid_faces) validate(f.optics);
    validate(body.touched);
    if (body.regions > 0 && !body.region)
      throw InvalidArgument("optical scene: the body has regions but no region function");
    for (int i = 0; i < n_; ++i)
      for (int j = 0; i + j < n_; ++j) {
        lattice_.push_back({{{i, j}, {i + 1, j}, {i, j + 1}}});
        if (i + j + 1 < n_) lattice_.push_back({{{i + 1, j}, {i + 1, j + 1}, {i, j + 1}}});
      }
    add_faces(mesh, state);
    require_on_shapes(body, mesh);
    recover_normals(faces_, mesh.faces, body);
    body_triangles_ = triangles_.size();
    add_carrier(config);
    label(images);
  }

  const std::vector<SceneTriangle>& triangles() const { return triangles_; }

  /// Locates the point `p` [m] on triangle `t`.
  ScenePoint locate(int t, const Vec3d& p) const {
    const std::array<Vec3d, 3>& corners = triangles_[std::size_t(t)].corners;
    const auto& [a, b, c] = corners;
    const Vec3d e1 = b - a, e2 = c - a, n = e1.cross(e2);
    const double f = 1.0 / n.squaredNorm();
    // A triangle without area gives NaN, which becomes 0.
    const auto unit = [](double x) { return x > 0.0 ? std::min(x, 1.0) : 0.0; };
    double u = unit(f * n.dot((p - a).cross(e2))), v = unit(f * n.dot(e1.cross(p - a)));
    if (const double s = u + v; s > 1.0) {
      u /= s;
      v /= s;
    }
    ScenePoint r;
    r.u = u;
    r.v = v;
    if (!on_body(t)) return r;
    r.face = t / int(lattice_.size());
    const auto& l = lattice_[std::size_t(t) % lattice_.size()];
    r.b1 = (l[0][0] + u * (l[1][0] - l[0][0]) + v * (l[2][0] - l[0][0])) / n_;
    r.b2 = (l[0][1] + u * (l[1][1] - l[0][1]) + v * (l[2][1] - l[0][1])) / n_;
    return r;
  }
  /// Unit normal of triangle `t` (flat, outward).
  Vec3d flat_normal(int t) const {
    const std::array<Vec3d, 3>& corners = triangles_[std::size_t(t)].corners;
    const auto& [a, b, c] = corners;
    return (b - a).cross(c - a).normalized();
  }
  /// Unit outward normal of the deformed body.
  Vec3d smooth_normal(const ScenePoint& p) const { return faces_[std::size_t(p.face)].normal_at(p.b1, p.b2); }
  /// Undeformed position [m].
  Vec3d reference(const ScenePoint& p) const { return on_quadratic(faces_[std::size_t(p.face)].reference, p.b1, p.b2); }
  /// Deformed position on the quadratic map [m].
  Vec3d position(const ScenePoint& p) const { return on_quadratic(faces_[std::size_t(p.face)].deformed, p.b1, p.b2); }
  /// Optics that light inside the body meets under a tool.
  const SurfaceOptics& touched() const { return body_->touched; }
  /// Inside the contact set {φ > 0}, φ linear on the four sub-triangles of the face?
  bool in_contact(const ScenePoint& p) const { return faces_[std::size_t(p.face)].in_contact(p.b1, p.b2); }
  /// Region of the point, or of its mirror image `image` (bit 0: x → −x, bit 1: y → −y).
  int region(const ScenePoint& p, unsigned image) const {
    const int known = labels_[image][std::size_t(p.face)];
    if (known != mixed) return known;
    const Vec3d undeformed = reference(p);
    return region(
        faces_[std::size_t(p.face)].patch, undeformed, body_->regions_in_space ? position(p) : undeformed, image);
  }
  const SurfaceOptics& optics(int t) const {
    if (!on_body(t)) return body_->rigid_faces[std::size_t(rigid_[std::size_t(t) - body_triangles_])].optics;
    return body_->patches[std::size_t(faces_[std::size_t(t / triangles_per_face())].patch)].optics;
  }
  int triangles_per_face() const { return int(lattice_.size()); }
  /// How far a place on the body may be off its surface by rounding: a millionth of its size [m].
  double precision_m() const {
    double size = 0.0;
    for (const QuadraticFace& f : faces_)
      for (const Vec3d& p : f.reference) size = std::max(size, p.lpNorm<Eigen::Infinity>());
    return 1e-6 * size;
  }
  /// How far a node of the surface has moved, at most [m].
  double moved_m() const {
    double moved = 0.0;
    for (const QuadraticFace& f : faces_)
      for (std::size_t k = 0; k < f.reference.size(); ++k)
        moved = std::max(moved, (f.deformed[k] - f.reference[k]).norm());
    return moved;
  }
  bool on_body(int t) const { return std::size_t(t) < body_triangles_; }
  double triangle_area(int t) const {
    const std::array<Vec3d, 3>& corners = triangles_[std::size_t(t)].corners;
    const auto& [a, b, c] = corners;
    return 0.5 * (b - a).cross(c - a).norm();
  }
  double area(int face) const {
    double sum = 0.0;
    for (int k = 0; k < triangles_per_face(); ++k) sum += triangle_area(face * triangles_per_face() + k);
    return sum;
  }  ///< of its triangles [m²]
  /// May a point of a face, or of one of its mirror images, lie in a region while the body is undeformed?
  bool has_region(int face) const { return has_region_[std::size_t(face)] != 0; }
  std::size_t face_count() const { return faces_.size(); }
  /// Triangle of a face at barycentric (b1, b2), and the point of that (flat) triangle there [m].
  int triangle_at(int face, double b1, double b2, Vec3d& point) const {
    const double x = b1 * n_, y = b2 * n_;
    int i = std::clamp(int(x), 0, n_ - 1), j = std::clamp(int(y), 0, n_ - 1 - i);
    double u = x - i, v = y - j;
    const bool upper = u + v > 1.0 && i + j + 1 < n_;
    const int t = face * int(lattice_.size()) + 2 * n_ * i - i * i + 2 * j + (upper ? 1 : 0);
    const std::array<Vec3d, 3>& corners = triangles_[std::size_t(t)].corners;
    const auto& [a, b, c] = corners;
    point = upper ? Vec3d((1.0 - v) * a + (u + v - 1.0) * b + (1.0 - u) * c) : Vec3d((1.0 - u - v) * a + u * b + v * c);
    return t;
  }
  /// Corners of a face, or of one of its sub-facets (sub ≥ 0), in the undeformed body [m].
  std::array<Vec3d, 3> reference_corners(int face, int sub) const {
    const std::array<Vec3d, 6>& x = faces_[std::size_t(face)].reference;
    if (sub < 0) return {x[0], x[1], x[2]};
    std::array<Vec3d, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto& [i, j] = lattice_[std::size_t(sub)][k];
      corners[k] = on_quadratic(x, double(i) / n_, double(j) / n_);
    }
    return corners;
  }
  /// Corners of triangle `t` in the undeformed body; of a carrier face, where it stands without gap [m].
  std::array<Vec3d, 3> reference_corners(int t) const {
    if (!on_body(t)) return rigid_reference_[std::size_t(t) - body_triangles_];
    return reference_corners(t / triangles_per_face(), t % triangles_per_face());
  }
  /// Region of a place on a patch, undeformed and as it is now, or of its mirror image.
  int region(int patch, const Vec3d& reference, const Vec3d& position, unsigned image) const {
    if (!body_->region || !body_->patches[std::size_t(patch)].visible) return -1;
    const Vec3d mirror(image & 1u ? -1.0 : 1.0, image & 2u ? -1.0 : 1.0, 1.0);
    const Vec3d n = outward_normal(*body_, patch, reference);
    const int r =
        body_->region(mirror.cwiseProduct(body_->regions_in_space ? position : reference), mirror.cwiseProduct(n));
    return r >= 0 && r < body_->regions ? r : -1;
  }
  /// The region that light is seen in, if it leaves from there along `out`; −1: it is not seen.
  int seen_region(int region, const Vec3d& out) const { return body_->seen_towards.dot(out) < 0.0 ? -1 : region; }
  int patch_number(const ScenePoint& p) const { return faces_[std::size_t(p.face)].patch; }
  /// Number that distinguishes surfaces: the patch of a triangle of the body, or a carrier face.
  int surface_number(int t) const {
    return on_body(t) ? faces_[std::size_t(t / triangles_per_face())].patch
                      : int(body_->patches.size()) + rigid_[std::size_t(t) - body_triangles_];
  }
  /// A point a little inside the body from the point `p` on triangle `t`: towards the inside and the middle of the
  /// triangle.
  Vec3d pulled_inward(int t, const Vec3d& p) const {
    const std::array<Vec3d, 3>& corners = triangles_[std::size_t(t)].corners;
    const auto& [a, b, c] = corners;
    const double size = std::sqrt((b - a).cross(c - a).norm());
    return p + pull_sideways * ((a + b + c) / 3.0 - p) - pull_down * size * flat_normal(t);
  }

 private:
  static constexpr int mixed = -2;
  static constexpr double pull_sideways = 1e-4, pull_down = 1e-5;  ///< in sizes of a triangle
  void add_faces(const TetMesh& mesh, const SurfaceState& state) {
    const std::size_t nodes = mesh.nodes.size();
    const auto& [displacement, contact_field, tool_slopes, carrier_slopes] = state;
    const auto check_size = [&](std::size_t given, std::string_view what) {
      if (given != 0 && given != nodes)
        throw InvalidArgument(message("optical scene: ", given, " ", what, " for ", nodes, " nodes"));
    };
    check_size(displacement.size(), "displacements");
    check_size(contact_field.size(), "contact values");
    check_size(tool_slopes.size(), "slopes against the tool");
    check_size(carrier_slopes.size(), "slopes against the carrier");
    if (mesh.faces.empty()) throw InvalidArgument("optical scene: the mesh has no boundary faces");
    const double none = -std::numeric_limits<double>::infinity();
    faces_.reserve(mesh.faces.size());
    triangles_.reserve(mesh.faces.size() * lattice_.size());
    for (const BoundaryFace& face : mesh.faces) {
      if (face.patch < 0 || std::size_t(face.patch) >= body_->patches.size())
        throw InvalidArgument(
            message("optical scene: face of patch ", face.patch, ", the body has ", body_->patches.size()));
      QuadraticFace f;
      f.patch = face.patch;
      const Patch& patch = body_->patches[std::size_t(face.patch)];
      const std::span<const ContactSlope> slopes = patch.contactable     ? tool_slopes
                                                   : patch.meets_carrier ? carrier_slopes
                                                                         : std::span<const ContactSlope>{};
      const std::size_t given = mesh.order == 2 ? 6 : 3;
      for (std::size_t k = 0; k < given; ++k) {
        const std::size_t node = std::size_t(face.nodes[k]);
        if (face.nodes[k] < 0 || node >= nodes)
          throw InvalidArgument(message("optical scene: face with node ", face.nodes[k], " of ", nodes));
        f.reference[k] = mesh.nodes[node];
        f.deformed[k] = displacement.empty() ? mesh.nodes[node] : Vec3d(mesh.nodes[node] + displacement[node]);
        f.contact[k] = contact_field.empty() ? none : contact_field[node];
        if (!slopes.empty()) f.slope[k] = slopes[node];
        if (!f.deformed[k].allFinite() || !(f.deformed[k].cwiseAbs().maxCoeff() < largest_coordinate_m))
          throw InvalidArgument(message("optical scene: node ", node, " is not at a finite place below 1e6 m"));
        if (!(f.contact[k] < std::numeric_limits<double>::infinity()))
          throw InvalidArgument(message("optical scene: contact field of node ", node, " is ", f.contact[k]));
      }
      for (std::size_t k = given; k < 6; ++k) {
        const std::size_t a = k - 3, b = (a + 1) % 3;
        f.reference[k] = 0.5 * (f.reference[a] + f.reference[b]);
        f.deformed[k] = 0.5 * (f.deformed[a] + f.deformed[b]);
        f.contact[k] = 0.5 * (f.contact[a] + f.contact[b]);
        f.slope[k] = midway(f.slope[a], f.slope[b]);
      }
      f.leans = std::any_of(f.slope.begin(), f.slope.end(), [](const ContactSlope& s) {
        return s.weight > 0.0;
      }) && std::none_of(f.slope.begin(), f.slope.end(), [](const ContactSlope& s) { return s.normal.isZero(0.0); });
      f.may_touch = *std::max_element(f.contact.begin(), f.contact.end()) > 0.0;
      faces_.push_back(f);
      const auto at = [&](const std::array<int, 2>& k) {
        return lattice_point(f.deformed, face.nodes, n_, k[0], k[1]);
      };
      for (const auto& c : lattice_) triangles_.push_back({{at(c[0]), at(c[1]), at(c[2])}, false});
    }
  }
  // The cells are made on the face where it stands, and moved back as a whole: light that is spread over them sees the
  // same cells in every state.
  void add_carrier(const Config& config) {
    if (body_->rigid_faces.empty()) return;
    std::vector<Vec3d> soft;
    for (const QuadraticFace& f : faces_)
      if (is_dielectric(body_->patches[std::size_t(f.patch)].optics))
        soft.insert(soft.end(), f.deformed.begin(), f.deformed.end());
    std::vector<FaceFrame> frames;
    for (const RigidFace& face : body_->rigid_faces) frames.push_back(face_frame(face));
    // A body and the carrier that it rests on may cross a little, and light in the gap must still meet the carrier.
    std::vector<double> back = resting_depths(body_->rigid_faces, frames, soft);
    for (double& b : back) b = std::max(config.carrier_gap_m, 2.0 * b);
    const double rim = *std::max_element(back.begin(), back.end());
    for (std::size_t i = 0; i < body_->rigid_faces.size(); ++i) {
      const std::vector<Vec3d>& place = body_->rigid_faces[i].corners;
      const std::vector<Vec3d> corner = set_back(body_->rigid_faces[i], frames[i], back[i], rim);
      const auto cells = polygon_cells(place, config.carrier_cell_m);
      const auto moved = polygon_cells(corner, place, config.carrier_cell_m);
      for (std::size_t k = 0; k < cells.size(); ++k) {
        triangles_.push_back({moved[k], true});
        rigid_reference_.push_back(cells[k]);
        rigid_.push_back(int(i));
      }
    }
  }
  // Faces whose nodes share a region need no look-up at a hit; most do.
  void label(Symmetry images) {
    has_region_.assign(faces_.size(), 0);
    for (unsigned image = 0; image < 4; ++image) {
      if (((image & 1u) && !images.x) || ((image & 2u) && !images.y)) continue;
      for (std::size_t face = 0; face < faces_.size(); ++face) {
        const QuadraticFace& f = faces_[face];
        std::array<int, 6> r{};
        for (std::size_t k = 0; k < 6; ++k) {
          r[k] = region(f.patch, f.reference[k], f.deformed[k], image);
          const int undeformed =
              body_->regions_in_space ? region(f.patch, f.reference[k], f.reference[k], image) : r[k];
          has_region_[face] = has_region_[face] || undeformed != -1;
        }
        labels_[image].push_back(std::all_of(r.begin(), r.end(), [&](int x) { return x == r[0]; }) ? r[0] : mixed);
      }
    }
  }

  const Body* body_;
  int n_;                                                   ///< cuts per edge
  std::vector<std::array<std::array<int, 2>, 3>> lattice_;  ///< (b1, b2)·n of the corners of each sub-facet
  std::vector<QuadraticFace> faces_;
  std::vector<SceneTriangle> triangles_;
  std::vector<int> rigid_;  ///< carrier face of each triangle after those of the body
  std::vector<std::array<Vec3d, 3>> rigid_reference_;
  std::size_t body_triangles_ = 0;
  std::array<std::vector<int>, 4> labels_;  ///< per image and face: region, or `mixed`
  std::vector<char> has_region_;            ///< per face, undeformed: the same in all states
};

}  // namespace lumo
