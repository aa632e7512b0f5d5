#include "catch.hpp"

#include "lumo/core/units.hpp"
#include "lumo/sense/localize/bayes_localizer.hpp"
#include "lumo/sense/localize/peak_localizer.hpp"
#include "lumo/sense/profile/strip.hpp"
#include "sense/synthetic.hpp"

using namespace lumo;
using namespace lumo::sense;

namespace {

const Eigen::VectorXd places = LongitudinalBins::uniform(-27.5e-3, 27.5e-3, 55).centres_m();
constexpr std::int64_t frame_ns = 33'333'333;

Profile bump(double y, double height, double width, double noise, synthetic::Normal& normal, std::int64_t stamp = 0) {
  Profile p{stamp, Eigen::VectorXd(places.size()), 0.0};
  for (Eigen::Index i = 0; i < places.size(); ++i)
    p.value[i] = height * std::exp(-0.5 * std::pow((places[i] - y) / width, 2)) + noise * normal();
  return p;
}

PeakLocalizer peak(double noise) { return PeakLocalizer({places, Eigen::VectorXd::Constant(places.size(), noise)}); }

BayesLocalizer::Config bayes(double noise) {
  BayesLocalizer::Config c;
  c.position_m = places;
  c.noise = Eigen::VectorXd::Constant(places.size(), noise);
  return c;
}

/// Laws of LocationEstimator, for any model.
template <LocationEstimator L> void check_laws(L fresh) {
  synthetic::Normal normal(3);
  L a = fresh, b = fresh;
  std::vector<Profile> frames;
  for (int k = 0; k < 12; ++k)
    frames.push_back(bump(k < 6 ? 5e-3 : -9e-3, k % 6 < 2 ? 0.0 : 10.0, 4e-3, 0.3, normal, k * frame_ns));
  for (int k = 0; k < 8; ++k) a.update(frames[std::size_t(k)]);
  LocationEstimate before;
  for (int k = 0; k < 8; ++k) before = b.update(frames[std::size_t(k)]);
  // causal: b sees another future, what it said does not change; an old frame changes nothing
  const auto same = [](const LocationEstimate& x, const LocationEstimate& y) {
    return x.contacts == y.contacts && x.contact[0].y_m == y.contact[0].y_m &&
           x.contact[0].variance_m2 == y.contact[0].variance_m2;
  };
  Profile old = frames[2];
  old.value.setConstant(1e3);
  CHECK(same(b.update(old), before));
  CHECK(same(a.update(frames[8]), b.update(frames[8])));
  b.reset();
  L c = fresh;
  CHECK(same(b.update(frames[9]), c.update(frames[9])));
  for (const double wild : {0.0, 1e-300, 1e9, -1e9}) {
    Profile p{40 * frame_ns, Eigen::VectorXd::Constant(places.size(), wild), 0.0};
    const auto e = a.update(p);
    CHECK(std::isfinite(e.contact[0].y_m));
    CHECK(std::isfinite(e.contact[0].variance_m2));
    CHECK(std::isfinite(e.probability));
    a.reset();
  }
  CHECK_THROWS_AS(a.update(Profile{0, Eigen::VectorXd::Zero(3), 0.0}), InvalidArgument);
}

}  // namespace

TEST_CASE("localisers keep their laws", "[localizer]") {
  check_laws(peak(0.3));
  check_laws(BayesLocalizer(bayes(0.3)));
}

TEST_CASE("without noise the peak is the vertex of the bump, and the filter is first order in time", "[localizer]") {
  synthetic::Normal none(1);
  PeakLocalizer l = peak(0.01);
  for (const double y : {-20.3e-3, 0.2e-3, 11.45e-3}) {
    l.reset();
    const auto e = l.update(bump(y, 20.0, 4e-3, 0.0, none));
    REQUIRE(e.contacts == 1);
    CHECK(e.contact[0].y_m == Approx(y).margin(0.03e-3));
  }
  l.reset();
  l.update(bump(0.0, 20.0, 4e-3, 0.0, none, 0));
  Profile zero{50'000'000, Eigen::VectorXd::Zero(places.size()), 0.0};
  const auto e = l.update(zero);  // after one time constant, 1/e of the way is left
  CHECK(e.contact[0].amplitude == Approx(20.0 * std::exp(-1.0)).epsilon(0.01));
}

TEST_CASE("noise alone is no contact", "[localizer]") {
  synthetic::Normal normal(9);
  PeakLocalizer p = peak(0.3);
  BayesLocalizer b(bayes(0.3));
  int false_peaks = 0, false_bayes = 0;
  constexpr int frames = 3000;
  for (int k = 0; k < frames; ++k) {
    const Profile f = bump(0.0, 0.0, 1.0, 0.3, normal, k * frame_ns);
    false_peaks += p.update(f).contacts != 0;
    false_bayes += b.update(f).contacts != 0;
  }
  CHECK(false_peaks == 0);
  CHECK(false_bayes <= frames / 200);
}

TEST_CASE("the number of contacts is found, with lamps and room that drift", "[localizer]") {
  synthetic::Normal normal(21);
  auto c = bayes(0.3);
  c.unloaded = Eigen::VectorXd::Constant(places.size(), 100.0) + 20.0 * (places / 0.03);
  const int expected_at[] = {0, 1, 2};
  for (const int expected : expected_at) {
    int right = 0;
    double error = 0.0;
    constexpr int trials = 150;
    for (int t = 0; t < trials; ++t) {
      BayesLocalizer l(c);
      const double y1 = -22e-3 + 14e-3 * normal.uniform(), y2 = 6e-3 + 16e-3 * normal.uniform(),
                   w = (3.0 + 1.5 * normal.uniform()) * 1e-3;
      const double lamp = 0.01 * normal(), room = 0.3 * normal();
      LocationEstimate e;
      for (int k = 0; k < 4; ++k) {
        Profile f = bump(y1, expected > 0 ? 8.0 : 0.0, w, 0.3, normal, k * frame_ns);
        if (expected == 2) f.value += bump(y2, 6.0, w, 0.0, normal).value;
        f.value += lamp * c.unloaded + Eigen::VectorXd::Constant(places.size(), room);
        e = l.update(f);
      }
      right += e.contacts == expected;
      if (e.contacts == 2 && expected == 2)
        error = std::max({error, std::abs(e.contact[0].y_m - y1), std::abs(e.contact[1].y_m - y2)});
    }
    INFO("contacts " << expected);
    CHECK(right >= trials * 97 / 100);
    CHECK(error < 1.5e-3);
  }
}

TEST_CASE("intervals of the probabilistic localiser hold what they promise", "[localizer]") {
  // Bumps as assumed, white noise, no further error: 90 % intervals must hold 90 % of the places, at small and large
  // signals.
  auto c = bayes(1.0);
  c.bias_sigma_m = 0.0;
  c.shape_error = 0.0;
  c.spacing_m = 0.25e-3;
  c.ambient_sigma = 0.0;
  for (const double height : {6.0, 15.0, 60.0}) {
    synthetic::Normal normal{std::uint64_t(height)};
    BayesLocalizer l(c);
    int inside = 0, found = 0;
    double squares = 0.0;
    constexpr int trials = 1500;
    for (int t = 0; t < trials; ++t) {
      l.reset();
      const double y = -22e-3 + 44e-3 * normal.uniform(), w = c.width_m[std::size_t(4.0 * normal.uniform())];
      const auto e = l.update(bump(y, height, w, 1.0, normal));
      if (e.contacts != 1) continue;
      ++found;
      const double z = (e.contact[0].y_m - y) / std::sqrt(e.contact[0].variance_m2);
      inside += std::abs(z) < 1.6448536;
      squares += z * z;
    }
    INFO("height " << height << ", found " << found << ", mean square " << squares / found);
    CHECK(found > trials * 9 / 10);
    CHECK(double(inside) / found > 0.85);
    CHECK(double(inside) / found < 0.95);
  }
}

TEST_CASE("a contact that moves on is followed", "[localizer]") {
  synthetic::Normal normal(2);
  BayesLocalizer b(bayes(0.3));
  PeakLocalizer p = peak(0.3);
  for (int k = 0; k < 60; ++k) {
    const double y = k < 30 ? -15e-3 : 12e-3;
    const Profile f = bump(y, 10.0, 4e-3, 0.3, normal, k * frame_ns);
    const auto e = b.update(f), q = p.update(f);
    if (k % 30 >= 6) {
      CHECK(std::abs(e.contact[0].y_m - y) < 0.5e-3);
      CHECK(std::abs(q.contact[0].y_m - y) < 1e-3);
    }
  }
}

TEST_CASE("a contact's random walk widens the place as much at any frame rate", "[localizer]") {
  auto c = bayes(1.0);
  c.change_rate_per_s = 1e-9;
  c.shape_error = 0.0;
  c.ambient_sigma = 0.0;
  c.width_m.fill(2e-3);
  c.from_m = -12e-3;
  c.to_m = 12e-3;  // no bump reaches the profile's ends, where darkness would be information
  const auto variance = [](const BayesLocalizer& l) {
    const double mean = l.place().dot(l.grid_m());
    return l.place().dot((l.grid_m().array() - mean).square().matrix());
  };
  synthetic::Normal none(1);
  for (const int rate : {4, 10, 30, 60, 100, 1000}) {
    BayesLocalizer l(c);
    l.update(bump(0.0, 400.0, 2e-3, 0.0, none, 0));
    const double before = variance(l);
    // Darkness says nothing of where: all places explain it alike.
    for (int k = 1; k <= rate; ++k)
      l.update(Profile{k * (1'000'000'000LL / rate), Eigen::VectorXd::Zero(places.size()), 0.0});
    INFO(rate << " frames per second");
    CHECK(variance(l) - before == Approx(1e-6).epsilon(0.03));  // 1 mm/√s for a second
  }
}

TEST_CASE("what profiles add one by one is the information of all of them together", "[localizer]") {
  // White noise alone: estimates taken as independent, with the noises that they state, must end with the variance that
  // the posterior has.
  auto c = bayes(1.0);
  c.shape_error = 0.0;
  c.ambient_sigma = 0.0;
  c.bias_sigma_m = 0.0;
  c.change_rate_per_s = 1e-6;
  c.spacing_m = 0.1e-3;
  c.creep_m_per_sqrt_s = 0.2e-3;
  c.from_m = -15e-3;
  c.to_m = 15e-3;
  synthetic::Normal normal(8);
  BayesLocalizer l(c);
  double information = 0.0;
  LocationEstimate e;
  for (int k = 0; k < 12; ++k) {
    e = l.update(bump(2e-3, 15.0, 4e-3, 1.0, normal, k * frame_ns));
    REQUIRE(e.contacts == 1);
    information = 1.0 / ((information > 0.0 ? 1.0 / information + 4e-8 * 1e-9 * double(frame_ns) : 1e9)) +
                  1.0 / e.contact[0].noise_variance_m2;
  }
  CHECK(1.0 / information == Approx(e.contact[0].variance_m2).epsilon(0.15));
  // Another contact, far away: its information is its own.
  for (int k = 12; k < 24 && std::abs(e.contact[0].y_m - 2e-3) < 1e-3; ++k)
    e = l.update(bump(-8e-3, 15.0, 4e-3, 1.0, normal, k * frame_ns));
  CHECK(e.contact[0].y_m == Approx(-8e-3).margin(1.5e-3));
  CHECK(e.contact[0].noise_variance_m2 == Approx(e.contact[0].variance_m2));
  c.bias_sigma_m = 0.7e-3;
  BayesLocalizer biased(c);
  CHECK(biased.update(bump(2e-3, 15.0, 4e-3, 1.0, normal)).contact[0].bias_variance_m2 == Approx(0.49e-6));
}

TEST_CASE("after a gap a contact must begin anew", "[localizer]") {
  synthetic::Normal none(1);
  PeakLocalizer l = peak(1.0);  // begins above 6 noises, ends below 4
  CHECK(l.update(bump(0.0, 20.0, 4e-3, 0.0, none, 0)).contacts == 1);
  CHECK(l.update(bump(0.0, 5.0, 4e-3, 0.0, none, 2'000'000'000)).contacts == 0);
}

TEST_CASE("a contact near a clear end, which throws its light back, is found where it is", "[localizer]") {
  synthetic::Normal normal(31);
  const auto mean_error = [&](bool knows_of_ends) {
    double error = 0.0;
    for (int k = 0; k < 40; ++k) {
      const double y = (k % 2 == 0 ? 1.0 : -1.0) * (23.0e-3 + 0.1e-3 * k);
      Profile p = bump(y, 20.0, 4e-3, 0.3, normal);
      const Profile image = bump(std::copysign(60e-3, y) - y, 10.0, 4e-3, 0.0,
          normal);  // the pad ends at ±30 mm, half of the light comes back
      p.value += image.value;
      auto c = bayes(0.3);
      c.from_m = -27.5e-3;
      c.to_m = 27.5e-3;
      if (knows_of_ends) {
        c.end_m = 30e-3;
        c.end_share = 0.5;
      }
      const auto e = BayesLocalizer(c).update(p);
      REQUIRE(e.contacts == 1);
      error += std::abs(e.contact[0].y_m - y) / 40.0;
    }
    return error;
  };
  CHECK(mean_error(true) < 0.4e-3);
  CHECK(mean_error(false) > 2.0 * mean_error(true));
}

TEST_CASE("configurations out of range are refused", "[localizer]") {
  const auto refuses = [](auto change) {
    auto c = bayes(0.3);
    change(c);
    CHECK_THROWS_AS(BayesLocalizer(c), InvalidArgument);
  };
  refuses([](auto& c) { c.creep_m_per_sqrt_s = -1e-3; });
  refuses([](auto& c) { c.ambient_sigma = std::nan(""); });
  refuses([](auto& c) { c.lamp_sigma = -1.0; });
  refuses([](auto& c) { c.bias_sigma_m = std::nan(""); });
  refuses([](auto& c) { c.gap_s = 0.0; });
  refuses([](auto& c) { c.end_m = -1.0; });
  refuses([](auto& c) { c.end_share = 1.5; });
  refuses([](auto& c) { c.position_m[3] = c.position_m[2]; });
  refuses([](auto& c) { c.spacing_m = 60e-3 / 4000.0; });
  Eigen::VectorXd wrong = places;
  wrong[4] = std::nan("");
  CHECK_THROWS_AS(PeakLocalizer({wrong, Eigen::VectorXd::Constant(places.size(), 0.3)}), InvalidArgument);
}
