#pragma once

#include "lumo/morphology/body.hpp"
#include "lumo/morphology/finger_carrier.hpp"
#include "lumo/morphology/finger_options.hpp"
#include "lumo/morphology/section.hpp"
#include "lumo/morphology/silicone.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <variant>
#include <vector>

namespace lumo {

/// The whole finger of a feasible design as a body. The quarter x ≥ 0, y ≥ 0 of a pad without a cap is described, the
/// half x ≥ 0 of one with a cap; the rest is mirrored. Throws InfeasibleDesign or InvalidArgument. Source: paper §III-A
/// and Table I.
inline Body finger(const FingerDesign& design, const Silicone& silicone, const FingerOptions& options = {});

namespace detail {

inline Patch finger_patch(SectionTag tag, const HalfSection& s, const FingerOptions& o) {
  const bool supported = s.twin != Twin::unsupported_base;
  const double w = 0.5e-3 * s.pad.width, hs = 1e-3 * s.design.h_s, stem = 0.5e-3 * s.design.w_s;
  const SurfaceOptics wall = Lambertian{o.carrier_albedo};
  const bool mouth = o.readout.by_direction;  // light out of the cavity is seen, too
  switch (tag) {
    case SectionTag::stem_top: return {"stem_top", Plane{{0, 0, hs}, -Vec3d::UnitZ()}, true, false, false, wall};
    case SectionTag::stem_side: return {"stem_side", Plane{{stem, 0, 0}, -Vec3d::UnitX()}, true, false, false, wall};
    case SectionTag::base:
      return {"base", Plane{{0, 0, std::min(0.0, s.z[0])}, -Vec3d::UnitZ()}, supported, false, false, wall};
    case SectionTag::shoulder_wall:
      return {"shoulder_wall", Plane{{1e-3 * s.pad.lip_end(), 0, 0}, -Vec3d::UnitX()}, supported, false, false, wall};
    case SectionTag::shoulder_top:
      return {
          "shoulder_top", Plane{{0, 0, -1e-3 * s.pad.shoulder_height}, -Vec3d::UnitZ()}, supported, false, false, wall};
    case SectionTag::void_inner:
      return {"void_inner", Plane{{stem, 0, 0}, Vec3d::UnitX()}, false, false, false, Dielectric{}, mouth};
    case SectionTag::void_roof:
      return {"void_roof", Plane{{0, 0, hs}, -Vec3d::UnitZ()}, false, false, supported, Dielectric{}, mouth};
    case SectionTag::void_wall:
      return {"void_wall", Plane{{stem + 1e-3 * s.design.w_v, 0, 0}, -Vec3d::UnitX()}, false, false, supported,
          Dielectric{}, mouth};
    case SectionTag::side: return {"side", Plane{{w, 0, 0}, Vec3d::UnitX()}, false, true, false, Dielectric{}};
    default:
      return {"dome", EllipticCylinder{{0, 0, 1e-3 * s.design.h_fp}, w, 1e-3 * s.design.h_ep}, false, true, false,
          Dielectric{}};
  }
}

inline void add_light(Body& body, const HalfSection& s, const Silicone& silicone, const FingerOptions& o) {
  body.medium = silicone.medium();
  if (!has_stem(s.twin)) return;
  const auto& led = o.leds;
  const double stem = 0.5e-3 * s.design.w_s, height = 1e-3 * s.design.h_s;
  const Vec3d along(0, 0.5 * led.length_y, 0);
  const double recess = s.lies_on_stem() ? o.recess.depth : 0.0;
  for (const double y : led_places(led)) {
    if (led.place == FingerOptions::Leds::Place::top) {
      body.emitters.push_back(RectangleEmitter{
          {0, y, height - recess}, {0.5 * led.width_x, 0, 0}, along, led.power_W / led.count, 0, recess > 0.0});
      continue;
    }
    const bool air = s.design.w_v > 0.0;
    require_in_range("height of the LEDs on the stem's sides", led.width_x * 1e3, 1e-3, s.design.h_s, "mm");
    for (const double side : {1.0,
             -1.0})  // in air, with the face that stands back (OpticalScene::Config::carrier_gap_m), but in front of it
      body.emitters.push_back(RectangleEmitter{{side * (stem - (air ? 10e-6 : 0.0)), y, 0.5 * height}, along,
          {0, 0, side * 0.5 * led.width_x}, 0.5 * led.power_W / led.count, 0, air});
  }
  const auto r = o.readout;
  body.film_closes_m = o.recess.film_closes;
  body.touched = o.touched;
  body.regions = r.bins;
  body.regions_in_space = r.in_space;
  std::vector<int> other_end;
  for (int b = 0; b < r.bins; ++b) other_end.push_back(r.bins - 1 - b);
  body.region_image_y = other_end;
  if (r.one_side && r.by_direction) body.seen_towards = Vec3d::UnitX();
  body.region = [r](const Vec3d& p, const Vec3d& n) {
    const bool turned_away = (r.one_side ? n.x() : std::abs(n.x())) < r.min_abs_nx;
    if ((turned_away && !r.by_direction) || std::abs(p.y()) > r.half_range) return -1;
    const double bin = (p.y() + r.half_range) / (2.0 * r.half_range) * r.bins;
    return std::clamp(int(bin), 0, r.bins - 1);
  };
}

// Boundary of a sector that is swept along y, and its patches by what the section's edges are.
class SweptBoundary {
 public:
  SweptBoundary(Body& body, const HalfSection& section, const FingerOptions& options)
      : body_(body), section_(section), options_(options) {}

  int vertex(double x, double y, double z) {
    body_.vertices.emplace_back(x, y, z);
    return int(body_.vertices.size()) - 1;
  }
  void facet(std::vector<int> loop, int patch) { body_.facets.push_back({std::move(loop), patch}); }
  int patch(SectionTag tag) {
    if (tag == SectionTag::mirror) return Body::mirror_patch;
    int& patch = patch_of_[std::size_t(tag)];
    if (patch < 0) patch = add(finger_patch(tag, section_, options_));
    return patch;
  }
  int add(Patch p) {
    body_.patches.push_back(std::move(p));
    return int(body_.patches.size()) - 1;
  }

 private:
  Body& body_;
  const HalfSection& section_;
  const FingerOptions& options_;
  std::vector<int> patch_of_ = std::vector<int>(std::size_t(SectionTag::dome) + 1, -1);
};

inline Patch end_face(const char* name, double y, double outwards, const FingerOptions& o) {
  return {name, Plane{{0, y, 0}, outwards * Vec3d::UnitY()}, o.bonded_ends || o.twin == Twin::unsupported_base, false,
      false, Dielectric{}};
}

// The sector of a pad whose section is the same all along: a quarter where the body is symmetric in y, else a half.
inline void sweep_prism(Body& body, const HalfSection& s, const FingerOptions& o) {
  SweptBoundary boundary(body, s, o);
  const double from = body.symmetry.y ? 0.0 : 1e-3 * o.pad.proximal_end(), to = 1e-3 * o.pad.distal_end();
  const std::size_t n = s.x.size();
  std::vector<int> near, far;
  for (std::size_t k = 0; k < n; ++k) {
    near.push_back(boundary.vertex(s.x[k], from, s.z[k]));
    far.push_back(boundary.vertex(s.x[k], to, s.z[k]));
  }
  for (std::size_t k = 0; k < n; ++k) {
    const std::size_t next = (k + 1) % n;
    boundary.facet({near[k], far[k], far[next], near[next]}, boundary.patch(s.tag[k]));
  }
  boundary.facet(near, body.symmetry.y ? Body::mirror_patch : boundary.add(end_face("proximal_end", from, -1.0, o)));
  boundary.facet(
      {far.rbegin(), far.rend()}, boundary.add(end_face(body.symmetry.y ? "end" : "distal_end", to, 1.0, o)));
}

// Lines of vertices on a cavity's roof, from its proximal end to its distal one, broken at the edges of ridges; empty
// on a stem that holds the silicone.
struct RoofSeams {
  std::vector<int> axis, stem;  // x = 0, and above the stem's edge
  bool at_wall(int first_of_wall) const { return stem.front() == first_of_wall; }
};

// `axis` and `wall`: vertices at both ends of the roof's edges.
inline RoofSeams add_seams(SweptBoundary& boundary, const HalfSection& s, const FingerOptions& o,
    const std::array<int, 2>& axis, const std::array<int, 2>& wall) {
  if (!s.lies_on_stem()) return {};
  const StemLengths at(s, o);
  const bool ends_at_wall = at.outer <= at.stem;
  std::vector<double> breaks;
  for (const auto& [low, high] : recess_floors(stem_ridges(o))) breaks.insert(breaks.end(), {low, high});
  RoofSeams seams{{axis[0]}, {ends_at_wall ? wall[0] : boundary.vertex(at.stem, -at.half_length, at.height)}};
  for (const double y : breaks) {
    seams.axis.push_back(boundary.vertex(0.0, y, at.height));
    seams.stem.push_back(boundary.vertex(at.stem, y, at.height));
  }
  seams.axis.push_back(axis[1]);
  seams.stem.push_back(ends_at_wall ? wall[1] : boundary.vertex(at.stem, at.half_length, at.height));
  return seams;
}

// A roof cut along its seams; `loop` is that of the whole: near and far end at the axis, far and near end at the wall.
inline void add_roof(SweptBoundary& boundary, const RoofSeams& seams, const std::vector<int>& loop, int patch) {
  for (std::size_t i = 0; i + 1 < seams.axis.size(); ++i)
    boundary.facet({seams.axis[i], seams.axis[i + 1], seams.stem[i + 1], seams.stem[i]}, patch);
  if (seams.at_wall(loop[3])) return;
  std::vector<int> beside(seams.stem);
  beside.insert(beside.end(), {loop[2], loop[3]});
  boundary.facet(beside, patch);
}

// The half of a pad with a solid cap. Points of the section inside its outline end where the cap begins, those of the
// outline go on.
inline void sweep_capped_half(Body& body, const HalfSection& s, const HalfSection& cap, const FingerOptions& o) {
  SweptBoundary boundary(body, s, o);
  const double from = 1e-3 * o.pad.proximal_end(), joint = 0.5e-3 * o.pad.length, to = 1e-3 * o.pad.distal_end();
  const int n = int(s.x.size());
  const auto place = [&](SectionTag tag) { return int(std::find(s.tag.begin(), s.tag.end(), tag) - s.tag.begin()); };
  const int side = place(SectionTag::side);
  std::vector<int> near, far;  // vertices of each point
  for (int k = 0; k < n; ++k) {
    const double x = s.x[std::size_t(k)], z = s.z[std::size_t(k)];
    near.push_back(boundary.vertex(x, from, z));
    far.push_back(boundary.vertex(x, k < side ? joint : to, z));
  }
  const int low_joint = boundary.vertex(0.0, joint, cap.z[0]), low_end = boundary.vertex(0.0, to, cap.z[0]);
  const RoofSeams seams = add_seams(boundary, s, o, {near[0], far[0]}, {near[1], far[1]});
  for (int k = 0; k + 1 < n; ++k) {
    const std::size_t i = std::size_t(k);
    std::vector<int> loop{near[i], far[i]};
    if (k + 1 == side) loop.insert(loop.end(), {low_joint, low_end});  // this plane goes on under the cap
    loop.insert(loop.end(), {far[i + 1], near[i + 1]});
    if (!seams.stem.empty() && k == 0) add_roof(boundary, seams, loop, boundary.patch(s.tag[i]));
    else if (!seams.stem.empty() && k == 1 && seams.at_wall(near[1])) {
      loop.insert(loop.begin() + 1, seams.stem.begin() + 1, seams.stem.end() - 1);
      boundary.facet(loop, boundary.patch(s.tag[i]));
    } else boundary.facet(loop, boundary.patch(s.tag[i]));
  }

  // The cap's wall: against cavity and stem, and, where the carrier is a stair, against its block.
  const int base = place(SectionTag::base), wall = boundary.add({"cap_wall", Plane{{0, joint, 0}, -Vec3d::UnitY()},
                                                false, false, true, Dielectric{}, o.readout.by_direction});
  const bool stair = cap.z[0] < 0.0;
  const int corner = stair ? boundary.vertex(0.0, joint, 0.0) : low_joint;
  std::vector<int> upper{corner};
  for (int k = base; k >= 0; --k) {
    if (k == 0 && !seams.stem.empty() && !seams.at_wall(near[1])) upper.push_back(seams.stem.back());
    upper.push_back(far[std::size_t(k)]);
  }
  boundary.facet(upper, wall);
  std::vector<int> mirror{near[std::size_t(n - 1)], far[std::size_t(n - 1)], low_end, low_joint};
  if (stair) {
    const int block = boundary.add({"cap_block", Plane{{0, joint, 0}, -Vec3d::UnitY()}, false, false, false,
        Dielectric{}, o.readout.by_direction});
    std::vector<int> lower{low_joint};
    for (int k = side - 1; k >= base; --k) lower.push_back(far[std::size_t(k)]);
    lower.push_back(corner);
    boundary.facet(lower, block);
    mirror.push_back(corner);
  }
  mirror.push_back(far[0]);
  if (!seams.axis.empty()) mirror.insert(mirror.end(), seams.axis.rbegin() + 1, seams.axis.rend() - 1);
  mirror.push_back(near[0]);
  boundary.facet(mirror, Body::mirror_patch);

  if (!seams.stem.empty() && !seams.at_wall(near[1])) near.insert(near.begin() + 1, seams.stem.front());
  boundary.facet(near, boundary.add(end_face("proximal_end", from, -1.0, o)));
  std::vector<int> distal;
  for (int k = n - 1; k >= side; --k) distal.push_back(far[std::size_t(k)]);
  distal.push_back(low_end);
  boundary.facet(distal, boundary.add(end_face("distal_end", to, 1.0, o)));
}

// Distance from p to the nearest edge of the stem's top and of its recesses [m].
inline double distance_to_stem_edges(const Vec3d& p, const StemLengths& at, const std::vector<Ridge>& ridges) {
  const double x = std::abs(p.x()), beyond = std::max(0.0, x - at.stem);
  double least = std::numeric_limits<double>::infinity();
  const auto add = [&](double dx, double dy, double dz) {
    least = std::min(least, std::sqrt(dx * dx + dy * dy + dz * dz));
  };
  const double dz = p.z() - at.height;
  add(x - at.stem, std::max(0.0, std::abs(p.y()) - at.half_length), dz);
  for (const Ridge& r : ridges) {
    add(beyond, p.y() - r.low, dz);
    add(beyond, p.y() - r.high, dz);
  }
  return least;
}

inline Sizing finger_sizing(const Body& body, const HalfSection& s, const FingerOptions& o) {
  const auto mesh = o.mesh;
  std::vector<Shape> touchable;
  for (const Patch& p : body.patches)
    if (p.contactable && p.name == "dome") touchable.push_back(p.shape);
  Sizing sizing;
  sizing.stretch_y = mesh.stretch_y;
  const auto below_the_dome = [mesh, touchable](const Vec3d& p) {
    double depth = std::numeric_limits<double>::infinity();
    for (const Shape& shape : touchable) depth = std::min(depth, (closest_point(shape, p) - p).norm());
    return std::min(mesh.contact_edge + mesh.growth * depth, mesh.coarsest_edge);
  };
  sizing.edge = below_the_dome;
  if (!has_stem(s.twin)) return sizing;

  const StemLengths at(s, o);
  const std::vector<Ridge> ridges = stem_ridges(o);
  if (s.lies_on_stem())
    sizing.edge = [mesh, below_the_dome, at](const Vec3d& p) {
      const double dx = std::max(0.0, std::abs(p.x()) - at.stem), dz = p.z() - at.height;
      return std::min(below_the_dome(p), mesh.support_edge + mesh.growth * std::hypot(dx, dz));
    };
  // What is high at the edges has to be resolved below the tool: pressure, or at the end of a bond stress.
  // The load spreads along the finger. A rounded edge is smooth, and coarser elements are near enough.
  const bool rounded = s.lies_on_stem();
  const double edge = rounded ? mesh.stem_edge : mesh.seam_edge, growth = (rounded ? 1.5 : 1.0) * mesh.growth,
               growth_along = (rounded ? 0.5 : 0.25) * mesh.growth;
  sizing.edge_under_touch = [edge, growth, growth_along, at, ridges](const Vec3d& p, const Vec3d& touch) {
    const double along = std::max(0.0, std::abs(p.y() - touch.y()) - at.height);
    return edge + growth * distance_to_stem_edges(p, at, ridges) + growth_along * along;
  };
  return sizing;
}

}  // namespace detail

inline Body finger(const FingerDesign& design, const Silicone& silicone, const FingerOptions& o) {
  validate(o);
  validate(silicone);
  const Chords chords{o.mesh.contact_edge, o.mesh.max_turn_rad, o.mesh.shortest_chord};
  const HalfSection s = half_section(design, o.twin, chords, o.pad);
  const bool capped = o.pad.cap_length > 0.0;
  if (capped && detail::has_soft_stem(o.twin))
    throw InvalidArgument(message("twin ", to_string(o.twin), " of a pad with a cap of ", o.pad.cap_length,
        " mm is not known, only of one without"));
  Body body;
  body.name = "finger";
  body.symmetry = {true, !capped};
  body.exact_volume_m3 = 4.0 * s.exact_area_m2() * (0.5e-3 * o.pad.length);
  body.pivot = {0, 0, o.pivot == TiltPivot::flat_top ? 1e-3 * s.design.h_fp : 0.0};
  body.carrier = carrier_boxes(s, o);
  body.rigid_faces = carrier_faces(s, o);
  detail::add_light(body, s, silicone, o);
  if (capped) {
    const HalfSection cap = cap_section(design, o.twin, chords, o.pad);
    body.exact_volume_m3 += 2.0 * cap.exact_area_m2() * 1e-3 * o.pad.cap_length;
    if (has_stem(o.twin)) detail::sweep_capped_half(body, s, cap, o);
  }
  if (!capped || o.twin == Twin::held_top) detail::sweep_prism(body, s, o);
  body.sizing = detail::finger_sizing(body, s, o);
  return body;
}

}  // namespace lumo
