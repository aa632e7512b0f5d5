#pragma once

#include "lumo/core/units.hpp"
#include "lumo/morphology/body.hpp"
#include "lumo/optics/optical_scene.hpp"
#include "lumo/optics/scattering_medium.hpp"

#include <cmath>
#include <random>
#include <variant>
#include <vector>

namespace optics_test {

/// Power per region and its standard error, from batches of walks.
struct WalkedPower {
  std::vector<double> power_W, error_W;
};

/// Light as photons that walk: at each surface one way on by chance, diffuse light in directions by chance, no nodes,
/// no radiosity, no gathering. Shares geometry and material data with the tracer, and none of its transport.
/// `scene`: of `surface`'s triangles.
template <lumo::RayScene Scene> class AnalogWalk {
 public:
  AnalogWalk(const lumo::Body& body, const lumo::OpticalScene& surface, const Scene& scene, unsigned seed)
      : body_(body), surface_(surface), scene_(scene), medium_(body.medium), random_(seed) {}

  WalkedPower run(int batches, int walks) {
    Eigen::MatrixXd power = Eigen::MatrixXd::Zero(batches, body_.regions);
    for (int b = 0; b < batches; ++b)
      for (const lumo::Emitter& e : body_.emitters)
        for (int i = 0; i < walks; ++i)
          if (const int region = walk(e); region >= 0) power(b, region) += weight_ * e.power_W() / walks;
    WalkedPower out;
    for (Eigen::Index k = 0; k < power.cols(); ++k) {
      const double mean = power.col(k).mean();
      out.power_W.push_back(mean);
      out.error_W.push_back(
          std::sqrt((power.col(k).array() - mean).square().sum() / (double(batches) * double(batches - 1))));
    }
    return out;
  }

 private:
  double u() { return std::uniform_real_distribution<double>(0.0, 1.0)(random_); }

  lumo::Vec3d about(const lumo::Vec3d& axis, double cosine) {
    lumo::Vec3d a, b;
    lumo::tangents(axis, a, b);
    const double sine = std::sqrt(std::max(0.0, 1.0 - cosine * cosine)), turn = 2.0 * lumo::pi * u();
    return (sine * std::cos(turn) * a + sine * std::sin(turn) * b + cosine * axis).normalized();
  }

  // Region in which the photon left, or −1; weight_ is what is left of it.
  int walk(const lumo::Emitter& e) {
    position_ = e.point(u(), u());
    direction_ = about(e.axis(), e.polar(u()).cosine);
    inside_ = !e.in_air();
    weight_ = 1.0;
    region_ = -1;
    for (int event = 0; event < 100000; ++event) {
      const lumo::RayHit hit = scene_.first_hit(position_, direction_, inside_);
      if (!hit) return inside_ ? -1 : region_;
      if (inside_ && collided(hit.t)) continue;
      position_ += hit.t * direction_;
      if (!met(hit.triangle)) return -1;
      if (weight_ < 0.05) {
        if (u() > weight_ / 0.2) return -1;
        weight_ = 0.2;
      }
    }
    return -1;
  }

  // Free paths are drawn from scattering alone; absorption is taken off continuously.
  bool collided(double reach) {
    const double mu_s = medium_.albedo() * body_.medium.extinction_per_m, mu_a = body_.medium.extinction_per_m - mu_s;
    const double free = mu_s > 0.0 ? -std::log(1.0 - u()) / mu_s : reach;
    weight_ *= std::exp(-mu_a * std::min(free, reach));
    if (!(free < reach)) return false;
    position_ += free * direction_;
    direction_ = about(direction_, medium_.scattering_cosine(u()));
    return true;
  }

  bool met(int triangle) {
    const lumo::SurfaceOptics& optics = surface_.optics(triangle);
    const lumo::Vec3d flat = surface_.flat_normal(triangle), toward = inside_ ? lumo::Vec3d(-flat) : flat;
    if (const auto* wall = std::get_if<lumo::Lambertian>(&optics)) {
      if (u() >= wall->albedo) return false;
      direction_ = about(toward, std::sqrt(u()));
      return true;
    }
    const lumo::ScenePoint at = surface_.locate(triangle, position_);
    lumo::Vec3d n = surface_.smooth_normal(at);
    if (inside_) n = -n;
    if (direction_.dot(n) >= 0.0) n = toward;
    const double in = inside_ ? body_.medium.refractive_index : 1.0,
                 out = inside_ ? 1.0 : body_.medium.refractive_index;
    const double c1 = -direction_.dot(n), s2 = in / out * std::sqrt(std::max(0.0, 1.0 - c1 * c1));
    double reflected = 1.0, c2 = 0.0;
    if (s2 < 1.0) {  // Fresnel's amplitudes, written out
      c2 = std::sqrt(1.0 - s2 * s2);
      const double rs = (in * c1 - out * c2) / (in * c1 + out * c2), rp = (out * c1 - in * c2) / (out * c1 + in * c2);
      reflected = 0.5 * (rs * rs + rp * rp);
    }
    if (u() < reflected) {
      direction_ = (direction_ + 2.0 * c1 * n).normalized();
      if (direction_.dot(toward) <= 0.0) direction_ = (direction_ - 2.0 * direction_.dot(toward) * toward).normalized();
      return true;
    }
    direction_ = (in / out * (direction_ + c1 * n) - c2 * n).normalized();
    if (direction_.dot(toward) >= 0.0) direction_ = (direction_ - 2.0 * direction_.dot(toward) * toward).normalized();
    if (inside_) region_ = surface_.region(at, 0);
    inside_ = !inside_;
    return true;
  }

  const lumo::Body& body_;
  const lumo::OpticalScene& surface_;
  const Scene& scene_;
  lumo::ScatteringMedium medium_;
  std::mt19937_64 random_;
  lumo::Vec3d position_ = lumo::Vec3d::Zero(), direction_ = lumo::Vec3d::UnitZ();
  bool inside_ = true;
  double weight_ = 1.0;
  int region_ = -1;
};

}  // namespace optics_test
