// How far the change of light under one contact is from that on finer meshes, the built finger, sphere of 15 mm. Each
// state is lit with eight times the usual rays, all alike, so that meshes can be compared. One line per state is
// appended to the file:
//   design,material,h_fp,h_ep,w_s,h_s,w_v,y_mm,edges,load_N,nodes,area_error,noise,change of each region...
// `edges` multiplies all wanted edge lengths; 1.8 is lumo's --quick. table of it: light_table.py
//   lumo_light_refinement FILE [--first 0] [--designs 16] [--threads 2]
#include "designs.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/pipeline/evaluate.hpp"
#include "lumo/support/embree.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "lumo/support/tbb.hpp"
#include "lumo/support/tetgen.hpp"

#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <utility>

using namespace lumo;

namespace {

using Light = Tracer<BeerLambert, ExitPower, Embree>;
using Simulation = Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<MixedCholesky>>;

constexpr double quick = FingerOptions::Mesh::quick_edges;

/// The references and the baseline, then seeded feasible lattice designs.
std::vector<FingerDesign> designs(std::size_t count) {
  std::vector<FingerDesign> list = built_references();
  list.push_back(built_baseline());
  return with_seeded(std::move(list), built_finger().pad, count);
}

Evaluation evaluated(Finger finger, double y_m, double edges, const TetgenMesher& mesher, int threads) {
  finger.options.mesh = edges == quick ? finger.options.mesh.coarser(quick) : finger.options.mesh.scaled(edges);
  Pipeline<TetgenMesher, Simulation, Light> pipeline{mesher,
      {NeoHookean{finger.silicone.mu_Pa, finger.silicone.lambda_Pa}}, Light{}.refined(8), Focus{}.scaled(edges)};
  pipeline.rays.rounds = 0;
  Ensemble ensemble = flat_ensemble();
  ensemble.diameters_m = {15e-3};
  ensemble.places_m = {y_m};
  ensemble.loads_N = {1.0, 2.0, 5.0, 10.0};
  return evaluate(finger, ensemble, pipeline, TbbExecutor{threads});
}

/// Standard error of the norm, all regions together.
double noise_of(const Eigen::MatrixXd& change) {
  double sum = 0.0;
  for (const double e : standard_error(change)) sum += e * e;
  return std::sqrt(sum);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argv[1][0] == '-') {
    std::fprintf(stderr, "usage: lumo_light_refinement FILE [--first N] [--designs N] [--threads N]\n");
    return 2;
  }
  std::size_t first = 0, count = 16;
  int threads = 2;
  for (int i = 2; i + 1 < argc; i += 2) {
    if (!std::strcmp(argv[i], "--first")) first = std::size_t(std::atoi(argv[i + 1]));
    if (!std::strcmp(argv[i], "--designs")) count = std::size_t(std::atoi(argv[i + 1]));
    if (!std::strcmp(argv[i], "--threads")) threads = std::atoi(argv[i + 1]);
  }
  const TetgenMesher mesher;  // before threads start
  const std::vector<FingerDesign> list = designs(first + count);
  std::ofstream out(argv[1], std::ios::app);
  out.precision(9);
  for (std::size_t n = first; n < first + count; ++n)
    for (const double edges : {quick, 1.0, 0.7}) {
      const FingerDesign& d = list[n];
      const Silicone card = n % 3 == 2 ? solaris() : dragon_skin();
      const double y_m = n % 2 ? 5.5e-3 : 0.0;
      const Evaluation e = evaluated({d, card, built_finger()}, y_m, edges, mesher, threads);
      for (const ObservedState& s : e.observed) {
        out << n << ',' << card.name << ',' << d.h_fp << ',' << d.h_ep << ',' << d.w_s << ',' << d.h_s << ',' << d.w_v
            << ',' << 1e3 * y_m << ',' << edges << ',' << s.load_N << ',' << e.observations.nodes << ',' << s.area_error
            << ',' << noise_of(s.change);
        for (const double c : Eigen::RowVectorXd(s.change.colwise().mean())) out << ',' << c;
        out << '\n';
      }
      out.flush();
      std::fprintf(stderr, "design %zu, edges %g: %.1f s\n", n, edges, e.observations.seconds.total);
    }
  return 0;
}
