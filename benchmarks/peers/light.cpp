// lumo's half of mitsuba_response.py: the unloaded finger as light meets it, and its response.
// Files hold raw little-endian numbers: *.f64 and *.i32. Seconds are of the processor, of one thread.
//   lumo_peer_light DIR MATERIAL
//       writes corners.f64 and normals.f64 (triangles × 3 corners × 3; the normals that lumo refracts with),
//       diffuse.i32 (1: carrier, 0: silicone to air) and scene.json (lengths in m); then answers lines
//       "gathered|forward FACTOR SEED FOLD" with a line of JSON: the response [W] by FACTOR times the default rays (a
//       power of two, below 1 too), with what is gathered backwards or by paths from the LEDs only; FOLD 1 traces a
//       quarter of the symmetric whole.

#include "half.hpp"
#include "lumo/mesh/body_mesh.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/tetgen.hpp"

#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

namespace {

using namespace lumo;
namespace fs = std::filesystem;
using Light = Tracer<BeerLambert, ExitPower, Embree>;

void write_scene(const fs::path& dir, const Body& body, const TetMesh& mesh) {
  const OpticalScene scene(body, mesh, {}, {}, Light::Config{}.scene);
  std::vector<double> corners, normals;
  std::vector<int> diffuse;
  double albedo = 0.0;
  for (int t = 0; t < int(scene.triangles().size()); ++t) {
    const SurfaceOptics& optics = scene.optics(t);
    const Lambertian* carrier = std::get_if<Lambertian>(&optics);
    if (carrier) albedo = carrier->albedo;
    diffuse.push_back(carrier ? 1 : 0);
    for (const Vec3d& p : scene.triangles()[std::size_t(t)].corners) {
      const Vec3d n = carrier ? scene.flat_normal(t) : scene.smooth_normal(scene.locate(t, p));
      corners.insert(corners.end(), p.data(), p.data() + 3);
      normals.insert(normals.end(), n.data(), n.data() + 3);
    }
  }
  write(dir / "corners.f64", corners.data(), corners.size());
  write(dir / "normals.f64", normals.data(), normals.size());
  write(dir / "diffuse.i32", diffuse.data(), diffuse.size());
  const FingerOptions o = plain_finger();
  const FingerDesign d = plain_baseline();
  std::ofstream out(dir / "scene.json");
  out.precision(17);
  out << "{\"refractive_index\": " << body.medium.refractive_index
      << ", \"extinction_per_m\": " << body.medium.extinction_per_m << ", \"albedo\": " << albedo
      << ", \"half_width_m\": " << 0.5e-3 * o.pad.width << ", \"flank_m\": " << 1e-3 * d.h_fp
      << ", \"dome_m\": " << 1e-3 * d.h_ep << ", \"half_length_m\": " << 0.5e-3 * o.pad.length
      << ", \"led_z_m\": " << 1e-3 * d.h_s << ", \"led_x_m\": " << o.leds.width_x
      << ", \"led_y_m\": " << o.leds.length_y << ", \"led_pitch_m\": " << o.leds.pitch << ", \"leds\": " << o.leds.count
      << ", \"bins\": " << o.readout.bins << ", \"half_range_m\": " << o.readout.half_range
      << ", \"min_abs_nx\": " << o.readout.min_abs_nx << ", \"triangles\": " << diffuse.size() << "}\n";
}

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc != 3) {
      std::cerr << "usage: lumo_peer_light DIR MATERIAL\n";
      return 2;
    }
    const Body body = finger(plain_baseline(), silicone(argv[2]), plain_finger());
    const TetMesh mesh = mesh_body(body, TetgenMesher{});
    write_scene(argv[1], body, mesh);
    std::cout << "ready" << std::endl;
    std::cout.precision(12);
    for (std::string line; std::getline(std::cin, line);) {
      std::istringstream words(line);
      std::string way;
      double factor = 1.0;
      bool fold = false;
      Light::Config config;
      words >> way >> factor >> config.seed >> fold;
      if (!words || (way != "gathered" && way != "forward")) throw InputError("unknown: " + line);
      for (int* rays : {&config.rays_per_emitter, &config.carrier_rays, &config.exit_rays}) *rays = int(*rays * factor);
      if (way == "forward") config.exit_rays = 0;
      config.largest_lost = 1.0;  // scenes that absorb nothing keep some; the share is printed
      const double begun = processor_seconds();
      const Response r = Light(config).trace(body, mesh, {}, {}, fold ? symmetry_of(body, mesh) : Symmetry{});
      const double seconds = processor_seconds() - begun;
      std::cout << "{\"seconds\": " << seconds << ", \"rays\": " << r.rays << ", \"segments\": " << r.segments
                << ", \"imbalance\": " << r.ledger.imbalance() << ", \"lost\": " << r.ledger.lost << ", \"power_W\": [";
      for (std::size_t k = 0; k < r.power_W.size(); ++k) std::cout << (k ? ", " : "") << r.power_W[k];
      std::cout << "]}" << std::endl;
    }
  } catch (const std::exception& e) {
    std::cerr << "lumo_peer_light: " << e.what() << '\n';
    return 1;
  }
}
