#include "catch.hpp"

#include "lumo/sense/devices/photodiodes.hpp"
#include "lumo/sense/devices/replay.hpp"
#include "lumo/sense/profile/green_profile.hpp"
#include "lumo/sense/profile/led_detector.hpp"
#include "lumo/sense/profile/unloaded_reference.hpp"
#include "sense/synthetic.hpp"

using namespace lumo;
using namespace lumo::sense;
using synthetic::View;

namespace {

AxisMap map_of(const View& v, double sigma_px = 0.1) {
  Eigen::Matrix2Xd pixel(2, 5);
  Eigen::VectorXd y(5);
  for (int k = 0; k < 5; ++k) {
    y[k] = 11e-3 * (k - 2);
    pixel.col(k) = v.pixel(y[k]);
  }
  return AxisMap::fit(pixel, y, sigma_px);
}

/// Mean green of all pixels whose centre lies in the bin and the band: straight from the definition.
Eigen::VectorXd direct_profile(
    const View& v, const Image& image, const LongitudinalBins& bins, double low, double high) {
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(bins.size()), count = sum;
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) {
      const Eigen::Vector2d p = Eigen::Vector2d(x, y) - v.origin, d = v.direction();
      const double along = v.y(p.dot(d)), across = (-p.x() * d.y() + p.y() * d.x()) / v.px_per_m;
      if (across < low || across >= high) continue;
      for (Eigen::Index b = 0; b < bins.size(); ++b)
        if (along >= bins.edges_m[b] && along < bins.edges_m[b + 1]) {
          sum[b] += image.view().green(x, y);
          count[b] += 1.0;
        }
    }
  return sum.cwiseQuotient(count);
}

double smooth_light(double y, double across) { return 90.0 + 1500.0 * y + 30.0 * std::sin(200.0 * y) + 800.0 * across; }

}  // namespace

TEST_CASE("the axis map finds a projective line again", "[profiles]") {
  View v;
  v.angle_rad = 0.7;
  v.perspective = 3.0;
  const AxisMap map = map_of(v);
  CHECK(map.residual_px < 1e-8);
  for (const double y : {-27.5e-3, -13e-3, 0.0, 4e-3, 27.5e-3}) {
    const double u = map.u_px(v.pixel(y));
    CHECK(map.y_m(u) == Approx(y).margin(1e-9));
    CHECK(map.u_px(y) == Approx(u).margin(1e-6));
    const double h = 0.01;
    CHECK(map.scale_m_per_px(u) == Approx((map.y_m(u + h) - map.y_m(u - h)) / (2 * h)).epsilon(1e-6));
  }
  Eigen::Matrix2Xd two(2, 2);
  two << 0, 1, 0, 0;
  CHECK_THROWS_AS(AxisMap::fit(two, Eigen::Vector2d(0, 1)), InvalidArgument);
}

TEST_CASE("the axis map's variance is that of fits to jittered places", "[profiles]") {
  View v;
  v.perspective = 2.0;
  synthetic::Normal normal(5);
  const double sigma = 0.4;
  const AxisMap expected = map_of(v, sigma);
  for (const double y : {-25e-3, -5e-3, 20e-3}) {
    double sum = 0.0, squares = 0.0;
    constexpr int trials = 4000;
    for (int t = 0; t < trials; ++t) {
      Eigen::Matrix2Xd pixel(2, 5);
      Eigen::VectorXd place(5);
      for (int k = 0; k < 5; ++k) {
        place[k] = 11e-3 * (k - 2);
        pixel.col(k) = v.pixel(place[k]) + sigma * Eigen::Vector2d(normal(), normal());
      }
      const AxisMap m = AxisMap::fit(pixel, place, 1e-3);
      const double error = m.y_m(m.u_px(v.pixel(y))) - y;
      sum += error;
      squares += error * error;
    }
    const double found = squares / trials - std::pow(sum / trials, 2);
    CHECK(expected.variance_m2(expected.u_px(v.pixel(y))) ==
          Approx(found).epsilon(0.08));  // standard error of a variance from 4000: 2.2 %
  }
}

TEST_CASE("a profile is the mean green of the pixels in each bin, at any angle and in both formats", "[profiles]") {
  const auto bins = LongitudinalBins::regions();
  for (const double degrees : {0.0, 4.0, -7.0, 90.0, 84.0, 180.0, -95.0})
    for (const PixelFormat format : {PixelFormat::bgr, PixelFormat::grey}) {
      View v;
      v.angle_rad = degrees * pi / 180.0;
      v.px_per_m = std::abs(std::sin(v.angle_rad)) > 0.5 ? 7000.0 : 9000.0;
      const Image image = synthetic::paint(v, smooth_light, 2.0, 11, format);
      GreenProfile readout({map_of(v), bins, -6.0_mm, 10.0_mm, v.width, v.height, format});
      Profile p;
      REQUIRE(readout.read(Frame{image.view(), 17}, p));
      CHECK(p.stamp_ns == 17);
      // Sheared bins gather other pixels at their ends than turned ones: a pixel row's share of a bin's gradient.
      CHECK((p.value - direct_profile(v, image, bins, -6.0_mm, 10.0_mm)).cwiseAbs().maxCoeff() < 0.35);
      CHECK(p.saturated == 0.0);
    }
}

TEST_CASE("an upright view in one format gives sums that are exact", "[profiles]") {
  // Bins of whole pixels, level axis: the mean over rows and columns, no rounding but the last division.
  View v;
  v.width = 600;
  v.height = 301;
  v.origin = {299.5, 150.0};
  v.px_per_m = 10000.0;
  AxisMap map;
  map.origin_px = v.origin;
  map.half_length_px = 100.0;
  map.coefficients = {0.0, 10.0_mm, 0.0};
  const Image image = synthetic::paint(v, smooth_light, 20.0, 3);
  const auto bins = LongitudinalBins::uniform(-25.0_mm, 25.0_mm, 10);
  GreenProfile readout(
      {map, bins, -14.95_mm, 14.95_mm, v.width, v.height, PixelFormat::bgr});  // 299 rows: more than 16 bits take
  Profile p;
  REQUIRE(readout.read(Frame{image.view(), 0}, p));
  for (int b = 0; b < 10; ++b) {
    long sum = 0, count = 0;
    for (int y = 1; y < 300; ++y)
      for (int x = 50 + 50 * b; x < 100 + 50 * b; ++x) {
        sum += image.view().green(x, y);
        ++count;
      }
    CHECK(p.value[b] == Approx(double(sum) / double(count)).epsilon(1e-12));
  }
}

TEST_CASE("every n-th line along the finger is read, level or upright", "[profiles]") {
  for (const double angle : {0.0, pi / 2, -1.3}) {
    View v;
    v.width = v.height = 640;
    v.origin = {320.0, 320.0};
    v.angle_rad = angle;
    const Image image = synthetic::paint(v, smooth_light, 0.0, 3);
    const auto bins = LongitudinalBins::uniform(-25.0_mm, 25.0_mm, 25);
    const auto profile = [&](int step) {
      GreenProfile readout({.map = map_of(v),
          .bins = bins,
          .band_low_m = -5.0_mm,
          .band_high_m = 5.0_mm,
          .width = v.width,
          .height = v.height,
          .row_step = step});
      Profile p;
      REQUIRE(readout.read(Frame{image.view(), 0}, p));
      return p.value;
    };
    INFO("angle " << angle);
    // The light's slope across the finger is 7.2 DN over the band of 90 lines: every third line is off by no more than
    // a line's 0.1 DN, and rounding.
    CHECK((profile(3) - profile(1)).cwiseAbs().maxCoeff() < 0.3);
  }
}

TEST_CASE("where the perspective is beyond what a camera sees, the rest of the map is the best for what is left",
    "[profiles]") {
  // Places as y = b s/(1 + c s) with c = 0.6 has them, which the fit does not take. Independent: scan a and b for c =
  // ½.
  Eigen::Matrix2Xd pixel = Eigen::Matrix2Xd::Zero(2, 5);
  Eigen::VectorXd y(5);
  for (int k = 0; k < 5; ++k) {
    pixel(0, k) = 100.0 * (k - 2);
    y[k] = 20e-3 * (0.5 * (k - 2)) / (1.0 + 0.3 * (k - 2));
  }
  const AxisMap map = AxisMap::fit(pixel, y);
  REQUIRE(map.coefficients[2] == 0.5);
  const auto misfit = [&](double a, double b) {
    AxisMap m = map;
    m.coefficients = {a, b, 0.5};
    double sum = 0.0;
    for (int k = 0; k < 5; ++k) sum += std::pow(m.u_px(y[k]) - pixel(0, k), 2);
    return sum;
  };
  const double best = misfit(map.coefficients[0], map.coefficients[1]);
  CHECK(map.residual_px > 0.1);
  // u(y) − u and its linearisation (y(u) − y)/y'(u) have nearby minima: no place within a tenth of the coefficients is
  // much better.
  double least = best;
  for (int i = -20; i <= 20; ++i)
    for (int j = -20; j <= 20; ++j)
      least = std::min(least, misfit(map.coefficients[0] + 1e-4 * i, map.coefficients[1] * (1.0 + 0.01 * j)));
  INFO("misfit " << best << ", least " << least);
  CHECK(best < 1.5 * least);
}

TEST_CASE("what is not of the readout's size is refused and changes nothing", "[profiles]") {
  const View v;
  GreenProfile readout({map_of(v)});
  Profile p;
  p.stamp_ns = 5;
  const Image small = Image::black(320, 240), grey = Image::black(640, 480, PixelFormat::grey);
  CHECK_FALSE(readout.read(Frame{small.view(), 9}, p));
  CHECK_FALSE(readout.read(Frame{grey.view(), 9}, p));
  CHECK_FALSE(readout.read(Frame{{}, 9}, p));
  CHECK(p.stamp_ns == 5);
  GreenProfile::Config outside{map_of(v)};
  outside.bins = LongitudinalBins::uniform(-60.0_mm, 60.0_mm, 11);
  CHECK_THROWS_AS(GreenProfile(outside), InvalidArgument);
  outside.bins = LongitudinalBins::uniform(-30.0_mm, 60.0_mm, 11);
  CHECK_THROWS_AS(PositiveGreenProfile(outside, Image::black(640, 480)), InvalidArgument);
}

TEST_CASE("the positive profile counts what got brighter and forgets what got darker", "[profiles]") {
  const View v;
  const auto dark = synthetic::paint(
      v, [](double, double) { return 100.0; }, 0.0, 1);
  const auto touched = synthetic::paint(
      v, [](double y, double across) { return y > 5e-3 && y < 10e-3 ? (across > 0.0 ? 120.0 : 60.0) : 100.0; }, 0.0, 1);
  const auto bins = LongitudinalBins::uniform(-25.0_mm, 25.0_mm, 10);
  const GreenProfile::Config config{map_of(v), bins, -8.0_mm, 8.0_mm};
  PositiveGreenProfile positive(config, dark);
  GreenProfile plain(config);
  Profile p, q;
  REQUIRE(positive.read(Frame{touched.view(), 0}, p));
  REQUIRE(plain.read(Frame{touched.view(), 0}, q));
  for (int b = 0; b < 10; ++b) {
    CHECK(p.value[b] ==
          Approx(b == 6 ? 10.0 : 0.0).margin(0.5));  // a row and two columns of 144 and 45 stand on the border
    CHECK(q.value[b] - 100.0 == Approx(b == 6 ? -10.0 : 0.0).margin(0.7));
  }
}

TEST_CASE("full pixels are counted", "[profiles]") {
  const View v;
  const auto image = synthetic::paint(
      v, [](double y, double) { return y > 0.0 ? 255.0 : 10.0; }, 0.0, 1);
  GreenProfile readout({map_of(v)});
  Profile p;
  REQUIRE(readout.read(Frame{image.view(), 0}, p));
  CHECK(p.saturated == Approx(0.5).margin(0.01));
}

TEST_CASE("five LEDs are found by their pitch, with the map, among reflections and noise", "[leds]") {
  for (const double degrees : {0.0, 12.0, -88.0}) {
    View v;
    v.angle_rad = degrees * pi / 180.0;
    v.perspective = 2.0;
    v.px_per_m = std::abs(degrees) > 45.0 ? 7000.0 : 9000.0;
    const auto image = synthetic::paint(
        v,
        [](double y, double across) {
          // a lamp's reflection beside the row and a spot in the row, out of step
          const double other = 200.0 * std::exp(-0.5 * (std::pow(y - 6e-3, 2) + std::pow(across - 9e-3, 2)) / 1e-6);
          return synthetic::leds(y, across) + other +
                 150.0 * std::exp(-0.5 * (std::pow(y + 16e-3, 2) + across * across) / 1e-6);
        },
        2.0, 4);
    LedDetector detector;
    detector.distal = v.direction();
    const auto found = detector.find(image.view());
    REQUIRE(found);
    for (int k = 0; k < 5; ++k) CHECK((found->centroid_px.col(k) - v.pixel(11e-3 * (k - 2))).norm() < 0.25);
    for (const double y : {-25e-3, 0.0, 13e-3}) {
      const double u = found->map.u_px(v.pixel(y));
      CHECK(std::abs(found->map.y_m(u) - y) < 4.0 * std::sqrt(found->map.variance_m2(u)));
      CHECK(std::sqrt(found->map.variance_m2(u)) < 0.1e-3);
    }
    LedDetector other = detector;  // the tip on the other side: the same row, numbered from the other end
    other.distal = -v.direction();
    const auto turned = other.find(image.view());
    REQUIRE(turned);
    CHECK((turned->centroid_px.col(0) - found->centroid_px.col(4)).norm() < 1e-9);
  }
}

TEST_CASE("no row of LEDs, no detection", "[leds]") {
  const View v;
  CHECK_FALSE(LedDetector{}.find(Image::black(64, 48).view()));
  CHECK_FALSE(LedDetector{}.find(synthetic::paint(
      v, [](double, double) { return 60.0; }, 3.0, 8)
                                     .view()));
  const auto four = synthetic::paint(
      v, [](double y, double across) { return y > 16e-3 ? 8.0 : synthetic::leds(y, across); }, 2.0, 4);
  CHECK_FALSE(LedDetector{}.find(four.view()));
  CHECK_THROWS_AS(LedDetector{}.find(ImageView{}), InvalidArgument);
}

TEST_CASE("the unloaded reference has the moments of its profiles", "[profiles]") {
  UnloadedReference r;
  for (const double x : {1.0, 2.0, 4.0}) r.add({0, Eigen::Vector2d(x, 10.0 * x), 0.0});
  CHECK(r.mean()[0] == Approx(7.0 / 3.0));
  CHECK(r.noise(0.0)[0] ==
        Approx(std::sqrt((16.0 + 1.0 + 25.0) / 9.0 / 2.0 * (4.0 / 3.0))));  // deviations −4/3, −1/3, 5/3
  CHECK(r.noise(0.0)[1] == Approx(10.0 * r.noise(0.0)[0]));
  CHECK_THROWS_AS(r.add({0, Eigen::VectorXd::Zero(3), 0.0}), InvalidArgument);
  CHECK_THROWS_AS(r.add({0, Eigen::Vector2d(0.0, std::nan("")), 0.0}), InvalidArgument);
}

TEST_CASE("photodiodes give calibrated light, a camera in memory gives each frame once", "[profiles]") {
  PhotodiodeArray array(
      {Eigen::Vector3d(-0.01, 0.0, 0.01), Eigen::Vector3d(0.1, 0.1, 0.2), Eigen::Vector3d(1.0, 2.0, 4.0), 3.3});
  Profile p;
  REQUIRE(array.read({8, Eigen::Vector3d(1.1, 0.6, 3.3)}, p));
  CHECK((p.value - Eigen::Vector3d(1.0, 1.0, 12.4)).norm() < 1e-12);
  CHECK(p.saturated == Approx(1.0 / 3.0));
  CHECK_FALSE(array.read({9, Eigen::Vector2d(1.0, 1.0)}, p));
  CHECK_FALSE(array.read({9, Eigen::Vector3d(1.0, std::nan(""), 1.0)}, p));
  CHECK_THROWS_AS(PhotodiodeArray({Eigen::Vector3d(0.0, 0.0, 0.01), {}, {}, 3.3}), InvalidArgument);

  RecordedCamera camera({{Image::black(4, 3), 10, 0.001, 2.0}, {Image::black(4, 3), 20, 0.001, 2.0}});
  CHECK(camera.next()->stamp_ns == 10);
  CHECK(camera.state() == StreamState::open);
  CHECK(camera.next()->index == 1);
  CHECK(camera.state() == StreamState::ended);
  CHECK_FALSE(camera.next());
  CHECK_THROWS_AS(Image::black(0, 3), InvalidArgument);
}
