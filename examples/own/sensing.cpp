// Own devices: pictures and motor currents that lumo does not know how to read, in the force estimator. A contact of 6
// N at y = 10 mm is drawn, and found again.
#include "own/actuator.hpp"
#include "own/camera.hpp"

#include "lumo/core/sobol.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/force/force_estimator.hpp"
#include "lumo/sense/localize/peak_localizer.hpp"

#include <cstdio>
#include <filesystem>

namespace {

constexpr double period_s = 1.0 / 30.0, px_per_m = 2300.0, place_m = 10e-3, arm_m = 0.05, force_N = 6.0;
constexpr int width = 160, height = 120, pictures = 60, unloaded_pictures = 15;

/// Between −1 and 1, the same on every machine.
double noise(std::uint64_t counter) { return 2.0 * double(lumo::combine(7, counter) >> 11) * 0x1p-53 - 1.0; }

/// A finger that glows evenly, and more where it is touched.
void draw(const std::string& path, std::uint64_t number, bool touched) {
  std::ofstream out(path, std::ios::binary);
  out << "P5\n" << width << ' ' << height << "\n255\n";
  for (int row = 0; row < height; ++row)
    for (int column = 0; column < width; ++column) {
      const double y = (column - 0.5 * width) / px_per_m,
                   glow = touched ? 25.0 * std::exp(-0.5 * std::pow((y - place_m) / 4e-3, 2)) : 0.0;
      out.put(
          char(std::uint8_t(80.5 + glow + 4.0 * noise(number * width * height + std::uint64_t(row * width + column)))));
    }
}

}  // namespace

int main() {
  using namespace lumo;
  using namespace lumo::sense;
  const std::string folder = "own_sensing_log";
  std::filesystem::create_directories(folder);
  std::stringstream joint;
  for (int k = 0; k < pictures; ++k)
    draw(folder + "/" + std::to_string(k) + ".pgm", std::uint64_t(k), k >= unloaded_pictures);
  const int samples = int(1e3 * period_s * pictures);
  for (int k = 0; k < samples; ++k)
    joint << 1e-3 * k << " 0 0 "
          << (1e-3 * k > period_s * unloaded_pictures ? force_N * (arm_m + place_m) : 0.0) +
                 0.01 * noise(std::uint64_t(1) << 40 | unsigned(k))
          << '\n';

  //! [reference]
  AxisMap map;  // the finger's y axis runs along the rows of the picture
  map.origin_px = {0.5 * width, 0.5 * height};
  map.half_length_px = 60.0;
  map.coefficients = {0.0, 60.0 / px_per_m, 0.0};
  const LongitudinalBins bins = LongitudinalBins::uniform(-27.5_mm, 27.5_mm, 55);
  GreenProfile readout({map, bins, -8.0_mm, 8.0_mm, width, height, PixelFormat::grey});
  UnloadedReference unloaded;
  own::PgmCamera before(folder, period_s);
  Profile profile;
  for (int k = 0; k < unloaded_pictures; ++k)
    if (const auto frame = before.next(); frame && readout.read(*frame, profile)) unloaded.add(profile);
  //! [reference]

  //! [estimate]
  own::PgmCamera camera(folder, period_s);
  own::TextActuator actuator(joint);
  PeakLocalizer localizer({.position_m = readout.positions_m(), .noise = unloaded.noise()});
  ForceEstimatorConfig config;
  config.torque = {TorqueModel{.torque_constant_Nm_per_A = 1.0, .noise_Nm = 0.01}};
  // Both recordings give what they have at once: a step takes a picture, and what the motor said meanwhile.
  config.max_samples = 33;
  config.max_frames = 1;
  ForceEstimator estimator(camera, actuator, {readout, unloaded}, localizer, MomentArm{arm_m}, config);
  ForceEstimate last;
  for (int k = 1; k <= pictures; ++k) last = estimator.step(std::int64_t(1e9 * period_s * k));
  //! [estimate]
  if (camera.state() == StreamState::failed || actuator.state() == StreamState::failed || last.contacts != 1) return 1;
  const ContactForce& c = last.contact[0];
  if (!c.y_m || !c.force_N) return 1;
  std::printf("%s: y = %.2f ± %.2f mm, F = %.2f ± %.2f N (drawn: %.2f mm, %.2f N)\n", to_string(last.state),
      1e3 * *c.y_m, 1e3 * std::sqrt(c.y_variance_m2), *c.force_N, std::sqrt(c.force_variance_N2), 1e3 * place_m,
      force_N);
  return std::abs(*c.y_m - place_m) < 1.0_mm && std::abs(*c.force_N - force_N) < 0.3 && last.state == EstimatorState::ok
             ? 0
             : 1;
}
