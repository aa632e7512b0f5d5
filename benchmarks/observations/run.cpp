// Which observations rank designs alike, and which sign the response has: J_obs of seeded feasible designs by all light
// of the side, by a camera's lens and by photodiodes, each of the same presses. One line of JSON per design is appended
// to the file; designs that are there are not computed again, so that a run that was stopped goes on.
//   lumo_observations FILE [--finger built|plain] [--designs 30] [--material DS|Sol] [--pitch deg] [--coarse]
#include "../refinement/designs.hpp"
#include "lumo/lab/side_view.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/pipeline/evaluate.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <set>
#include <string>
#include <vector>

using namespace lumo;

namespace {

using Simulation = Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<MixedCholesky>>;
template <class Readout> using Stages = Pipeline<TetgenMesher, Simulation, Tracer<BeerLambert, Readout, Embree>>;

struct Asked {
  std::string file, material = "DS";
  FingerOptions finger = built_finger();
  std::size_t designs = 30;
  SideView camera;
  bool coarse = false;
  int threads = 2;

  Ensemble ensemble() const {
    Ensemble e = flat_ensemble();
    if (!coarse) return e;
    e.diameters_m = {10e-3, 30e-3};
    e.places_m = {-11e-3, -5.5e-3, 0.0, 5.5e-3, 11e-3};
    e.loads_N = {2.0, 5.0, 10.0};
    return e;
  }
  std::string key(const FingerDesign& d) const {
    const auto x = d.values();
    return message(material, finger.pad.stem == Stem::free ? " built" : " plain", coarse ? " coarse" : "", " pitch ",
        std::lround(camera.pitch_rad * 180.0 / pi), " ", x[0], ",", x[1], ",", x[2], ",", x[3], ",", x[4]);
  }
};

template <class Readout> Stages<Readout> stages(const Asked& asked, const Silicone& card, const Readout& readout) {
  using Light = Tracer<BeerLambert, Readout, Embree>;
  typename Light::Config rays;
  if (asked.coarse) {
    rays.rays_per_emitter = 1 << 14;
    rays.carrier_rays = 1 << 13;
    rays.exit_rays = 1 << 16;
  }
  Stages<Readout> s{{}, {NeoHookean{card.mu_Pa, card.lambda_Pa}}, Light(rays, readout)};
  if (asked.coarse) {
    s.focus = Focus{}.scaled(FingerOptions::Mesh::quick_edges);
    s.rays.tolerance = 0.07;
    s.rays.rounds = 4;
  }
  return s;
}

/// How light changes at contacts of 5 N and more: in the region of the contact and its neighbours, against all that
/// they sent unloaded. A change within two standard errors has no sign.
struct Signs {
  int bright = 0, dark = 0, undecided = 0;

  void add(const StateRecord& s, double y_m, const std::vector<double>& unloaded, const FingerOptions::Readout& read) {
    constexpr double light_load_N = 4.9;
    if (s.load_N < light_load_N || s.change.cols() == 0) return;
    const int at = int((y_m + read.half_range) / (2.0 * read.half_range) * read.bins);
    const int from = std::max(0, at - 1), to = std::min(int(unloaded.size()) - 1, at + 1);
    if (to < from) return;
    const Eigen::MatrixXd near = s.change.middleCols(from, to - from + 1).rowwise().sum();
    const double mean = near.mean(), error = standard_error(near)[0];
    ++(std::abs(mean) <= 2.0 * error ? undecided : mean > 0.0 ? bright : dark);
  }
};

template <class Readout, class Pad> std::string observed(const char* name, const Body& body, const Asked& asked,
    const Pressed<Pad, Sphere>& pressed, const Stages<Readout>& tools) {
  const Evaluation e = score(observe(body, pressed, tools, TbbExecutor{asked.threads}), tools);
  Signs signs;
  for (const ScenarioRecord& s : e.observations.scenarios)
    for (const StateRecord& state : s.states)
      signs.add(state, s.y_m, e.observations.unloaded_response, asked.finger.readout);
  const std::string J = e.J_obs ? message("[", e.J_obs->value, ",", e.J_obs->error, "]") : "null";
  return message(",\"", name, "\":{\"J_obs\":", J, ",\"bright\":", signs.bright, ",\"dark\":", signs.dark,
      ",\"undecided\":", signs.undecided, "}");
}

std::string line_of(const FingerDesign& design, const Asked& asked) {
  const Silicone card = silicone(asked.material);
  FingerOptions options = asked.finger;
  if (asked.coarse) options.mesh = options.mesh.coarser(FingerOptions::Mesh::quick_edges);
  const Body body = finger(design, card, options);
  const SideGeometry side = side_geometry(body);
  const auto tools = stages(asked, card, ExitPower{});
  const auto pressed = press(body, asked.ensemble().scenarios(), tools, TbbExecutor{asked.threads});
  std::string line = "{\"key\":\"" + asked.key(design) + "\"";
  for (const SolvedScenario& s : pressed.solved)
    if (!is_scored(s.record.status, false)) return line + message(",\"why\":\"", to_string(s.record.status), "\"}");
  line += observed("side", body, asked, pressed, tools);
  line += observed("camera", body, asked, pressed, stages(asked, card, asked.camera.cone(side)));
  const PhotodiodeRow row{.count = options.readout.bins, .half_range_m = options.readout.half_range};
  line += observed("photodiodes", body, asked, pressed, stages(asked, card, row.before(side)));
  return line + "}";
}

/// Keys of the lines that a file of results holds.
std::set<std::string> keys_of(const std::string& file) {
  std::set<std::string> done;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);)
    if (line.starts_with("{\"key\":\"") && line.ends_with("}")) done.insert(line.substr(8, line.find('"', 8) - 8));
  return done;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argv[1][0] == '-') {
    std::fprintf(stderr,
        "usage: lumo_observations FILE [--finger built|plain] [--designs N] [--material DS|Sol] [--pitch deg] "
        "[--threads N] [--coarse]\n");
    return 2;
  }
  Asked asked;
  asked.file = argv[1];
  for (int i = 2; i < argc; ++i) {
    const std::string flag = argv[i], value = i + 1 < argc ? argv[i + 1] : "";
    if (flag == "--coarse") asked.coarse = true;
    if (flag == "--finger" && value == "plain") asked.finger = plain_finger();
    if (flag == "--designs") asked.designs = std::size_t(std::atoi(value.c_str()));
    if (flag == "--material") asked.material = value;
    if (flag == "--pitch") asked.camera.pitch_rad = std::atof(value.c_str()) * pi / 180.0;
    if (flag == "--threads") asked.threads = std::atoi(value.c_str());
  }
  const std::set<std::string> done = keys_of(asked.file);
  std::ofstream out(asked.file, std::ios::app);
  const auto references = asked.finger.pad.stem == Stem::free ? built_references() : plain_references();
  for (const FingerDesign& design : with_seeded(references, asked.finger.pad, asked.designs)) {
    if (done.contains(asked.key(design))) continue;
    std::string line;
    try {
      line = line_of(design, asked);
    } catch (const Error& e) {
      line = "{\"key\":\"" + asked.key(design) + "\",\"why\":\"" + e.what() + "\"}";
    }
    out << line << std::endl;
    std::fprintf(stderr, "%s\n", line.c_str());
  }
  return 0;
}
