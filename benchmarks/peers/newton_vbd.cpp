// lumo's half of newton_vbd.py: the finger as a mesh of linear tetrahedra, and vertex block descent on it along a given
// schedule with given colors. Files hold raw little-endian numbers: *.f64 and *.i32.
//   lumo_newton_vbd mesh DIR EDGE_MM                  writes nodes.f64, tets.i32, bonded.i32, touch.f64
//   lumo_newton_vbd run DIR EDGE_MM SWEEPS KE ETA FRICTION THREADS REPEAT
//       reads colors.txt (one group a line) and schedule.txt (advance in m and 0 or 1: keep this state);
//       writes forces.f64 and states.f64, prints CPU seconds of all steps

#include "lumo/mechanics/contact/contact_handler.hpp"
#include "lumo/mechanics/contact/first_touch.hpp"
#include "lumo/mechanics/materials/stable_neo_hookean.hpp"
#include "lumo/mechanics/solvers/vertex_block_descent.hpp"
#include "lumo/mesh/body_mesh.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"

#include <ctime>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>

namespace {

using namespace lumo;
namespace fs = std::filesystem;

template <class T> void write(const fs::path& path, const std::vector<T>& values) {
  std::ofstream out(path, std::ios::binary);
  out.write(reinterpret_cast<const char*>(values.data()), std::streamsize(values.size() * sizeof(T)));
  if (!out) throw InputError(message("cannot write ", path.string()));
}

std::vector<double> flat(const Positions& x) { return {x.data(), x.data() + x.size()}; }

struct Scene {
  Body body;
  TetMesh mesh;
  Scenario<Sphere> scenario{Sphere{10e-3}};
  Touch touch;

  explicit Scene(double edge_m) {
    FingerOptions options = plain_finger();
    options.mesh = {edge_m, edge_m, 0.0, 1.0, 1.6, edge_m};
    body = finger(plain_baseline(), dragon_skin(), options);
    mesh = mesh_body(body, TetgenMesher{}, 1);
    touch = first_touch(body, mesh, scenario);
  }
};

void write_mesh(const fs::path& dir, const Scene& s) {
  std::vector<int> tets, bonded(s.mesh.nodes.size(), 0);
  for (const auto& t : s.mesh.tets) tets.insert(tets.end(), t.begin(), t.begin() + 4);
  for (const BoundaryFace& f : s.mesh.faces)
    if (s.body.patches[std::size_t(f.patch)].bonded)
      for (std::size_t k = 0; k < 3; ++k) bonded[std::size_t(f.nodes[k])] = 1;
  write(dir / "nodes.f64", flat(positions_of(s.mesh)));
  write(dir / "tets.i32", tets);
  write(dir / "bonded.i32", bonded);
  write(dir / "touch.f64", std::vector<double>{s.touch.origin.x(), s.touch.origin.y(), s.touch.origin.z()});
}

template <Executor E> void run(const fs::path& dir, const Scene& s, const DescentConfig& config,
    const VertexContact& contact, const E& executor, int repeat) {
  const Silicone card = dragon_skin();
  const StableNeoHookean material{card.mu_Pa, card.lambda_Pa};
  const DescentModel<StableNeoHookean, VertexContact, LinearTet> model(
      s.body, s.mesh, {}, {material, contact, {}}, config);
  std::vector<std::pair<double, bool>> schedule;
  std::ifstream in(dir / "schedule.txt");
  for (double by; in >> by;) {
    int keep = 0;
    in >> keep;
    schedule.emplace_back(by, keep == 1);
  }
  if (schedule.empty()) throw InputError("schedule.txt has no steps");
  double least = 0.0;
  for (int round = 0; round < repeat; ++round) {
    Descent<std::decay_t<decltype(model)>, Sphere, E> descent(
        model, s.scenario.indenter, s.touch, s.scenario.direction(), config, executor);
    std::vector<double> forces, states;
    double seconds = 0.0;
    for (const auto& [by, keep] : schedule) {
      const std::clock_t begun = std::clock();
      descent.step(by);
      seconds += double(std::clock() - begun) / CLOCKS_PER_SEC;
      forces.push_back(descent.push());
      if (!keep) continue;
      const std::vector<double> x = flat(descent.positions());
      states.insert(states.end(), x.begin(), x.end());
    }
    write(dir / "forces.f64", forces);
    write(dir / "states.f64", states);
    least = round == 0 ? seconds : std::min(least, seconds);
  }
  std::cout << least << '\n';
}

}  // namespace

int main(int argc, char** argv) {
  try {
    const std::vector<std::string> args(argv + 1, argv + argc);
    if (args.size() < 3 || (args[0] != "mesh" && args[0] != "run") || (args[0] == "run" && args.size() != 9)) {
      std::cerr << "usage: lumo_newton_vbd mesh DIR EDGE_MM | run DIR EDGE_MM SWEEPS KE ETA FRICTION THREADS REPEAT\n";
      return 2;
    }
    const Scene scene(1e-3 * std::stod(args[2]));
    if (args[0] == "mesh") {
      write_mesh(args[1], scene);
      return 0;
    }
    DescentConfig config;
    config.sweeps = std::stoi(args[3]);
    config.viscosity_Pa_s = std::stod(args[5]);
    config.density_kg_per_m3 = 1070.0;
    std::ifstream colors(fs::path(args[1]) / "colors.txt");
    for (std::string line; std::getline(colors, line);) {
      std::istringstream words(line);
      config.colors.emplace_back();
      for (int v; words >> v;) config.colors.back().push_back(v);
    }
    constexpr double area = 1e-6;  // Newton's stiffness belongs to the vertex
    const VertexContact contact{
        .stiffness_N_per_m3 = std::stod(args[4]) / area, .friction = std::stod(args[6]), .area_per_vertex_m2 = area};
    const int threads = std::stoi(args[7]), repeat = std::stoi(args[8]);
    if (threads == 1) run(args[1], scene, config, contact, Serial{}, repeat);
    else run(args[1], scene, config, contact, TbbExecutor{threads}, repeat);
  } catch (const std::exception& e) {
    std::cerr << "lumo_newton_vbd: " << e.what() << '\n';
    return 1;
  }
}
