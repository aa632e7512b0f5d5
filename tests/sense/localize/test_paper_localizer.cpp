#include "catch.hpp"

#include "lumo/core/units.hpp"
#include "lumo/sense/localize/paper_localizer.hpp"
#include "lumo/sense/profile/bright_rows.hpp"

#include <cmath>

using namespace lumo;
using namespace lumo::sense;

namespace {

const Eigen::VectorXd paper_rows = Eigen::VectorXd::LinSpaced(256, -33e-3, 33e-3);

Profile paper_profile(double y, double height, std::int64_t stamp_ns, double level = 0.5) {
  Profile p{stamp_ns, Eigen::VectorXd::Constant(paper_rows.size(), level), 0.0};
  for (Eigen::Index i = 0; i < p.value.size(); ++i)
    p.value[i] += height * std::exp(-0.5 * std::pow((paper_rows[i] - y) / 4e-3, 2));
  return p;
}

PaperLocalizer::Config paper_config() {
  PaperLocalizer::Config c;
  c.position_m = paper_rows;
  c.unloaded = {paper_profile(0.0, 0.0, 0), paper_profile(0.0, 0.0, 1), paper_profile(0.0, 0.0, 2)};
  return c;
}

/// A picture with five LEDs at y = −22 … 22 mm, 4 px a mm, and a finger of 40 px across.
struct SeenLeds {
  FingerView view;
  Eigen::VectorXd led_m = Eigen::VectorXd::LinSpaced(5, -22e-3, 22e-3);
  SeenLeds() {
    view.width = 400;
    view.height = 100;
    view.format = PixelFormat::grey;
    view.leds.centroid_px.resize(2, 5);
    for (int k = 0; k < 5; ++k) view.leds.centroid_px.col(k) = Eigen::Vector2d(112.0 + 44.0 * k, 50.0);
    view.leds.map = AxisMap::fit(view.leds.centroid_px, led_m);
    view.band_low_m = -5e-3;
    view.band_high_m = 5e-3;
  }
};

}  // namespace

TEST_CASE(
    "the paper's localiser finds the centroid or the largest row of what stands above four noises", "[localizer]") {
  for (const double y : {-20.2e-3, 0.0, 13.7e-3}) {
    PaperLocalizer centroid(paper_config());
    auto largest_config = paper_config();
    largest_config.place = PaperLocalizer::Place::largest;
    PaperLocalizer largest(largest_config);
    // a bump with a shoulder: the centroid is pulled, the largest row is not
    Profile p = paper_profile(y, 20.0, 10);
    p.value += paper_profile(y + 6e-3, 10.0, 10, 0.0).value;
    const auto c = centroid.update(p), l = largest.update(p);
    REQUIRE(c.contacts == 1);
    REQUIRE(l.contacts == 1);
    CHECK(l.contact[0].y_m == Approx(y).margin(1.5e-3));
    CHECK(c.contact[0].y_m > l.contact[0].y_m + 0.5e-3);
  }
  PaperLocalizer one(paper_config());
  CHECK(one.update(paper_profile(7e-3, 20.0, 1)).contact[0].y_m == Approx(7e-3).margin(0.05e-3));
}

TEST_CASE("the paper's localiser has a causal median of three frames and its gates", "[localizer]") {
  PaperLocalizer l(paper_config());
  l.update(paper_profile(0.0, 0.0, 1));
  l.update(paper_profile(0.0, 0.0, 2));
  CHECK(l.update(paper_profile(5e-3, 20.0, 3)).contacts == 0);  // one of three
  CHECK(l.update(paper_profile(5e-3, 20.0, 4)).contacts == 1);  // two of three
  l.reset();
  CHECK(l.update(paper_profile(5e-3, 20.0, 5)).contacts == 1);
  // 4 noises of 0.75 DN: 3 DN; the bump's filtered top is 0.97 of its height
  l.reset();
  CHECK(l.update(paper_profile(5e-3, 2.9, 6)).contacts == 0);
  l.reset();
  CHECK(l.update(paper_profile(5e-3, 5.0, 7)).contacts == 1);
  const auto gated = [](auto change) {
    PaperLocalizer fresh(paper_config());
    Profile p = paper_profile(5e-3, 20.0, 9);
    change(p);
    const LocationEstimate e = fresh.update(p);
    CHECK(e.contacts == 0);
    CHECK(e.unknown);
  };
  gated([](Profile& p) { p.saturated = 0.06; });
  gated([](Profile& p) { p.nearly_saturated = 0.26; });
  gated([](Profile& p) { p.value.setConstant(30.0); });  // even: no contrast
  CHECK_THROWS_AS(l.update(Profile{20, Eigen::VectorXd::Zero(3), 0.0}), InvalidArgument);
  auto none = paper_config();
  none.unloaded.clear();
  CHECK_THROWS_AS(PaperLocalizer(none), InvalidArgument);
}

TEST_CASE("a bright row is the mean of its brightest tenth, against the unloaded picture", "[localizer]") {
  const SeenLeds leds;
  Image unloaded = Image::black(400, 100, PixelFormat::grey), now = unloaded;
  for (auto& v : unloaded.pixels) v = 40;
  now = unloaded;
  // at y = 5.5 mm (u = 222 px) a stripe of 5 px across is 30 DN brighter, everything else there darker
  for (int x = 215; x < 230; ++x)
    for (int v = 30; v < 70; ++v) now.row(v)[x] = v < 35 ? 70 : 10;
  BrightRows rows({leds.view, leds.led_m, unloaded});
  Profile p;
  REQUIRE(rows.read({now.view(), 5}, p));
  const Eigen::VectorXd y = rows.positions_m();
  CHECK(y[0] == Approx(-33e-3));
  CHECK(y[255] == Approx(33e-3));
  Eigen::Index at = 0, far = 0;
  (y.array() - 5.5e-3).abs().minCoeff(&at);
  (y.array() + 11e-3).abs().minCoeff(&far);
  CHECK(p.value[at] == Approx(30.0).margin(1.0));  // a tenth of 40 px
  CHECK(p.value[far] == 0.0);
  CHECK(p.saturated == 0.0);
  CHECK_FALSE(rows.read({Image::black(10, 10, PixelFormat::grey).view(), 6}, p));
  BrightRows::Config wrong{leds.view, leds.led_m.head(3), unloaded};
  CHECK_THROWS_AS(BrightRows(wrong), InvalidArgument);
}
