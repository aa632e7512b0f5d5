// 10 Dome: not only fingers. A GelSight-like dome of gel on an acrylic window, lit in three colours, watched from behind, and pressed by a box.
#include "lumo/campaign/evaluate.hpp"
#include "lumo/mechanics/box.hpp"
#include "lumo/mechanics/neo_hookean.hpp"
#include "lumo/mechanics/oriented.hpp"
#include "lumo/morphology/disc_emitter.hpp"
#include "lumo/optics/pinhole_camera.hpp"
#include "lumo/support/cholmod.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/opencv.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"
#include <cstdio>

using namespace lumo;

Body dome(double ring_mm, double tilt_deg) {  // radius of the ring of LEDs, and how far they lean to the axis; the camera looks through a thick window
  const double R = 12.0_mm, tilt = tilt_deg * pi / 180.0, q = 0.5 * pi / 8;  // eight facets along each quarter
  Body b;
  b.symmetry = {true, true}, b.sizing.edge = [](const Vec3&) { return 2.5_mm; }, b.medium = {1.41, 14.5}, b.surroundings = {1.49}, b.vertices = {{0, 0, 0}, {0, 0, R}};
  b.patches = {{"coat", SphereShape{Vec3::Zero(), R}, false, true, false, Lambertian{0.7}}, {"window", Plane{Vec3::Zero(), -Vec3::UnitZ()}, true, false, false, Dielectric{}}};
  for (int k = 9, i = 1, j = 0; k < 81; ++k, i = k / 9, j = k % 9) b.vertices.push_back(R * Vec3(std::sin(q * i) * std::cos(q * j), std::sin(q * i) * std::sin(q * j), std::cos(q * i)));
  const auto at = [](int i, int j) { return i == 0 ? 1 : 9 * i + j - 7; };
  b.facets = {{{0}, 1}, {{0}, Body::mirror_patch}, {{0}, Body::mirror_patch}};
  for (int i = 0; i < 9; ++i) b.facets[0].loop.push_back(at(8, 8 - i)), b.facets[1].loop.push_back(at(8 - i, 0)), b.facets[2].loop.push_back(at(i, 8));
  for (int i = 0; i < 8; ++i)
    for (int j = 0; j < 8; ++j) b.facets.push_back(i == 0 ? Facet{{1, at(1, j), at(1, j + 1)}, 0} : Facet{{at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)}, 0});
  for (int color = 0; color < 3; ++color) {
    const Vec3 out(std::sin(2.0 * pi * color / 3.0), std::cos(2.0 * pi * color / 3.0), 0.0);
    b.emitters.push_back(DiscEmitter{1e-3 * ring_mm * out + Vec3(0, 0, 0.5_mm), std::cos(tilt) * Vec3::UnitZ() - std::sin(tilt) * out, 0.4_mm, 1.0, color});
  }
  return b;
}

std::optional<Estimate> contrast(const Observations& all) {  // how far the fainter press stands out at 1 N: the norm of its change of the image, per watt
  const auto change = [&](std::size_t k) { return response_distance(all.scenarios[k].states[0].change, 0.0 * all.scenarios[k].states[0].change); };
  return change(0).value < change(1).value ? change(0) : change(1);
}

int main() {
  constexpr int n = 48, zoom = 6;  // pixels
  const PinholeCamera camera({.position = {0, 0, -20.0_mm}, .field_of_view_rad = 66.0_deg, .columns = n, .rows = n, .aperture_m = 0.3_mm, .focus_m = 28.0_mm});
  const Tracer<BeerLambert, PinholeCamera, Embree> light({.rays_per_emitter = 1 << 16, .carrier_rays = 1 << 15, .exit_rays = 1 << 17}, camera);
  const auto press = [](double angle, double load_N) { return Scenario<Oriented<Box>>{{Box{{5.0_mm, 3.0_mm, 5.0_mm}, 0.4_mm}, Mat3(Eigen::AngleAxisd(angle, Vec3::UnitY()))}, angle, 0.0, {1.0, load_N}}; };
  Image picture = Image::black(3 * n * zoom, 2 * n * zoom);
  const std::array<std::array<double, 3>, 2> designs = {{{6.0, 0.0, 100.0}, {10.0, 40.0, 120.0}}};  // ring, tilt, and the gel's shear modulus [kPa]
  for (int row = 0; const auto& [ring_mm, tilt_deg, mu_kPa] : designs) {
    const Pipeline<TetgenMesher, Simulator<NeoHookean, SDFContact, QuadraticTet, Cholmod>, decltype(light)> pipeline{{}, {{1e3 * mu_kPa, 99e3 * mu_kPa}}, light, {0.6_mm, 0.4, 1.0}};
    const Scores scores = evaluate(dome(ring_mm, tilt_deg), std::vector{press(0.0, 4.0), press(25.0_deg, 1.6)}, pipeline, TbbExecutor{2}, std::tuple{&contrast});
    if (!scores.converged) return 1;
    std::printf("ring %4.1f mm, tilt %2.0f deg, gel %3.0f kPa: contrast %.2e ± %.0e\n", ring_mm, tilt_deg, mu_kPa, scores.objectives[0]->value, scores.objectives[0]->error);
    const Observations& o = scores.observations;  // a row of the picture for each design: at rest, under 4 N, and under 1.6 N from aside
    const std::array views{&o.unloaded_response, &o.scenarios[0].states[1].response, &o.scenarios[1].states[1].response};
    const auto gamma = [white = *std::max_element(views[0]->begin(), views[0]->end())](double power) { return std::uint8_t(255.0 * std::pow(std::clamp(power / white, 0.0, 1.0), 1.0 / 2.2)); };
    for (int y = 0; y < n * zoom; ++y, ++row)
      for (int x = 0; x < 9 * n * zoom; ++x)  // bytes: blue, green, red
        picture.row(row)[x] = gamma((*views[std::size_t(x / (3 * n * zoom))])[std::size_t(((2 - x % 3) * n + y / zoom) * n + x / 3 / zoom % n)]);
  }
  write_image("10_dome.png", picture.view());
}
