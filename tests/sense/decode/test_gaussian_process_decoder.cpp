#include "catch.hpp"

#include "lumo/sense/decode/bayes_decoder.hpp"
#include "lumo/sense/decode/decoder.hpp"
#include "lumo/sense/decode/gaussian_process_decoder.hpp"
#include "lumo/sense/decode/linear_decoder.hpp"
#include "lumo/sense/decode/nearest_template.hpp"
#include "sense/synthetic.hpp"

using namespace lumo;
using namespace lumo::sense;

namespace {

/// Six places 10 mm apart, five re-contacts: 11 regions of a bump that moves with the place; re-contacts shift and
/// scale it, regions are noisy.
LabelledResponses recontacts(double shift_m, double scale, double noise, std::uint64_t seed, std::vector<int>& fold) {
  synthetic::Normal normal(seed);
  LabelledResponses d{Eigen::MatrixXd(11, 30), {}, Eigen::VectorXd::LinSpaced(6, -0.025, 0.025)};
  fold.clear();
  for (int r = 0; r < 5; ++r)
    for (int p = 0; p < 6; ++p) {
      const double y = d.place_m[p] + shift_m * normal(), height = 1.0 + scale * normal();
      for (Eigen::Index b = 0; b < 11; ++b)
        d.response(b, r * 6 + p) =
            height * std::exp(-0.5 * std::pow((double(b - 5) * 5e-3 - y) / 8e-3, 2)) + noise * normal();
      d.place.push_back(p);
      fold.push_back(r);
    }
  return d;
}

}  // namespace

TEST_CASE("a Gaussian process decodes places, and gives the coordinate between them", "[decoder]") {
  std::vector<int> fold;
  const auto d = recontacts(1e-3, 0.05, 0.02, 1, fold);
  const auto model = GaussianProcessDecoder{}.fit(d);
  const auto at = [](double y) {
    Eigen::VectorXd x(11);
    for (Eigen::Index b = 0; b < 11; ++b) x[b] = std::exp(-0.5 * std::pow((double(b - 5) * 5e-3 - y) / 8e-3, 2));
    return x;
  };
  for (int p = 0; p < 6; ++p) {
    const Decoding e = model.decode(at(d.place_m[p]));
    CHECK(e.place == p);
    CHECK(e.probability.sum() == Approx(1.0));
  }
  CHECK(model.coordinate_m(at(0.01)) == Approx(0.01).margin(2e-3));  // half-way between two places that it has seen
  CHECK_THROWS_AS(model.decode(Eigen::VectorXd::Zero(3)), InvalidArgument);
}

TEST_CASE("decoders compared on the same folds: pooled over seeds, none of the better ones is worse than templates",
    "[decoder]") {
  int right[4] = {}, all = 0;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    std::vector<int> fold;
    const auto d = recontacts(2e-3, 0.3, 0.05, seed, fold);
    const auto count = [&](const DecodingReport& r) { return int(r.confusion.diagonal().sum()); };
    right[0] += count(cross_validate(NearestTemplate{}, d, fold));
    right[1] += count(cross_validate(LinearDecoder{}, d, fold));
    right[2] += count(cross_validate(BayesDecoder{}, d, fold));
    right[3] += count(cross_validate(GaussianProcessDecoder{}, d, fold));
    all += 30;
  }
  INFO(right[0] << " " << right[1] << " " << right[2] << " " << right[3] << " of " << all);
  for (const int k : {1, 2, 3}) CHECK(right[k] >= right[0] - 5);  // of 360; differences of pairs scatter by about 3
  CHECK(wilson_interval(right[1], all).low > 0.9);
}
