#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/sobol.hpp"
#include "lumo/core/units.hpp"
#include "lumo/optics/transport/next_event.hpp"
#include "lumo/optics/transport/path_tracer.hpp"
#include "lumo/optics/view.hpp"

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

namespace lumo {

/// Finds the light on lines of sight: paths that start at an eye in the air and run backwards, as those of
/// NextEventGather do that start at a face.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout> class ViewGather {
 public:
  /// Light of one colour: what Lambertian nodes sent in each replicate [W], and the emitters.
  struct Color {
    std::vector<std::vector<double>> sent;
    EmitterFaces<Scene> emitters;
  };
  /// What lines of one pixel found, and lost.
  struct Pixel {
    std::vector<double> light;  ///< replicates of the first colour, then of the next
    double lines = 0.0, lost = 0.0;
  };

  ViewGather(const LitBody<Scene, Medium, Readout>& body, const PathLimits& limits, const std::vector<Color>& colors,
      std::uint64_t seed)
      : body_(body), path_(body, limits), colors_(colors), seed_(seed) {}

  /// `samples` lines for each of the replicates that has some.
  template <View V> Pixel operator()(const V& view, int pixel, int replicates, int samples) {
    Pixel found;
    found.light.assign(std::size_t(replicates) * colors_.size(), 0.0);
    const double ratio = body_.index_ratio(), images = double(path_.accounts().images().size());
    const OwenSobol sequence{combine(seed_, std::uint64_t(pixel))};
    for (int r = 0; r < replicates; ++r)
      for (int s = 0; s < samples; ++s) {
        const auto index = std::uint32_t(r * samples + s);
        const SightLine line =
            view.line(pixel, {sequence(index, 0), sequence(index, 1), sequence(index, 2), sequence(index, 3)});
        const PathStart start{.ray = {line.origin, line.direction, combine(sequence.seed, index), -1},
            .mirror = Vec3d::Ones(),
            .power_W = 1.0 / (ratio * ratio * images),  // of a line: n² of radiance is left in the body
            .from_emitter = false,
            .inside = false};
        for (std::size_t c = 0; c < colors_.size(); ++c) {
          const double light = gathered_light(start, body_, path_, colors_[c].sent[std::size_t(r)],
              &colors_[c].emitters, [](std::size_t) { return true; });
          found.light[c * std::size_t(replicates) + std::size_t(r)] += line.weight * light / (pi * samples);
        }
      }
    const Tally paths = path_.accounts().take();
    found.lines = paths.ledger.emitted;
    found.lost = paths.ledger.lost;
    return found;
  }

 private:
  const LitBody<Scene, Medium, Readout> body_;
  PathTracer<Scene, Medium, Readout> path_;
  const std::vector<Color>& colors_;
  std::uint64_t seed_;
};

}  // namespace lumo
