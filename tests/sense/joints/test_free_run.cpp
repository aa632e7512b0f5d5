#include "catch.hpp"

#include "lumo/sense/joints/free_run.hpp"
#include "sense/synthetic.hpp"

using namespace lumo;
using namespace lumo::sense;

namespace {

constexpr double run_coulomb_Nm = 0.04, run_weight_Nm = 0.08, run_bias_Nm = 0.02;

/// A joint that swings, with contacts of `push_Nm` in a share of the run, which begin at 40 % of it.
std::vector<JointSample> swinging_run(double seconds, double share, double push_Nm, std::uint64_t seed, bool still) {
  synthetic::Normal normal(seed);
  std::vector<JointSample> run;
  const auto n = int(seconds / 0.004);
  for (int k = 0; k < n; ++k) {
    const double t = 0.004 * k, q = still ? 0.1 : 0.3 * std::sin(t), v = still ? 0.0 : 0.3 * std::cos(t);
    const double push = k > 0.4 * n && k < (0.4 + share) * n ? push_Nm : 0.0;
    run.push_back({k * 4 * synthetic::ms, JointVector::Constant(1, q), JointVector::Constant(1, v),
        JointVector::Constant(1,
            run_coulomb_Nm * std::tanh(v / 0.02) + run_weight_Nm * std::sin(q) + run_bias_Nm + push + 0.02 * normal()),
        Effort::torque_Nm});
  }
  return run;
}

double learnt_torque(const std::vector<JointSample>& run, double q, double v) {
  return identify_unloaded(run, 0).model.unloaded(q, v);
}

}  // namespace

TEST_CASE("contacts in a run do not poison friction, weight and offset", "[joints]") {
  const double truth = run_coulomb_Nm + run_weight_Nm * std::sin(0.2) + run_bias_Nm;
  for (const double push : {0.15, 0.6, -0.6})
    for (const double share : {0.1, 0.4}) {
      const auto run = swinging_run(20.0, share, push, 5, false);
      const FreeRun free = free_run(run, std::vector<double>{});
      INFO("push " << push << ", share " << share);
      CHECK(free.left_out == Approx(share).margin(0.03));
      CHECK(learnt_torque(free.samples, 0.2, 0.3) == Approx(truth).margin(6e-3));
      if (share > 0.3) CHECK(std::abs(learnt_torque(run, 0.2, 0.3) - truth) > 0.01);
    }
  const FreeRun half_second = free_run(swinging_run(0.6, 0.3, 0.6, 5, true), std::vector<double>{});
  CHECK(half_second.left_out == Approx(0.5).margin(0.1));
  for (const JointSample& s : half_second.samples) CHECK(s.effort[0] < 0.3);
}

TEST_CASE("a run without contact stays as it is, over fifty seeds", "[joints]") {
  for (std::uint64_t seed = 1; seed <= 50; ++seed)
    for (const bool still : {false, true})
      for (const double seconds : {0.5, 4.0}) {
        const auto run = swinging_run(seconds, 0.0, 0.0, seed, still);
        const FreeRun free = free_run(run, std::vector<double>{});
        CHECK(free.left_out == 0.0);
        CHECK(free.samples.size() == run.size());
      }
  CHECK(free_run({}, std::vector<double>{}).samples.empty());
}
