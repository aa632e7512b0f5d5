#include "catch.hpp"

#include "lumo/sense/decode/constraint_gain.hpp"
#include "lumo/sense/decode/recontact_metrics.hpp"
#include "sense/synthetic.hpp"

using namespace lumo;
using namespace lumo::sense;

TEST_CASE("medians, quantiles and Wilson's interval", "[metrics]") {
  CHECK(median({3.0, 1.0, 2.0}) == 2.0);
  CHECK(median({4.0, 1.0, 2.0, 3.0}) == 2.5);
  CHECK_THROWS_AS(median({}), InvalidArgument);
  CHECK(quantile({1.0, 2.0, 3.0, 4.0}, 0.5) == 2.5);
  CHECK(quantile({1.0, 2.0, 3.0, 4.0}, 0.25) == 1.75);  // numpy's default agrees
  CHECK(quantile({5.0}, 0.9) == 5.0);
  // Wilson 1927 as tabled by Newcombe (1998), table I: 81 of 263 gives 0.2553 … 0.3662; 0 of 20 gives 0 … 0.1611.
  const Interval a = wilson_interval(81, 263), b = wilson_interval(0, 20);
  CHECK(a.low == Approx(0.2553).margin(5e-5));
  CHECK(a.high == Approx(0.3662).margin(5e-5));
  CHECK(b.low == Approx(0.0).margin(1e-12));
  CHECK(b.high == Approx(0.1611).margin(5e-5));
  CHECK_THROWS_AS(wilson_interval(3, 2), InvalidArgument);
}

TEST_CASE("slopes over force are those of a line through the responses", "[metrics]") {
  const Eigen::VectorXd loads = (Eigen::VectorXd(4) << 2.0, 5.0, 10.0, 15.0).finished();
  Eigen::MatrixXd response(2, 4);
  response.row(0) = 3.0 * loads.transpose();
  response.row(0).array() += 7.0;
  response.row(1) << 0.0, 1.0, 0.0, 1.0;
  const Eigen::VectorXd slope = intensity_force_slope(response, loads);
  CHECK(slope[0] == Approx(3.0));
  CHECK(slope[1] == Approx(4.0 / 98.0));  // loads about 8: −6, −3, 2, 7; sum over 1s −3 + 7; squares 36 + 9 + 4 + 49
  // An unloaded profile that is not taken off changes nothing.
  CHECK((intensity_force_slope(response.colwise() + Eigen::Vector2d(80.0, -31.0), loads) - slope).norm() < 1e-12);
  CHECK_THROWS_AS(intensity_force_slope(response, Eigen::Vector4d::Constant(2.0)), InvalidArgument);
  CHECK_THROWS_AS(intensity_force_slope(response, Eigen::VectorXd{{1.0, 2.0}}), InvalidArgument);
}

TEST_CASE("D, W and Q by hand", "[metrics]") {
  // Two channels, three re-contacts, three places. Medians: (1, 0), (3, 0), (3, 4).
  std::vector<Eigen::MatrixXd> slope(3, Eigen::MatrixXd(2, 3));
  slope[0] << 1, 1, 4, 0, 0, 0;
  slope[1] << 3, 2, 3, 0, 2, 0;
  slope[2] << 3, 3, 3, 4, 4, 6;
  const RecontactMetrics m = recontact_metrics(slope);
  CHECK(m.D_neighbor == Approx(0.5 * (2.0 + 4.0) / std::sqrt(2.0)));  // RMS distances 2/√2 and 4/√2, median of two
  // Deviations: 0, 0, 3/√2 | 0, √5/√2, 0 | 0, 0, 2/√2: their median is 0.
  CHECK(m.W_recontact == 0.0);
  CHECK_FALSE(m.Q);
  CHECK_THROWS_AS(recontact_quality(slope), InvalidArgument);
  slope[0](0, 0) = 0;
  slope[1](1, 0) = -1;
  slope[1](1, 2) = 1;
  slope[1](1, 1) = 0;
  slope[2](0, 0) = 2;
  slope[2](0, 1) = 4;
  // Now the medians are (1, 0), (3, 0), (3, 4) as before; deviations 1, 0, 3 | 1, 1, 1 | 1, 1, 2 over √2: median 1/√2.
  const RecontactMetrics n = recontact_metrics(slope);
  CHECK(n.W_recontact == Approx(1.0 / std::sqrt(2.0)));
  CHECK(*n.Q == Approx(3.0));
  slope.resize(1);
  CHECK_THROWS_AS(recontact_metrics(slope), InvalidArgument);
}

TEST_CASE("whiskers are the metrics without one re-contact, the bootstrap is repeatable", "[metrics]") {
  synthetic::Normal normal(4);
  std::vector<Eigen::MatrixXd> slope(6, Eigen::MatrixXd(11, 5));
  for (std::size_t i = 0; i < 6; ++i)
    for (Eigen::Index c = 0; c < 11; ++c)
      for (Eigen::Index r = 0; r < 5; ++r)
        slope[i](c, r) = std::exp(-0.5 * std::pow(double(c) - 2.0 * double(i), 2)) + 0.1 * normal();
  const RecontactQuality q = recontact_quality(slope, 400, 7);
  double low = *q.metrics.Q, high = low;
  for (Eigen::Index out = 0; out < 5; ++out) {
    std::vector<Eigen::MatrixXd> some;
    for (const auto& s : slope) {
      Eigen::MatrixXd kept(11, 4);
      for (Eigen::Index r = 0, to = 0; r < 5; ++r)
        if (r != out) kept.col(to++) = s.col(r);
      some.push_back(kept);
    }
    const double without = *recontact_metrics(some).Q;
    low = std::min(low, without);
    high = std::max(high, without);
  }
  CHECK(q.Q_low == Approx(low));
  CHECK(q.Q_high == Approx(high));
  CHECK(q.bootstrap_low < q.bootstrap_high);
  CHECK(recontact_quality(slope, 400, 7).bootstrap_low == q.bootstrap_low);
  CHECK(recontact_quality(slope, 400, 8).bootstrap_low != q.bootstrap_low);
  for (auto& p : slope) p.conservativeResize(Eigen::NoChange, 2);
  CHECK_THROWS_AS(recontact_quality(slope), InvalidArgument);  // without one of two, the other is its own median
}

TEST_CASE("the interval of Q holds the Q of very many re-contacts as often as it says", "[metrics]") {
  // Six places; noise of each channel, or contacts that shift (all channels together). Q of 3,001 re-contacts is the
  // truth.
  struct World {
    double noise, shift;
  };
  for (const World w : {World{0.1, 0.0}, World{0.3, 0.0}, World{0.02, 0.4}}) {
    const auto make = [&](Eigen::Index repeats, synthetic::Normal& normal) {
      std::vector<Eigen::MatrixXd> slope(6, Eigen::MatrixXd(11, repeats));
      for (std::size_t i = 0; i < 6; ++i)
        for (Eigen::Index r = 0; r < repeats; ++r) {
          const double off = w.shift * normal();
          for (Eigen::Index c = 0; c < 11; ++c)
            slope[i](c, r) = std::exp(-0.5 * std::pow(double(c) - 2.0 * double(i) - off, 2)) + w.noise * normal();
        }
      return slope;
    };
    synthetic::Normal normal(11);
    const double truth = *recontact_metrics(make(3001, normal)).Q;
    int inside = 0;
    constexpr int trials = 150;
    for (int t = 0; t < trials; ++t) {
      const RecontactQuality q = recontact_quality(make(5, normal), 150, std::uint64_t(t) + 1);
      inside += q.bootstrap_low <= truth && truth <= q.bootstrap_high;
    }
    INFO("noise " << w.noise << ", shift " << w.shift << ": " << inside << " of " << trials);
    CHECK(inside >= 129);  // 95 % of 150 is 142.5; 86 %, for five re-contacts that shift are far from a Gaussian's
  }
}

TEST_CASE("regional change and percentages by hand", "[metrics]") {
  Eigen::MatrixXd low(2, 2), high(2, 2);
  low << 0, 1, 5, 5;
  high << 3, 5, 5, 4;
  const Eigen::VectorXd change = regional_rms_change(low, high);
  CHECK(change[0] == Approx(std::sqrt(12.5)));
  CHECK(change[1] == Approx(std::sqrt(0.5)));
  CHECK(reduction_percent(0.7, 1.0) == Approx(30.0));
  CHECK(gain_percent(0.914, 1.0) == Approx(-8.6));
  const double nan = std::nan("");
  CHECK_THROWS_AS(reduction_percent(nan, 1.0), InvalidArgument);
  CHECK_THROWS_AS(progressive_constraint_gain_percent(nan, 1e-3), InvalidArgument);
  low(0, 0) = nan;
  CHECK_THROWS_AS(regional_rms_change(low, high), InvalidArgument);
}

TEST_CASE("the onset is where the force leaves its baseline, whatever the offset", "[metrics]") {
  // The force rises in proportion from sample 100.4 on; the marker moves 0.02 mm a sample throughout.
  synthetic::Normal normal(6);
  for (const double offset : {0.0, -3.0}) {
    std::vector<double> force, marker;
    for (int i = 0; i < 400; ++i) {
      force.push_back(offset + std::max(0.0, 0.1 * (i - 100.4)) + 0.005 * normal());
      marker.push_back(1e-3 - 2e-5 * i);
    }
    const auto onset = OnsetDetector{}.find(force);
    REQUIRE(onset);
    CHECK(onset->sample == Approx(100.4).margin(0.3));
    CHECK(onset->baseline_N == Approx(offset).margin(0.005));
    const auto way = displacement_from_onset(force, marker, 15.0);
    REQUIRE(way);
    CHECK(*way == Approx(150.0 * 2e-5).margin(1e-5));
    CHECK_FALSE(displacement_from_onset(force, marker, 40.0));
  }
  std::vector<double> quiet(100, 1.0), spike = quiet;
  CHECK_FALSE(OnsetDetector{}.find(quiet));
  spike[50] = 9.0;  // one sample is no contact
  CHECK_FALSE(OnsetDetector{}.find(spike));
  CHECK_THROWS_AS(OnsetDetector{}.find(std::vector<double>(10, 0.0)), InvalidArgument);
  CHECK_THROWS_AS(OnsetDetector{.threshold = std::nan("")}.find(quiet), InvalidArgument);
  CHECK_THROWS_AS(OnsetDetector{.fit = -1}.find(quiet), InvalidArgument);
  CHECK(progressive_constraint_gain_percent(3.2e-3, 4e-3) == Approx(20.0));
}
