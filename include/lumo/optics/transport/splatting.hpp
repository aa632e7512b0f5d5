#pragma once

#include "lumo/core/sobol.hpp"
#include "lumo/optics/transport/path_tracer.hpp"
#include "lumo/optics/transport/ray_pattern.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace lumo {

/// Light from the emitters that reaches the readout by reflections, without the noise of rays that jump over borders of
/// regions: rays from one point of an emitter form a grid of directions, and where the three rays of a triangle of
/// neighbours go the same way, their power is spread over the triangle of their exits, linearly, and cut exactly at the
/// borders (beams: Heckbert & Hanrahan 1984). Rays whose neighbours go another way are booked where they are. All power
/// is kept; the error of spreading falls with the square of the grid's spacing.
template <class Path> class Splatting {
 public:
  explicit Splatting(Path& path) : path_(path) {}

  /// Traces all rays of a beam: grids of directions, each from one place on the emitter and shifted its own way. Places
  /// come in pairs opposite each other about the middle; places and shifts are a net. More rays make more
  /// places and finer grids.
  void run(const RayPattern::Beam& beam, const OwenSobol& sequence) {
    const std::uint32_t pairs =
        std::bit_floor(std::max(1u, std::uint32_t(std::sqrt(double(beam.rays)) / rays_per_pair)));
    const std::uint32_t places = std::min(beam.rays, 2u * pairs), directions = beam.rays / places;
    std::uint32_t rows = 1, columns = 1;  // in sin², in azimuth; cells of a full circle are made squarer
    while (rows * columns < directions) (columns < rows * (beam.azimuth_range > 2.0 ? 2u : 1u) ? columns : rows) *= 2u;
    const bool around = beam.azimuth_range > 6.0;
    for (std::uint32_t place = 0; place < places; ++place) {
      const double shift_u = sequence(place, 0), shift_v = sequence(place, 1), at_u = sequence(place / 2, 2),
                   at_v = sequence(place / 2, 3);
      const double place_u = place % 2 ? 1.0 - at_u : at_u, place_v = place % 2 ? 1.0 - at_v : at_v;
      exits_.clear();
      first_.assign(1, 0);
      for (std::uint32_t i = 0; i < rows; ++i)
        for (std::uint32_t j = 0; j < columns; ++j) {
          const std::array<double, 4> u{(i + shift_u) / rows, (j + shift_v) / columns, place_u, place_v};
          path_.run({.ray = RayPattern::ray(beam, u, sequence.seed, (place * rows + i) * columns + j),
              .mirror = beam.mirror,
              .power_W = beam.power_W,
              .gathers_direct = beam.source.has_intensity(),
              .exits = &exits_});
          first_.push_back(exits_.size());
        }
      left_.assign(exits_.size(), triangles_about);
      const auto at = [&](std::uint32_t i, std::uint32_t j) { return i * columns + j % columns; };
      for (std::uint32_t i = 0; i + 1 < rows; ++i)
        for (std::uint32_t j = 0; j + (around ? 0 : 1) < columns; ++j) {
          spread(at(i, j), at(i + 1, j), at(i, j + 1));
          spread(at(i + 1, j + 1), at(i, j + 1), at(i + 1, j));
        }
      for (std::size_t e = 0; e < exits_.size(); ++e)
        for (unsigned image : path_.accounts().images())
          if (left_[e] > 0)
            path_.accounts().book_exit(
                path_.accounts().channel(exits_[e], image), exits_[e].power * left_[e] / double(triangles_about));
    }
  }

 private:
  static constexpr int triangles_about = 6;      ///< an exit, in the grid of directions
  static constexpr int bisections = 12;          ///< for a crossing: 2⁻¹² of an edge
  static constexpr int deepest = 4;              ///< times that a triangle is quartered
  static constexpr double alike_cosine = 0.5;    ///< between the normals of exits that are neighbours
  static constexpr double rays_per_pair = 16.0;  ///< of places, as the root of the rays

  using Weights = std::array<double, 3>;  ///< of the three exits
  struct Corner {
    Weights at;
    int channel;
  };

  // Each exit has six triangles about it, and gives each a sixth of its power.
  void spread(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    const auto alike = [&](std::uint32_t ray, const Exit& e) -> std::size_t {
      for (std::size_t k = first_[ray]; k < first_[ray + 1]; ++k)
        if (exits_[k].route == e.route && exits_[k].normal.dot(e.normal) > alike_cosine) return k;
      return exits_.size();
    };
    for (std::size_t k = first_[a]; k < first_[a + 1]; ++k) {
      const std::size_t l = alike(b, exits_[k]), m = alike(c, exits_[k]);
      if (l == exits_.size() || m == exits_.size()) continue;
      corner_ = {&exits_[k], &exits_[l], &exits_[m]};
      for (const std::size_t e : {k, l, m}) --left_[e];
      for (unsigned image : path_.accounts().images()) {
        image_ = image;
        std::array<Corner, 3> t;
        for (std::size_t n = 0; n < 3; ++n) {
          t[n] = {{}, path_.accounts().channel(*corner_[n], image)};
          t[n].at[n] = 1.0;
        }
        book(t[0], t[1], t[2], 1.0, 0);
      }
    }
  }

  static Weights mix(const Weights& a, const Weights& b, double t) {
    return {a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2])};
  }
  int channel(const Weights& w) const {
    Exit e = *corner_[0];
    e.at.face = -1;  // between the rays: its place on the surface is not known
    for (Vec3d Escape::*part : {&Escape::reference, &Escape::position, &Escape::direction})
      e.light.*part =
          w[0] * (corner_[0]->light.*part) + w[1] * (corner_[1]->light.*part) + w[2] * (corner_[2]->light.*part);
    e.light.direction.normalize();
    return path_.accounts().channel(e, image_);
  }
  void book(const Weights& a, const Weights& b, const Weights& c, double area, int channel) {
    double power = 0.0;
    for (std::size_t n = 0; n < 3; ++n) power += (a[n] + b[n] + c[n]) / 3.0 * corner_[n]->power;
    path_.accounts().book_exit(channel, 0.5 * area * power);  // three exits give a sixth each
  }

  // `area`: share of the whole triangle. If one corner differs, the crossing is found on its two edges; else the
  // triangle is quartered.
  void book(const Corner& a, const Corner& b, const Corner& c, double area, int depth) {
    if (a.channel == b.channel && b.channel == c.channel) return book(a.at, b.at, c.at, area, a.channel);
    const Corner* odd = a.channel == b.channel   ? &c
                        : b.channel == c.channel ? &a
                        : a.channel == c.channel ? &b
                                                 : nullptr;
    const Corner *next = odd == &a ? &b : odd == &b ? &c : &a, *last = odd == &a ? &c : odd == &b ? &a : &b;
    if (odd != nullptr) {
      bool two = true;
      const auto crossing = [&](const Corner& other) {
        double low = 0.0, high = 1.0;
        for (int step = 0; step < bisections && two; ++step) {
          const double t = 0.5 * (low + high);
          const int here = channel(mix(odd->at, other.at, t));
          two = here == odd->channel || here == other.channel;
          (here == odd->channel ? low : high) = t;
        }
        return 0.5 * (low + high);
      };
      const double s = crossing(*next), t = two ? crossing(*last) : 0.0;
      if (two) {
        const Weights p = mix(odd->at, next->at, s), q = mix(odd->at, last->at, t);
        book(odd->at, p, q, area * s * t, odd->channel);
        book(p, next->at, last->at, area * (1.0 - s), next->channel);
        book(p, last->at, q, area * s * (1.0 - t), next->channel);
        return;
      }
    }
    if (depth == deepest) {
      for (const Corner* k : {&a, &b, &c}) book(k->at, k->at, k->at, area / 3.0, k->channel);
      return;
    }
    const auto middle = [&](const Corner& p, const Corner& q) {
      const Weights w = mix(p.at, q.at, 0.5);
      return Corner{w, channel(w)};
    };
    const Corner ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
    book(a, ab, ca, area / 4.0, depth + 1);
    book(ab, b, bc, area / 4.0, depth + 1);
    book(ca, bc, c, area / 4.0, depth + 1);
    book(ab, bc, ca, area / 4.0, depth + 1);
  }

  Path& path_;
  std::vector<Exit> exits_;
  std::vector<std::size_t> first_;  ///< exit of each ray
  std::vector<int> left_;           ///< sixths of each exit that are not spread
  std::array<const Exit*, 3> corner_{};
  unsigned image_ = 0;
};

}  // namespace lumo
