#pragma once

#include "lumo/core/sobol.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/emitter.hpp"
#include "lumo/optics/optical_scene.hpp"
#include "lumo/optics/surface_optics.hpp"
#include "lumo/optics/transport/emitter_faces.hpp"
#include "lumo/optics/transport/face_set.hpp"
#include "lumo/optics/transport/path_tracer.hpp"
#include "lumo/optics/transport/ray_pattern.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

namespace lumo {

/// Emitters as paths of this body meet them.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout>
EmitterFaces<Scene> emitter_faces(const std::vector<Emitter>& emitters, const LitBody<Scene, Medium, Readout>& body,
    std::optional<double> film_closes_m) {
  const double ratio = body.index_ratio();
  return {emitters, body.scene, film_closes_m, ratio * ratio, body.surface.precision_m()};
}

/// Light that Lambertian faces, which sent `sent` W from their nodes, and `emitters`, if given, send along a path that
/// runs backwards: π times its radiance [W/m²], times n² if the path starts in the air (by Helmholtz's reciprocity
/// L/n² is kept but for Fresnel and extinction: Clausius 1864; Veach, thesis, 1997, ch. 5), per power of the path.
/// `counts(node)`: which nodes count.
template <class Path, RayScene Scene, TransparentMedium Medium, ExitReadout Readout, class Counts>
double gathered_light(const PathStart& start, const LitBody<Scene, Medium, Readout>& body, Path& path,
    const std::vector<double>& sent, const EmitterFaces<Scene>* emitters, Counts&& counts) {
  path.run(start, emitters);
  const double ratio = body.index_ratio();
  // From a face in air, light has gained n² of radiance on its way into the body: it comes out as it was sent.
  const double light = path.accounts().collect([&](std::size_t k) {
    return counts(k) ? (body.nodes.in_air(k) ? ratio * ratio : 1.0) * sent[k] / body.nodes.area(k) : 0.0;
  });
  return emitters == nullptr ? light : light + path.take_emitted();
}

/// Finds the light that leaves through faces with regions from those faces (next-event estimation), as few paths come
/// there. Direct light: points of the face × points of the emitters. Light of the carrier: a path from outside into the
/// body ends on Lambertian faces, whose light takes it backwards (gathered_light), scattered in the medium or not. A
/// readout behind openings is gathered from ways through them; then direct light is not, but a WholeReadout has all
/// light from emitters gathered, as its paths meet them. Points lie fixed in the undeformed body: no sample crosses the
/// border of a region that moves with it, so states differ smoothly.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout> class NextEventGather {
 public:
  NextEventGather(const std::vector<Emitter>& emitters, const LitBody<Scene, Medium, Readout>& body,
      PathTracer<Scene, Medium, Readout>& path, std::optional<double> film_closes_m)
      : body_(body), ratio_(body.index_ratio()), path_(path) {
    if (WholeReadout<Readout>) seen_.emplace(emitter_faces(emitters, body, film_closes_m));
    for (unsigned image = 0; image < 4; ++image) {
      if (!((image & 1u) && !body.symmetry.x) && !((image & 2u) && !body.symmetry.y)) images_.push_back(image);
      const Vec3d m = sign(image);
      for (const Emitter& e : emitters)
        if (e.has_intensity() && !e.in_air()) emitters_[image].push_back({e.mirrored(m), mirror(e.axis(), m)});
    }
  }

  /// Replaces the gathered part of the channels of `total`; `sent`: power of the nodes [W], their images included.
  void run(const OwenSobol& sequence, const std::vector<double>& sent, Tally& total) {
    if (body_.exits.size() == 0) return;
    direct_.assign(std::size_t(body_.channels), 0.0);
    diffuse_ = direct_;
    for (std::size_t k = 0; k < body_.exits.size(); ++k) {
      const std::uint32_t count = body_.exits[k].count, direct = (count + direct_every - 1) / direct_every;
      for (std::uint32_t i = 0; i < count; ++i) {
        FaceSet::Sample x = body_.exits.sample(k, body_.surface, sequence, i);
        if (body_.surface.in_contact(x.at)) continue;
        reference_ = body_.surface.reference(x.at);
        for (unsigned image : images_) region_[image] = body_.surface.region(x.at, image);
        Vec3d n = body_.surface.smooth_normal(x.at);
        if (!n.allFinite()) n = x.normal;
        if constexpr (ConnectedReadout<Readout>) {
          gather_connected(x, n, body_.exits[k].mirror, sequence, sent);
        } else {
          if (i % direct_every == 0) gather_direct(x, n, body_.exits[k].mirror, sequence, x.area * count / direct);
          gather_diffuse(x, n, body_.exits[k].mirror, sequence, sent);
        }
      }
    }
    path_.accounts().take();  // the paths ran backwards: their bookings are not power
    for (std::size_t c = 0; c < direct_.size(); ++c) {
      const double better = direct_[c] + diffuse_[c] - total.gathered[c];
      total.ledger.channels[c] += better;
      total.ledger.refinement -= better;
      total.direct[c] += direct_[c];
    }
  }

 private:
  struct Source {
    Emitter emitter;  ///< mirrored to the side of the fundamental face
    Vec3d axis;
  };

  /// Direct light is smooth in place: one point of this many is enough.
  static constexpr std::uint32_t direct_every = 2;

  static Vec3d mirror(const Vec3d& p, const Vec3d& m) { return m.cwiseProduct(p); }
  static Vec3d sign(unsigned image) { return {image & 1u ? -1.0 : 1.0, image & 2u ? -1.0 : 1.0, 1.0}; }

  // Books `power` for every image, if the way out is free and the readout sees it.
  void book(std::vector<double>& account, const FaceSet::Sample& x, const Vec3d& out, double power) const {
    for (unsigned image : images_) {
      const int channel = channel_of(x, out, image);
      if (channel >= 0 && channel < body_.channels) account[std::size_t(channel)] += power;
    }
  }
  int channel_of(const FaceSet::Sample& x, const Vec3d& out, unsigned image) const {
    const Vec3d m = sign(image);
    const Vec3d goes = mirror(out, m);
    return body_.readout.channel(
        {mirror(reference_, m), mirror(x.ray.origin, m), goes, body_.surface.seen_region(region_[image], goes)});
  }
  bool seen(const FaceSet::Sample& x, const Vec3d& out) const {
    bool any = false;
    for (unsigned image : images_) any = any || channel_of(x, out, image) >= 0;
    return any && !body_.scene.first_hit(x.ray.origin, out, false);
  }

  void gather_direct(const FaceSet::Sample& x, const Vec3d& n, const Vec3d& m, const OwenSobol& sequence, double area) {
    const double u = sequence(x.index, 4), v = sequence(x.index, 5);
    for (const Source& s : emitters_[(m.x() < 0.0 ? 1u : 0u) + (m.y() < 0.0 ? 2u : 0u)]) {
      const Vec3d from = mirror(s.emitter.point(u, v), m), way = x.ray.origin - from;
      const double length = way.norm();
      const Vec3d d = way / length;
      const double intensity = s.emitter.intensity(d.dot(mirror(s.axis, m))), meets = d.dot(x.normal),
                   cosine = std::min(1.0, d.dot(n));
      if (!(intensity > 0.0 && meets > 0.0 && cosine > 0.0)) continue;
      const FresnelSplit<double> split = fresnel(cosine, ratio_);
      if (split.reflectance >= 1.0) continue;
      const Vec3d out = refract(d, -n, ratio_, split.cosine_behind);
      if (out.dot(x.normal) <= 0.0 || !seen(x, out)) continue;
      ++path_.segments;
      const RayHit hit = body_.scene.first_hit(from, d, true);
      if (!hit || hit.t < length - 1e-6 * length) continue;
      const double power = intensity * meets / (length * length) * area * (1.0 - split.reflectance);
      book(direct_, x, out, power * body_.medium.transmittance(length));
    }
  }

  void gather_diffuse(
      FaceSet::Sample& x, const Vec3d& n, const Vec3d& m, const OwenSobol& sequence, const std::vector<double>& sent) {
    const Vec3d out = reflected(Lambertian{}, n, n, sequence(x.index, 0), sequence(x.index, 1), m);
    double weight = 0.0;
    if (out.dot(x.normal) <= 0.0 || !enter(x, n, out, weight) || !seen(x, out)) return;
    book(diffuse_, x, out, radiosity(x, m, weight, sent));
  }

  // Openings are not mirror images of each other: each image of the point has its own way out.
  void gather_connected(
      FaceSet::Sample& x, const Vec3d& n, const Vec3d& m, const OwenSobol& sequence, const std::vector<double>& sent) {
    for (unsigned image : images_)
      for (int k = 0; k < body_.readout.openings(); ++k) {
        const Connection way =
            body_.readout.connect(k, mirror(x.ray.origin, sign(image)), sequence(x.index, 0), sequence(x.index, 1));
        const Vec3d out = mirror(way.direction, sign(image));
        double weight = 0.0;
        if (!(way.solid_angle_sr > 0.0 && out.dot(x.normal) > 0.0 && out.dot(n) > 0.0) || !enter(x, n, out, weight))
          continue;
        const int channel = channel_of(x, out, image);
        if (channel < 0 || channel >= body_.channels || body_.scene.first_hit(x.ray.origin, out, false)) continue;
        diffuse_[std::size_t(channel)] += radiosity(x, m, weight * out.dot(n) * way.solid_angle_sr / pi, sent);
      }
  }

  // Turns the ray into the body, against light that leaves along `out`. `weight` [m²]: that light's power is
  // weight·radiosity of where in the body it comes from, if its directions have a cosine law. False: no such light.
  bool enter(FaceSet::Sample& x, const Vec3d& n, const Vec3d& out, double& weight) const {
    const FresnelSplit<double> split = fresnel(std::min(1.0, out.dot(n)), 1.0 / ratio_);
    if (split.reflectance >= 1.0) return false;
    x.ray.direction = refract(-out, n, 1.0 / ratio_, split.cosine_behind);
    const double slant = x.ray.direction.dot(x.normal) / x.ray.direction.dot(n);  // flat facet, curved normal
    if (!(x.ray.direction.dot(x.normal) < 0.0 && slant > 0.0)) return false;
    weight = x.area * slant * (1.0 - split.reflectance) / (ratio_ * ratio_);
    return true;
  }

  double radiosity(const FaceSet::Sample& x, const Vec3d& m, double weight, const std::vector<double>& sent) {
    return gathered_light(
        {.ray = x.ray, .mirror = m, .power_W = weight / double(images_.size()), .from_emitter = false}, body_, path_,
        sent, seen_ ? &*seen_ : nullptr, [&](std::size_t k) { return !body_.nodes.is_bright(k); });
  }

  const LitBody<Scene, Medium, Readout> body_;
  double ratio_;  ///< index inside / outside
  PathTracer<Scene, Medium, Readout>& path_;
  std::optional<EmitterFaces<Scene>> seen_;  ///< that paths meet
  std::vector<unsigned> images_;
  std::array<std::vector<Source>, 4> emitters_;
  std::vector<double> direct_, diffuse_;
  Vec3d reference_ = Vec3d::Zero();  ///< of the sample at hand
  std::array<int, 4> region_{};      ///< likewise, per image
};

}  // namespace lumo
