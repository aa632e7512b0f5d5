#include "catch.hpp"
#include "lumo/sense/decode/constraint_gain.hpp"
#include "lumo/sense/decode/linear_decoder.hpp"
#include "lumo/sense/decode/nearest_template.hpp"
#include "lumo/sense/decode/recontact_metrics.hpp"
#include "lumo/sense/force/calibration.hpp"
#include "lumo/sense/force/force_solution.hpp"
#include "lumo/sense/force/torque_scale.hpp"
#include "lumo/sense/joints/planar_finger.hpp"
#include "lumo/sense/joints/serial_chain.hpp"
#include "lumo/sense/localize/bayes_localizer.hpp"
#include "lumo/sense/localize/peak_localizer.hpp"
#include "lumo/sense/profile/axis_map.hpp"
#include "lumo/sense/profile/unloaded_reference.hpp"
#include "lumo/sense/recording/alignment.hpp"
#include "poison.hpp"

#include <algorithm>

using namespace lumo;
using namespace lumo::sense;
using test::Numbers;

namespace {

Numbers list(const Eigen::MatrixXd& m) { return Numbers(m.data(), m.data() + m.size()); }

Eigen::MatrixXd columns(const Numbers& x, std::size_t from, Eigen::Index rows, Eigen::Index count) {
  return Eigen::Map<const Eigen::MatrixXd>(x.data() + from, rows, count);
}

LabelledResponses labelled(const Numbers& x) { return {columns(x, 0, 1, 4), {0, 0, 1, 1}, columns(x, 4, 2, 1)}; }

Numbers of(const LocationEstimate& e) {
  return {double(e.contacts), e.contact[0].y_m, e.contact[0].variance_m2, e.contact[0].amplitude, e.contact[1].y_m,
      e.contact[1].variance_m2, e.probability};
}

Eigen::VectorXd five_places() { return Eigen::VectorXd::LinSpaced(5, -10e-3, 10e-3); }

// The first five numbers are a profile, the rest settings.
Numbers peak(const Numbers& x) {
  PeakLocalizer::Config c{five_places(), Eigen::VectorXd::Constant(5, x[5]), x[6], x[7], x[8], x[9], x[10]};
  PeakLocalizer localizer(c);
  localizer.update({0, columns(x, 0, 5, 1)});
  return of(localizer.update({20'000'000, columns(x, 0, 5, 1)}));
}

Numbers bayes(const Numbers& x) {
  BayesLocalizer::Config c;
  c.position_m = five_places();
  c.noise = Eigen::VectorXd::Constant(5, x[5]);
  c.from_m = -10e-3;
  c.to_m = 10e-3;
  c.spacing_m = x[6];
  c.amplitude_sigma = x[7];
  c.shape_error = x[8];
  c.gap_s = x[9];
  c.change_rate_per_s = x[10];
  BayesLocalizer localizer(c);
  localizer.update({0, columns(x, 0, 5, 1)});
  return of(localizer.update({20'000'000, columns(x, 0, 5, 1)}));
}

JointVector angles(const Numbers& x, std::size_t from) { return columns(x, from, 2, 1); }

std::vector<test::PoisonedCase> cases_of_joints() {
  return {
      {"MomentArm", {0.05, 0.01},
          [](const Numbers& x) {
            return list(MomentArm{x[0]}.column(JointVector::Zero(1), {0, x[1]}));
          }},
      {"PlanarFinger", {0.04, 0.05, 0.1, 0.2, 0.01},
          [](const Numbers& x) {
            return list(PlanarFinger({x[0]}, x[1]).column(angles(x, 2), {1, x[4]}));
          }},
      {"SerialChain", {0.1, 0.2, 0.01},
          [](const Numbers& x) {
            const SerialChain chain(std::vector<SerialChain::Link>(2));
            return list(chain.position(angles(x, 0), {1, x[2]}));
          }},
      {"solve_forces", {0.1, 0.2, 0.3, 0.4, 0.01, 0.02},
          [](const Numbers& x) {
            const std::vector<ContactPoint> at{{1, x[4]}};
            const auto f = solve_forces(PlanarFinger({0.04}, 0.05), angles(x, 0), angles(x, 2), at, x[5]);
            return Numbers{f.value[0], std::min(f.covariance(0, 0), 1e300), f.residual};
          }},
      {"solve_torque_only", {0.1, 0.2, 0.3, 0.4, -0.02, 0.02, 0.02},
          [](const Numbers& x) {
            const auto s =
                solve_torque_only(PlanarFinger({0.04}, 0.05), angles(x, 0), angles(x, 2), {1, x[4], x[5]}, x[6]);
            return Numbers{s.y_m, s.force_N};
          }},
      {"identify", {1.0, 2.0, 3.0, 1.0, 2.0, 3.0, 1.0, 0.1, 1e-6, 0.0},
          [](const Numbers& x) {
            const Eigen::VectorXd scale = columns(x, 6, 1, 1);
            return list(identify(columns(x, 0, 3, 1), columns(x, 3, 3, 1), scale, x[7], x[8], x[9]).value);
          }},
      {"fit_stiffness", {1e-3, 2e-3, 3e-3, 4e-3, 1.0, 2.1, 2.9, 4.0},
          [](const Numbers& x) {
            const auto fit = fit_stiffness(std::span(x).first(4), std::span(x).last(4),
                [](double d) { return d > 0.0 ? 1e3 * d * (1.0 + 50.0 * d) : 0.0; });
            return Numbers{fit.factor.value, fit.onset_m, std::min(fit.residual_N, 1e300)};
          }},
      {"torque_scale", {-0.01, 1.0, 2.0, 0.01, 2.0, 3.9},
          [](const Numbers& x) {
            const std::vector<TorqueForce> samples{{0, x[0], x[1], x[2]}, {1, x[3], x[4], x[5]}};
            const auto s = torque_scale(samples);
            return s ? Numbers{s->fitted_on.alpha, s->sequences[0].y_m} : Numbers{};
          }},
  };
}

std::vector<test::PoisonedCase> cases_of_profiles() {
  const Numbers bump{0.0, 1.0, 10.0, 1.0, 0.0};
  Numbers by_peak = bump, by_bayes = bump;
  for (const double v : {0.1, 0.05, 0.5, 6.0, 4.0, 1e-3}) by_peak.push_back(v);
  for (const double v : {0.1, 1e-3, 50.0, 0.05, 0.5, 2.0}) by_bayes.push_back(v);
  const Numbers responses{1.0, 1.1, 3.0, 3.2, -0.01, 0.01, 2.0};
  return {
      {"PeakLocalizer", by_peak, peak},
      {"BayesLocalizer", by_bayes, bayes},
      {"moments_about_mode", {0.0, 1.0, 2.0, 0.2, 0.5, 0.3},
          [](const Numbers& x) {
            const auto m = moments_about_mode(columns(x, 0, 3, 1), columns(x, 3, 3, 1));
            return Numbers{m.mean, m.variance};
          }},
      {"AxisMap", {-100.0, 0.0, 100.0, -0.01, 0.0, 0.011, 0.3, 20.0, 0.004},
          [](const Numbers& x) {
            Eigen::Matrix2Xd pixel = Eigen::Matrix2Xd::Zero(2, 3);
            pixel.row(0) << x[0], x[1], x[2];
            const AxisMap map = AxisMap::fit(pixel, columns(x, 3, 3, 1), x[6]);
            return Numbers{map.y_m(x[7]), map.scale_m_per_px(x[7]), std::clamp(map.u_px(x[8]), -1e300, 1e300)};
          }},
      {"UnloadedReference", {1.0, 1.1, 0.02},
          [](const Numbers& x) {
            UnloadedReference r;
            r.add({0, Eigen::VectorXd::Constant(1, x[0])});
            return list(r.noise(x[2]) + r.mean());
          }},
      {"LinearDecoder", responses,
          [](const Numbers& x) {
            return list(LinearDecoder{}.fit(labelled(x)).decode(columns(x, 6, 1, 1)).probability);
          }},
      {"NearestTemplate", responses,
          [](const Numbers& x) {
            return list(NearestTemplate{}.fit(labelled(x)).decode(columns(x, 6, 1, 1)).probability);
          }},
      {"intensity_force_slope", {1.0, 2.0, 3.0, 1.0, 2.0, 3.0},
          [](const Numbers& x) { return list(intensity_force_slope(columns(x, 0, 1, 3), columns(x, 3, 3, 1))); }},
      {"reduction_percent", {1.0, 2.0}, [](const Numbers& x) { return Numbers{reduction_percent(x[0], x[1])}; }},
      {"gain_percent", {1.0, 2.0}, [](const Numbers& x) { return Numbers{gain_percent(x[0], x[1])}; }},
      {"progressive_constraint_gain_percent", {1e-3, 2e-3},
          [](const Numbers& x) { return Numbers{progressive_constraint_gain_percent(x[0], x[1])}; }},
  };
}

std::vector<test::PoisonedCase> cases_of_clocks() {
  return {
      {"ClockMap", {0.1, 1e-5},
          [](const Numbers& x) {
            const std::int64_t to = ClockMap{0, x[0], x[1]}(1'000'000'000);
            CHECK((!std::isnan(x[0]) && !std::isnan(x[1])));
            return Numbers{double(to)};
          }},
      {"TimeSeries", {0.5},
          [](const Numbers& x) {
            const TimeSeries series({0, 10}, Eigen::MatrixXd::Ones(1, 2));
            const auto v = series.at(5, x[0]);
            return v ? list(*v) : Numbers{};
          }},
  };
}

}  // namespace

TEST_CASE("numbers that are none, fed to what senses, give a typed error or a finite answer") {
  int calls = 0;
  for (const auto& cases : {cases_of_joints(), cases_of_profiles(), cases_of_clocks()}) calls += check_poisoned(cases);
  CHECK(calls > 400);
}

TEMPLATE_TEST_CASE(
    "one profile that is no number is left out, and the next ones are seen", "", PeakLocalizer, BayesLocalizer) {
  typename TestType::Config c;
  c.position_m = five_places();
  c.noise = Eigen::VectorXd::Constant(5, 0.1);
  TestType poisoned(c), sound(c);
  Eigen::VectorXd bump(5);
  bump << 0.0, 2.0, 10.0, 2.0, 0.0;
  int seen = 0;
  for (int k = 0; k < 60; ++k) {
    Profile p{k * std::int64_t(33'333'333), bump};
    if (k == 2) p.value[1] = k % 2 ? std::numeric_limits<double>::infinity() : std::nan("");
    const LocationEstimate e = poisoned.update(p);
    if (k != 2) {
      seen += e.contacts == 1;
      CHECK(sound.update(p).contacts == e.contacts);
    } else {
      CHECK(e.contacts == 1);  // as it was
    }
  }
  CHECK(seen == 59);
}

TEST_CASE("a gap in which no profile is a number is forgotten") {
  PeakLocalizer localizer({five_places(), Eigen::VectorXd::Constant(5, 0.1)});
  Eigen::VectorXd bump(5);
  bump << 0.0, 2.0, 10.0, 2.0, 0.0;
  REQUIRE(localizer.update({0, bump}).contacts == 1);
  bump[0] = std::nan("");
  CHECK(localizer.update({400'000'000, bump}).contacts == 1);
  CHECK(localizer.update({600'000'000, bump}).contacts == 0);
}
