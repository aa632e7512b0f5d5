// 10 Dome: not only fingers. A GelSight-like dome of gel on an acrylic window, lit in three colours, watched from
// behind, and pressed by a box.
#include <cstdio>
#include "lumo/mechanics/indenters/box.hpp"
#include "lumo/mechanics/indenters/oriented.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/morphology/emitter.hpp"
#include "lumo/optics/pinhole_camera.hpp"
#include "lumo/pipeline/evaluate.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "lumo/support/opencv.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"
using namespace lumo;
using namespace lumo::sense;

// `ring_mm`: radius of the ring of LEDs. `tilt_deg`: how far they lean to the axis. The camera looks through a thick
// window.
Body dome(double ring_mm, double tilt_deg) {
  const double R = 12.0_mm, tilt = tilt_deg * pi / 180.0, q = 0.5 * pi / 8;  // eight facets along each quarter
  Body b;
  b.symmetry = {true, true};
  b.sizing.edge = [](const Vec3d&) { return 2.5_mm; };
  b.medium = {1.41, 14.5};
  b.surroundings = {1.49};
  b.vertices = {{0, 0, 0}, {0, 0, R}};
  b.patches = {{"coat", SphereShape{{0, 0, 0}, R}, false, true, false, Lambertian{0.7}},
      {"window", Plane{{0, 0, 0}, -Vec3d::UnitZ()}, true, false, false, Dielectric{}}};
  for (int i = 1; i < 9; ++i)
    for (int j = 0; j < 9; ++j)
      b.vertices.push_back(
          R * Vec3d(std::sin(q * i) * std::cos(q * j), std::sin(q * i) * std::sin(q * j), std::cos(q * i)));
  const auto at = [](int i, int j) { return i == 0 ? 1 : 9 * i + j - 7; };
  b.facets = {{{0}, 1}, {{0}, Body::mirror_patch}, {{0}, Body::mirror_patch}};
  for (int i = 0; i < 9; ++i) {
    b.facets[0].loop.push_back(at(8, 8 - i));
    b.facets[1].loop.push_back(at(8 - i, 0));
    b.facets[2].loop.push_back(at(i, 8));
  }
  for (int i = 0; i < 8; ++i)
    for (int j = 0; j < 8; ++j)
      b.facets.push_back(i == 0 ? Facet{{1, at(1, j), at(1, j + 1)}, 0}
                                : Facet{{at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)}, 0});
  for (int color = 0; color < 3; ++color) {
    const Vec3d out(std::sin(2.0 * pi * color / 3.0), std::cos(2.0 * pi * color / 3.0), 0.0);
    b.emitters.push_back(DiscEmitter{1e-3 * ring_mm * out + Vec3d(0, 0, 0.5_mm),
        std::cos(tilt) * Vec3d::UnitZ() - std::sin(tilt) * out, 0.4_mm, 1.0, color});
  }
  return b;
}

// How far the fainter press stands out at 1 N: the norm of its change of the image, per watt.
std::optional<Estimate> contrast(const Observations& all) {
  const auto change = [&](std::size_t k) {
    return response_distance(all.scenarios[k].states[0].change, 0.0 * all.scenarios[k].states[0].change);
  };
  return change(0).value < change(1).value ? change(0) : change(1);
}

int main() {
  constexpr int n = 48, zoom = 6;  // pixels
  const PinholeCamera camera({.position = {0, 0, -20.0_mm},
      .field_of_view_rad = 66.0_deg,
      .columns = n,
      .rows = n,
      .aperture_m = 0.3_mm,
      .focus_m = 28.0_mm});
  const Tracer<BeerLambert, PinholeCamera, Embree> light(
      {.rays_per_emitter = 1 << 16, .carrier_rays = 1 << 15, .exit_rays = 1 << 17}, camera);
  const Box box{{5.0_mm, 3.0_mm, 5.0_mm}, 0.4_mm};
  const std::vector<Scenario<Oriented<Box>>> presses{{{box}, 0.0, 0.0, {1.0, 4.0}},
      {{box, Mat3d(Eigen::AngleAxisd(25.0_deg, Vec3d::UnitY()))}, 25.0_deg, 0.0, {1.0, 1.6}}};
  // A row for each design: at rest, under 4 N, and under 1.6 N from aside.
  Image picture = Image::black(3 * n * zoom, 2 * n * zoom);
  for (int row = 0; const auto& [ring_mm, tilt_deg, mu_Pa] :
       std::vector<std::array<double, 3>>{{6.0, 0.0, 100.0_kPa}, {10.0, 40.0, 120.0_kPa}}) {  // mu: of the gel
    const Pipeline<TetgenMesher, Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<MixedCholesky>>,
        decltype(light)>
        tools{{}, {{mu_Pa, 99.0 * mu_Pa}}, light, {0.6_mm, 0.4, 1.0}};
    const Scores s = evaluate(dome(ring_mm, tilt_deg), presses, tools, TbbExecutor{2}, std::tuple{&contrast});
    if (!s.converged) return 1;
    std::printf("ring %4.1f mm, tilt %2.0f deg, gel %3.0f kPa: contrast %.2e ± %.0e\n", ring_mm, tilt_deg, 1e-3 * mu_Pa,
        s.objectives[0]->value, s.objectives[0]->error);
    const std::array views{&s.observations.unloaded_response, &s.observations.scenarios[0].states[1].response,
        &s.observations.scenarios[1].states[1].response};
    const double white = *std::max_element(views[0]->begin(), views[0]->end());
    const auto gamma = [&](double power) {
      return std::uint8_t(255.0 * std::pow(std::clamp(power / white, 0.0, 1.0), 1.0 / 2.2));
    };
    for (int y = 0; y < n * zoom; ++y, ++row)
      for (int x = 0; x < 9 * n * zoom; ++x)  // bytes: blue, green, red
        picture.row(row)[x] = gamma((
            *views[std::size_t(x / (3 * n * zoom))])[std::size_t(((2 - x % 3) * n + y / zoom) * n + x / 3 / zoom % n)]);
  }
  write_image("10_dome.png", picture.view());
}
