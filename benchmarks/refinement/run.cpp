// Refinement study: both objectives and all their terms under finer meshes and more rays, for seeded feasible designs.
// Setting `fine`: four times as many elements and rays. `known`: half the usual error by rays. One line of JSON per
// (design, setting) is appended to the file; lines that are there are not computed again.
//   lumo_refinement FILE --finger built --designs 20 --material DS --settings default,mesh0.7,mesh0.5,rays4,rays64,fine
//       [--first 0] [--diameters 10,30] [--places -22,0,22] [--loads 1,2,5,10]
#include "designs.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/pipeline/evaluate.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"

#include <cstdio>
#include <cstring>
#include <fstream>
#include <map>
#include <set>
#include <string>

using namespace lumo;

namespace {

using Light = Tracer<BeerLambert, ExitPower, Embree>;
using Simulation = Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<MixedCholesky>>;

struct Setting {
  double mesh = 1.0;  // factor on all wanted edge lengths
  int rays = 1;       // factor on all ray counts
  double tolerance = RayRefinement{}.tolerance;
  bool quick = false;  // lumo's --quick, whatever the others say
};

const std::map<std::string, Setting> kSettings = {{"default", {1.0, 1}}, {"mesh1.4", {1.4, 1}}, {"mesh0.7", {0.7, 1}},
    {"mesh0.5", {0.5, 1}}, {"rays4", {1.0, 4}}, {"rays64", {1.0, 64}}, {"fine", {0.63, 4}}, {"finest", {0.5, 16}},
    {"known", {1.0, 1, 0.01}}, {"known0.9", {0.9, 1, 0.01}}, {"known1.1", {1.1, 1, 0.01}}, {"known1.4", {1.4, 1, 0.01}},
    {"known0.7", {0.7, 1, 0.01}}, {"quick", {1.8, 1, 0.07, true}}};

/// The references first, then seeded feasible lattice designs.
std::vector<FingerDesign> designs(const FingerOptions& finger, std::size_t count) {
  return with_seeded(finger.pad.stem == Stem::free ? built_references() : plain_references(), finger.pad, count);
}

std::vector<double> numbers(const char* text, double unit) {
  std::vector<double> v;
  for (const char* p = text; *p;) {
    char* end = nullptr;
    v.push_back(std::strtod(p, &end) * unit);
    p = *end == ',' ? end + 1 : end;
  }
  return v;
}

void append(std::ofstream& out, const std::string& key, const Evaluation& e) {
  const Observations& o = e.observations;
  out.precision(10);
  const auto number = [&](const char* name, const std::optional<Estimate>& v) {
    out << ",\"" << name << "\":";
    if (v) out << "[" << v->value << "," << v->error << "]";
    else out << "null";
  };
  out << "{\"key\":\"" << key << "\"";
  number("J_contact", e.J_contact);
  number("J_obs", e.J_obs);
  out << ",\"worst_contact\":" << (e.worst_contact ? int(*e.worst_contact) : -1) << ",\"nodes\":" << o.nodes
      << ",\"seconds\":[" << o.seconds.mesh << "," << o.seconds.mechanics << "," << o.seconds.optics << ","
      << o.seconds.total << "],\"scenarios\":[";
  for (std::size_t k = 0; k < o.scenarios.size(); ++k) {
    const ScenarioRecord& s = o.scenarios[k];
    out << (k ? "," : "") << "{\"d\":" << 1e3 * s.diameter_m << ",\"y\":" << 1e3 * s.y_m << ",\"status\":\""
        << to_string(s.status) << "\"";
    number("q_form", s.terms.form);
    number("q_stable", s.terms.stable);
    number("q_stiff", s.terms.stiff);
    number("score", s.terms.score());
    out << ",\"depth_mm\":[";
    for (std::size_t i = 0; i < s.states.size(); ++i) out << (i ? "," : "") << 1e3 * s.states[i].depth_m;
    out << "],\"area_mm2\":[";
    for (std::size_t i = 0; i < s.states.size(); ++i) out << (i ? "," : "") << 1e6 * s.states[i].contact_area_m2;
    out << "]}";
  }
  out << "]}\n";
  out.flush();
}

Evaluation evaluated(
    Finger finger, const Ensemble& ensemble, const Setting& s, const TetgenMesher& mesher, int threads) {
  finger.options.mesh = s.quick ? finger.options.mesh.coarser(s.mesh) : finger.options.mesh.scaled(s.mesh);
  Pipeline<TetgenMesher, Simulation, Light> pipeline{mesher,
      {NeoHookean{finger.silicone.mu_Pa, finger.silicone.lambda_Pa}}, Light{}.refined(s.quick ? 0.25 : s.rays),
      Focus{}.scaled(s.mesh)};
  pipeline.rays.tolerance = s.tolerance;
  return evaluate(finger, ensemble, pipeline, TbbExecutor{threads});
}

/// Keys of the lines that a file of results holds.
std::set<std::string> keys_of(const char* file) {
  std::set<std::string> done;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);)
    if (const auto a = line.find(":\""); a != std::string::npos)
      done.insert(line.substr(a + 2, line.find('"', a + 2) - a - 2));
  return done;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argv[1][0] == '-') {
    std::fprintf(stderr,
        "usage: lumo_refinement FILE [--finger built|plain] [--first N] [--designs N] [--material DS|Sol] [--settings "
        "a,b,...] [--diameters mm,mm,...] [--places mm,mm,...] [--loads N,N,...] [--threads N]\n");
    return 2;
  }
  std::size_t first = 0, count = 5;
  FingerOptions finger = plain_finger();
  std::string material = "DS", settings = "default,mesh0.7,mesh0.5";
  Ensemble ensemble = flat_ensemble();
  int threads = 2;
  for (int i = 2; i + 1 < argc; i += 2) {
    if (!std::strcmp(argv[i], "--designs")) count = std::size_t(std::atoi(argv[i + 1]));
    if (!std::strcmp(argv[i], "--first")) first = std::size_t(std::atoi(argv[i + 1]));
    if (!std::strcmp(argv[i], "--finger") && !std::strcmp(argv[i + 1], "built")) finger = built_finger();
    if (!std::strcmp(argv[i], "--loads")) ensemble.loads_N = numbers(argv[i + 1], 1.0);
    if (!std::strcmp(argv[i], "--material")) material = argv[i + 1];
    if (!std::strcmp(argv[i], "--settings")) settings = argv[i + 1];
    if (!std::strcmp(argv[i], "--diameters")) ensemble.diameters_m = numbers(argv[i + 1], 1e-3);
    if (!std::strcmp(argv[i], "--places")) ensemble.places_m = numbers(argv[i + 1], 1e-3);
    if (!std::strcmp(argv[i], "--threads")) threads = std::atoi(argv[i + 1]);
  }
  const auto listed = [](const std::vector<double>& metres) {
    std::string text;
    for (const double v : metres) text += (text.empty() ? "" : ",") + message(1e3 * v);
    return text;
  };
  const std::string contacts = "d=" + listed(ensemble.diameters_m) + ";y=" + listed(ensemble.places_m);
  const Silicone card = silicone(material);
  const TetgenMesher mesher;  // before threads start

  const std::set<std::string> done = keys_of(argv[1]);
  std::ofstream out(argv[1], std::ios::app);
  std::vector<FingerDesign> list = designs(finger, first + count);
  list.erase(list.begin(), list.begin() + std::ptrdiff_t(first));
  for (std::size_t from = 0; from < settings.size();) {
    const std::size_t to = std::min(settings.find(',', from), settings.size());
    const std::string name = settings.substr(from, to - from);
    from = to + 1;
    if (!kSettings.count(name)) {
      std::fprintf(stderr, "lumo_refinement: no setting '%s'\n", name.c_str());
      return 2;
    }
    const Setting s = kSettings.at(name);
    for (const FingerDesign& d : list) {
      // Of the plain finger, as before the built one was known, the key says nothing.
      const std::string key = message(name, " ", finger.pad.stem == Stem::free ? "built-" : "", material, " ", contacts,
          " ", d.h_fp, ",", d.h_ep, ",", d.w_s, ",", d.h_s, ",", d.w_v);
      if (done.count(key)) continue;
      const Evaluation e = evaluated({d, card, finger}, ensemble, s, mesher, threads);
      append(out, key, e);
      std::fprintf(stderr, "%s: %.1f s\n", key.c_str(), e.observations.seconds.total);
    }
  }
  return 0;
}
