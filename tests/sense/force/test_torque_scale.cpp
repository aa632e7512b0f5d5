#include "catch.hpp"

#include "lumo/sense/force/frame_estimate.hpp"
#include "lumo/sense/force/torque_scale.hpp"
#include "lumo/sense/joints/planar_finger.hpp"
#include "sense/synthetic.hpp"

#include <cmath>
#include <sstream>
#include <vector>

using namespace lumo;
using namespace lumo::sense;

TEST_CASE("alpha in sample and out of sample, by hand", "[force]") {
  // 6 N each; the second finger's motor shows 1/1.2 of its torque: alphas 1 and 1.2.
  std::vector<TorqueForce> samples{
      {0, -0.02, 6.0, 6.0}, {0, -0.02, 6.0, 6.0}, {1, 0.01, 5.0, 6.0}, {1, 0.01, 5.0, 6.0}};
  const auto s = torque_scale(samples, 0);
  REQUIRE(s);
  CHECK(s->fitted_on.sequence == 0);
  CHECK(s->fitted_on.alpha == Approx(1.0));
  CHECK(s->mae_in_sample_N == Approx(0.5));      // 0, 0, 1, 1
  CHECK(s->mae_without_it_N == Approx(1.0));     // 1, 1
  CHECK(s->mae_out_of_sample_N == Approx(1.1));  // 1.2 · 6 − 6 twice, 5 − 6 twice
  REQUIRE(s->sequences.size() == 2);
  CHECK(s->sequences[1].samples == 2);
  CHECK(s->sequences[1].y_m == Approx(0.01));
  CHECK(s->sequences[1].alpha == Approx(1.2));
  CHECK(s->sequences[1].alpha_of_others == Approx(1.0));
  CHECK(s->sequences[1].mae_in_sample_N == Approx(0.0).margin(1e-12));
  CHECK(s->sequences[1].mae_out_of_sample_N == Approx(1.0));
  const auto other = torque_scale(samples, 1);
  CHECK(other->mae_in_sample_N == Approx(0.6));
  CHECK(other->mae_without_it_N == Approx(1.2));
  CHECK(other->mae_out_of_sample_N == Approx(1.1));  // does not depend on the choice
  // Pulls count as no force, in the fit and in the errors.
  samples.push_back({1, 0.01, -3.0, 0.5});
  CHECK(torque_scale(samples, 1)->fitted_on.alpha == Approx(1.2));
  CHECK(torque_scale(samples, 1)->sequences[1].mae_in_sample_N == Approx(0.5 / 3.0));
}

TEST_CASE("in-sample errors are too small by what one sequence's factor scatters", "[force]") {
  // Sequence k has the factor a_k, α is 1/a_k: fitted to itself a sequence errs by nothing, by the others by their mean
  // of a over its own. Six sequences of one force each make it a closed form.
  const std::vector<double> a{1.0, 1.1, 0.9, 1.05, 0.95, 1.02};
  std::vector<TorqueForce> samples;
  for (int k = 0; k < 6; ++k)
    for (int i = 0; i < 50; ++i) samples.push_back({k, 0.0, 8.0 * a[std::size_t(k)], 8.0});
  const auto s = torque_scale(samples);
  double out = 0.0, in = 0.0;
  for (std::size_t k = 0; k < 6; ++k) {
    double sum = 0.0, squares = 0.0;
    for (std::size_t j = 0; j < 6; ++j)
      if (j != k) {
        sum += a[j];
        squares += a[j] * a[j];
      }
    out += std::abs(sum / squares * a[k] - 1.0) * 8.0 / 6.0;
    in += std::abs(a[k] - 1.0) * 8.0 / 6.0;
    CHECK(s->sequences[k].mae_in_sample_N == Approx(0.0).margin(1e-12));
  }
  CHECK(s->mae_out_of_sample_N == Approx(out));
  CHECK(s->mae_in_sample_N == Approx(in));
  CHECK(s->mae_without_it_N == Approx(in * 6.0 / 5.0));
}

TEST_CASE("alpha needs two sequences with forces, and one to be fitted on", "[force]") {
  CHECK_FALSE(torque_scale({}));
  const std::vector<TorqueForce> one{{0, 0.0, 1.0, 1.0}}, gap{{0, 0.0, 1.0, 1.0}, {2, 0.0, 2.0, 1.0}},
      pull{{0, 0.0, 1.0, 1.0}, {1, 0.0, -1.0, 1.0}}, broken{{0, 0.0, std::nan(""), 1.0}, {1, 0.0, 1.0, 1.0}};
  CHECK_FALSE(torque_scale(one));
  CHECK_FALSE(torque_scale(pull));
  CHECK(torque_scale(gap, 2)->fitted_on.alpha == Approx(0.5));
  CHECK_THROWS_AS(torque_scale(gap, 1), InvalidArgument);
  CHECK_THROWS_AS(torque_scale(broken), InvalidArgument);
}

TEST_CASE(
    "a log's sequences are its contacts, and what the localiser misses is not filled from later frames", "[force]") {
  // Two contacts at one place and one at another, right after it; torque shows 1, 1/1.2 and 1/0.8 of the force.
  const MomentArm arm{0.05};
  std::ostringstream table;
  table << "stamp_ns,contact,y_mm,force_N\n";
  std::vector<FrameEstimate> estimates;
  const auto frame = [&](int contact, double y_m, double force_N, double shown, bool located) {
    const auto stamp = std::int64_t(estimates.size() + 1) * 33 * synthetic::ms;
    table << stamp << ',' << contact << ',' << 1e3 * y_m << ',' << force_N << '\n';
    FrameEstimate e;
    e.stamp_ns = stamp;
    e.joints = Eigen::Vector2d(0.0, force_N * shown * (0.05 + y_m));
    e.location.contacts = located ? 1 : 0;
    e.location.contact[0].y_m = y_m;
    estimates.push_back(std::move(e));
  };
  for (const double shown : {1.0, 1.0 / 1.2}) {
    for (int k = 0; k < 3; ++k) frame(0, 0.01, 6.0, shown, true);
    frame(-1, 0.0, 0.0, 1.0, false);
  }
  frame(2, -0.01, 6.0, 1.0 / 0.8, false);  // seen from the second frame on
  for (int k = 0; k < 2; ++k) frame(2, -0.01, 6.0, 1.0 / 0.8, true);
  std::istringstream in(table.str());
  const PadRange tested{0, -0.025, 0.025};
  const ForceScore score = force_score(estimates, LogTruth::from_table(in, "table"), arm, tested, 0.01);
  REQUIRE(score.optical.size() == 9);
  for (std::size_t i = 0; i < 9; ++i) CHECK(score.optical[i].sequence == int(i) / 3);
  CHECK(score.optical[6].force_N == Approx(7.5 * 0.04 / 0.05));  // the middle of the range, not the place seen later
  CHECK(score.optical[7].force_N == Approx(7.5));
  const auto s = torque_scale(score.optical, 1);
  CHECK(s->fitted_on.alpha == Approx(1.2));
  CHECK(s->fitted_on.y_m == Approx(0.01));
  CHECK(score.errors.optical.mae_N == Approx((3 * 0.0 + 3 * 1.0 + 0.0 + 2 * 1.5) / 9.0));  // α = 1
}
