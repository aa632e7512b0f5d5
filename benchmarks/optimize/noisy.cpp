// Branin and Currin under noise: what a search reports of its front, and what that front is worth without the noise.
// Prints a Markdown table.
//   lumo_noisy_search [SEEDS]
//       SEEDS: 20 if it is left out

#include "lumo/optimize/optimizer.hpp"

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <vector>

using namespace lumo;

namespace {

// Deviations of the noise, as in BoTorch's tutorial on qNEHVI.
constexpr std::array<double, 2> deviation = {15.19, 0.63}, reference = {18.0, 6.0};

// On the unit square. Sources: Dixon, Szegő 1978; Currin, Mitchell, Morris, Ylvisaker 1988.
std::array<double, 2> truth(const Design& x) {
  const double a = 15.0 * x[0] - 5.0, b = 15.0 * x[1], u = x[0];
  const double bowl = b - 5.1 / (4.0 * pi * pi) * a * a + 5.0 / pi * a - 6.0;
  const double wave = x[1] > 0.0 ? 1.0 - std::exp(-0.5 / x[1]) : 1.0;
  return {bowl * bowl + 10.0 * (1.0 - 1.0 / (8.0 * pi)) * std::cos(a) + 10.0,
      wave * (((2300.0 * u + 1900.0) * u + 2092.0) * u + 60.0) / (((100.0 * u + 500.0) * u + 4.0) * u + 20.0)};
}

double worth(const std::vector<Outcome>& front, const std::vector<Trial>& trials) {
  Eigen::MatrixXd y(2, Eigen::Index(front.size()));
  for (std::size_t i = 0; i < front.size(); ++i) {
    const std::array<double, 2> t = truth(trials[std::size_t(front[i].id)].x);
    y.col(Eigen::Index(i)) << -t[0], -t[1];
  }
  return hypervolume(y, Eigen::VectorXd(Eigen::Vector2d(-reference[0], -reference[1])));
}

Optimizer<> searched(unsigned seed, bool reported) {
  Problem p;
  p.space.variables = {{"x0", 0.0, 1.0, 0.0, "", 0.0}, {"x1", 0.0, 1.0, 0.0, "", 0.0}};
  p.objectives = {{"branin", false, reference[0]}, {"currin", false, reference[1]}};
  p.sobol = 6;
  p.evaluations = 40;
  p.seed = seed;
  Optimizer<> optimizer(p);
  std::mt19937 generator(seed);
  std::normal_distribution<double> noise;
  while (const auto trial = optimizer.ask()) {
    std::vector<double> y;
    for (std::size_t j = 0; j < 2; ++j) y.push_back(truth(trial->x)[j] + deviation[j] * noise(generator));
    optimizer.tell(
        trial->id, y, reported ? std::vector<double>(deviation.begin(), deviation.end()) : std::vector<double>{});
  }
  return optimizer;
}

}  // namespace

int main(int argc, char** argv) {
  const unsigned seeds = argc > 1 ? unsigned(std::atoi(argv[1])) : 20;
  std::printf(
      "| seed | errors | reported hypervolume, 90 %% interval | worth without noise | held |\n|---|---|---|---|---|\n");
  for (const bool reported : {true, false}) {
    unsigned held = 0;
    for (unsigned seed = 1; seed <= seeds; ++seed) {
      const Optimizer<> optimizer = searched(seed, reported);
      const Standing s = optimizer.standing();
      const double w = worth(s.front, optimizer.trials());
      const bool holds = s.low <= w && w <= s.high;
      held += holds;
      std::printf("| %u | %s | %.1f, %.1f to %.1f | %.1f | %s |\n", seed, reported ? "reported" : "estimated",
          s.hypervolume, s.low, s.high, w, holds ? "yes" : "no");
      std::fflush(stdout);
    }
    std::printf("| all | %s | | | %u of %u |\n", reported ? "reported" : "estimated", held, seeds);
  }
}
