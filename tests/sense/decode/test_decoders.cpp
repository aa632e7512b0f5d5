#include "catch.hpp"

#include "lumo/sense/decode/bayes_decoder.hpp"
#include "lumo/sense/decode/decoder.hpp"
#include "lumo/sense/decode/linear_decoder.hpp"
#include "lumo/sense/decode/nearest_template.hpp"
#include "sense/synthetic.hpp"

#include <algorithm>

using namespace lumo;
using namespace lumo::sense;

namespace {

/// Observations mean(place) + factor · normal numbers; place and fold run through all combinations.
template <class Mean> LabelledResponses draw(int places, int repeats, Mean mean, const Eigen::MatrixXd& factor,
    std::uint64_t seed, std::vector<int>* fold = nullptr) {
  synthetic::Normal normal(seed);
  LabelledResponses d{
      Eigen::MatrixXd(factor.rows(), places * repeats), {}, Eigen::VectorXd::LinSpaced(places, -0.025, 0.025)};
  for (int r = 0; r < repeats; ++r)
    for (int p = 0; p < places; ++p) {
      Eigen::VectorXd z(factor.cols());
      for (Eigen::Index i = 0; i < z.size(); ++i) z[i] = normal();
      d.response.col(r * places + p) = mean(p) + factor * z;
      d.place.push_back(p);
      if (fold) fold->push_back(r);
    }
  return d;
}

double tail(double z) { return 0.5 * std::erfc(z / std::sqrt(2.0)); }

template <Decoder D>
double error_on(const D& decoder, const LabelledResponses& training, const LabelledResponses& test) {
  const auto model = decoder.fit(training);
  int wrong = 0;
  for (std::size_t i = 0; i < test.place.size(); ++i) {
    const Decoding d = model.decode(test.response.col(Eigen::Index(i)));
    wrong += d.place != test.place[i];
  }
  return double(wrong) / double(test.place.size());
}

template <Decoder D> void check_laws(const D& decoder) {
  const auto mean = [](int p) { return Eigen::VectorXd{{double(p == 0), double(p == 1), double(p == 2)}}; };
  const LabelledResponses d = draw(3, 8, mean, 0.3 * Eigen::MatrixXd::Identity(3, 3), 2);
  LabelledResponses turned = d;
  turned.response = d.response.rowwise().reverse();
  std::reverse(turned.place.begin(), turned.place.end());
  const auto model = decoder.fit(d), other = decoder.fit(turned);
  for (const Eigen::VectorXd& x : {Eigen::VectorXd{{1.0, 0.0, 0.0}}, Eigen::VectorXd{{0.4, 0.5, 0.1}},
           Eigen::VectorXd{{9.0, -9.0, 1e6}}, Eigen::VectorXd{{0.0, 0.0, 0.0}}}) {
    const Decoding a = model.decode(x), b = other.decode(x);
    CHECK(a.probability.sum() == Approx(1.0));
    CHECK(a.probability[a.place] == a.probability.maxCoeff());
    CHECK((a.probability - b.probability).norm() < 1e-6);
  }
  CHECK_THROWS_AS(model.decode(Eigen::VectorXd::Zero(4)), InvalidArgument);
  LabelledResponses bad = d;
  bad.place[0] = 3;
  CHECK_THROWS_AS(decoder.fit(bad), InvalidArgument);
  for (int& p : bad.place) p = 0;
  CHECK_THROWS_AS(decoder.fit(bad), InvalidArgument);  // places without observations
}

}  // namespace

TEST_CASE("decoders keep their laws", "[decoder]") {
  check_laws(NearestTemplate{});
  check_laws(LinearDecoder{});
  check_laws(LinearDecoder{1.0});
  check_laws(BayesDecoder{});
  check_laws(BayesDecoder{3, 0.1});
}

TEST_CASE("round noise: templates and discriminant reach the Bayes error", "[decoder]") {
  // Two Gaussians at distance Δ = 2 with σ = 0.8: error Φ(−Δ/2σ) = 10.56 %. With 6000 test observations its standard
  // error is 0.4 %.
  const auto mean = [](int p) { return Eigen::VectorXd{{p == 0 ? -1.0 : 1.0, 5.0}}; };
  const Eigen::MatrixXd factor = 0.8 * Eigen::MatrixXd::Identity(2, 2);
  const auto training = draw(2, 400, mean, factor, 1), test = draw(2, 3000, mean, factor, 2);
  const double bayes = tail(1.0 / 0.8);
  CHECK(error_on(NearestTemplate{}, training, test) == Approx(bayes).margin(0.012));
  CHECK(error_on(LinearDecoder{}, training, test) == Approx(bayes).margin(0.012));
}

TEST_CASE("correlated noise: the discriminant reaches the Bayes error, templates do not", "[decoder]") {
  // Noise mostly along (1, 1), the places differ along (1, 0).
  const Eigen::MatrixXd factor{{1.0, 0.2}, {1.0, -0.2}}, covariance = factor * factor.transpose();
  const Eigen::VectorXd delta{{1.0, 0.0}};
  const double bayes = tail(0.5 * std::sqrt(delta.dot(covariance.inverse() * delta)));
  const double templates = tail(0.5 * delta.norm() / std::sqrt(covariance(0, 0)));
  const auto mean = [&](int p) { return Eigen::VectorXd(double(p) * delta); };
  const auto training = draw(2, 500, mean, factor, 1), test = draw(2, 3000, mean, factor, 2);
  CHECK(error_on(LinearDecoder{}, training, test) == Approx(bayes).margin(0.01));
  CHECK(error_on(NearestTemplate{}, training, test) == Approx(templates).margin(0.025));
  CHECK(bayes < 0.5 * templates);
}

TEST_CASE("a Bayes filter over steps adds their evidence", "[decoder]") {
  // Each of three steps separates by d' = 1/0.8; together by √3 of it.
  const auto mean = [](int p) { return Eigen::VectorXd(Eigen::VectorXd::Constant(3, p == 0 ? -0.5 : 0.5)); };
  const Eigen::MatrixXd factor = 0.8 * Eigen::MatrixXd::Identity(3, 3);
  const auto training = draw(2, 500, mean, factor, 3), test = draw(2, 3000, mean, factor, 4);
  CHECK(error_on(BayesDecoder{3}, training, test) == Approx(tail(std::sqrt(3.0) * 0.5 / 0.8)).margin(0.012));
  LabelledResponses first = training, first_test = test;
  first.response = training.response.topRows(1);
  first_test.response = test.response.topRows(1);
  CHECK(error_on(BayesDecoder{1}, first, first_test) == Approx(tail(0.5 / 0.8)).margin(0.015));

  PlaceFilter filter(3, 0.3);  // by hand: (0.7 p + 0.1) · likelihood, normalised
  filter.update(Eigen::VectorXd{{std::log(2.0), 0.0, 0.0}});
  CHECK(filter.probability()[0] == Approx(0.5));
  filter.update(Eigen::VectorXd{{0.0, std::log(3.0), 0.0}});
  const double a = 0.45, b = 0.275 * 3.0, c = 0.275;
  CHECK(filter.probability()[1] == Approx(b / (a + b + c)));
}

TEST_CASE("shrinkage keeps few observations of many features decodable", "[decoder]") {
  const auto mean = [](int p) {
    Eigen::VectorXd m = Eigen::VectorXd::Zero(11);
    for (Eigen::Index i = 0; i < 11; ++i) m[i] = std::exp(-0.5 * std::pow(double(i) - 2.0 * p, 2));
    return m;
  };
  const Eigen::MatrixXd factor = 0.15 * Eigen::MatrixXd::Identity(11, 11);
  std::vector<int> fold;
  const auto data = draw(6, 5, mean, factor, 5, &fold);
  const auto shrunk = cross_validate(LinearDecoder{}, data, fold),
             nearest = cross_validate(NearestTemplate{}, data, fold);
  CHECK(shrunk.accuracy.value > 0.96);
  CHECK(nearest.accuracy.value > 0.96);
  const auto model = LinearDecoder{}.fit(data);
  CHECK(model.shrinkage() > 0.2);  // 24 degrees of freedom for 66 entries of a round covariance
  CHECK(model.shrinkage() <= 1.0);
}

TEST_CASE("leave-one-repetition-out: every observation is decoded once, by a model that has not seen its repetition",
    "[decoder]") {
  // One feature; repetition 2 of place 1 looks like place 0. Templates without it: place 0 at 0, place 1 at 1.
  LabelledResponses d{Eigen::MatrixXd(1, 6), {0, 1, 0, 1, 0, 1}, Eigen::VectorXd{{-0.005, 0.005}}};
  d.response << 0.0, 1.0, 0.0, 1.0, 0.0, 0.1;
  const std::vector<int> fold{0, 0, 1, 1, 2, 2};
  const auto report = cross_validate(NearestTemplate{}, d, fold);
  CHECK(report.confusion(0, 0) == 3);
  CHECK(report.confusion(1, 0) == 1);
  CHECK(report.confusion(1, 1) == 2);
  CHECK(report.accuracy.value == Approx(5.0 / 6.0));
  CHECK(report.mean_error_m == Approx(0.01 / 6.0));
  CHECK(report.predictions[5].decoded == 0);
  CHECK(report.predictions[5].fold == 2);
  CHECK(report.log_score < std::log(report.accuracy.value));
  CHECK_THROWS_AS(cross_validate(NearestTemplate{}, d, std::vector<int>(6, 0)), InvalidArgument);
  d.place = {0, 0, 0, 0, 0, 1};  // place 1 is only in one fold
  CHECK_THROWS_AS(cross_validate(NearestTemplate{}, d, fold), InvalidArgument);
}

TEST_CASE("templates are means, not medians, of the other repetitions", "[decoder]") {
  // Place 0 has 0, 0, 0, 4 beside the repetition left out: mean 1, median 0. Place 1 has 6: means meet at 3.5, medians
  // at 3. What lies at 3.2 is place 0 by means, place 1 by medians.
  LabelledResponses d{Eigen::MatrixXd(1, 10), {}, Eigen::VectorXd{{-0.005, 0.005}}};
  d.response << 0.0, 6.0, 0.0, 6.0, 0.0, 6.0, 4.0, 6.0, 3.2, 6.0;
  std::vector<int> fold;
  for (int i = 0; i < 10; ++i) {
    d.place.push_back(i % 2);
    fold.push_back(i / 2);
  }
  const auto report = cross_validate(NearestTemplate{}, d, fold);
  CHECK(report.predictions[8].decoded == 0);
  LabelledResponses others{d.response.leftCols(8), {0, 1, 0, 1, 0, 1, 0, 1}, d.place_m};
  const auto model = NearestTemplate{}.fit(others);
  CHECK(model.templates()(0, 0) == 1.0);
  CHECK(model.templates()(0, 1) == 6.0);
  CHECK(model.decode(Eigen::VectorXd::Constant(1, 3.49)).place == 0);
  CHECK(model.decode(Eigen::VectorXd::Constant(1, 3.51)).place == 1);
}

TEST_CASE("one observation of each place, or places out of order", "[decoder]") {
  // The scatter is unknown: the nearest mean decides, and numbers of any size stay finite.
  for (const double size : {1e-3, 1.0, 1e8}) {
    LabelledResponses d{size * Eigen::MatrixXd::Identity(3, 3), {0, 1, 2}, Eigen::Vector3d(-0.01, 0.0, 0.01)};
    const auto model = LinearDecoder{}.fit(d);
    for (int p = 0; p < 3; ++p) {
      const Decoding decoded = model.decode(0.9 * d.response.col(p));
      CHECK(decoded.place == p);
      CHECK(decoded.probability.allFinite());
    }
    d.place_m = Eigen::Vector3d(0.0, -0.01, 0.01);
    CHECK_THROWS_AS(LinearDecoder{}.fit(d), InvalidArgument);
    CHECK_THROWS_AS(NearestTemplate{}.fit(d), InvalidArgument);
  }
}
