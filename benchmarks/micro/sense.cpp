#include "kernel.hpp"

#include "lumo/core/units.hpp"
#include "lumo/sense/decode/bayes_decoder.hpp"
#include "lumo/sense/decode/linear_decoder.hpp"
#include "lumo/sense/force/force_estimator.hpp"
#include "lumo/sense/localize/bayes_localizer.hpp"
#include "lumo/sense/localize/peak_localizer.hpp"
#include "lumo/sense/profile/green_profile.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

using namespace lumo;
using namespace lumo::sense;
using namespace lumo::micro;

namespace {

constexpr std::int64_t ms = 1'000'000;

/// A number with mean 0 and variance 1, the same for the same key.
double noise(std::uint64_t key) { return std::sqrt(12.0) * (double(combine(key, 1) >> 11) * 0x1p-53 - 0.5); }

/// The finger in a picture of 640 × 480, four fifths of its width and a third of its height, three degrees askew; with
/// a contact at 8 mm or without.
struct Finger {
  AxisMap map;
  Finger() {
    const double px_per_m = 0.8 * 640 / 0.055, askew = 3.0 / 180.0 * pi;
    map.origin_px = {320.0, 240.0};
    map.direction = {std::cos(askew), std::sin(askew)};
    map.half_length_px = 0.022 * px_per_m;
    map.coefficients = {0.0, 22.0_mm, 0.0};
  }
  GreenProfile::Config config() const {
    const double half = 0.165 * 480 * map.scale_m_per_px(0.0);
    return {map, LongitudinalBins::uniform(-27.5_mm, 27.5_mm, 55), -half, half, 640, 480};
  }
  Image picture(bool contact, std::uint64_t key) const {
    Image image = Image::black(640, 480);
    for (int y = 0; y < 480; ++y)
      for (int x = 0; x < 640; ++x) {
        const double at = map.y_m(map.u_px(Eigen::Vector2d(x, y)));
        const double light =
            90.0 + 500.0 * at + (contact ? 12.0 * std::exp(-0.5 * std::pow((at - 8e-3) / 4e-3, 2)) : 0.0);
        for (int c = 0; c < 3; ++c)
          image.row(y)[3 * x + c] = std::uint8_t(std::clamp(
              light + 2.5 * noise(key << 40 | std::uint64_t(y) << 20 | std::uint64_t(4 * x + c)), 0.0, 255.0));
      }
    return image;
  }
};

struct Recording {
  Finger finger;
  GreenProfile readout{finger.config()};
  UnloadedReference reference;
  std::vector<Image> touched;
  std::vector<Profile> responses;  ///< of `touched`

  Recording() {
    Profile p;
    for (std::uint64_t k = 0; k < 12; ++k) {
      const Image untouched = finger.picture(false, k);
      readout.read(Frame{untouched.view()}, p);
      reference.add(p);
    }
    for (std::uint64_t k = 0; k < 4; ++k) {
      touched.push_back(finger.picture(true, 100 + k));
      readout.read(Frame{touched.back().view()}, p);
      reference.subtract(p);
      responses.push_back(p);
    }
  }
  PeakLocalizer peak() const {
    return PeakLocalizer({.position_m = readout.positions_m(), .noise = reference.noise()});
  }
  BayesLocalizer bayes() const {
    BayesLocalizer::Config c;
    c.position_m = readout.positions_m();
    c.noise = reference.noise();
    c.unloaded = reference.mean();
    return BayesLocalizer(c);
  }
};

const Recording& recording() {
  static const Recording r;
  return r;
}

/// Streams that give out what was put into them.
template <class Item> struct Fed {
  std::vector<Item> items;
  std::size_t given = 0;
  std::optional<Item> next() {
    if (given < items.size()) return items[given++];
    items.clear();
    given = 0;
    return std::nullopt;
  }
  StreamState state() const { return StreamState::open; }
};

template <class Localizer> void time_localizer(const std::string& name, Localizer localizer) {
  const Recording& r = recording();
  std::int64_t k = 0;
  LocationEstimate last;
  const auto update = [&] {
    Profile p = r.responses[std::size_t(k) % r.responses.size()];
    p.stamp_ns = ++k * 33 * ms;
    return last = localizer.update(p);
  };
  for (int i = 0; i < 30; ++i) update();
  REQUIRE(last.contacts == 1);
  REQUIRE(std::abs(last.contact[0].y_m - 8e-3) < 2e-3);
  BENCHMARK(named("one step of a localiser", "1 profile of 55 values", name)) { return update(); };
}

template <class Localizer> void time_estimator(const std::string& name, Localizer localizer) {
  const Recording& r = recording();
  Fed<Frame> camera;
  Fed<JointSample> actuator;
  using Estimator = ForceEstimator<Fed<Frame>, Fed<JointSample>, Localizer>;
  Estimator estimator(
      camera, actuator, {r.readout, r.reference}, std::move(localizer), MomentArm{0.05}, typename Estimator::Config{});
  std::int64_t k = 0;
  ForceEstimate last;
  const auto step = [&] {  // a frame that was taken 20 ms ago and the torque samples of one frame's time
    const std::int64_t now = ++k * 33 * ms + 20 * ms;
    for (int j = 0; j < 33; ++j) {
      const std::int64_t t = now - (32 - j) * ms;
      actuator.items.push_back({t, JointVector::Zero(1), JointVector::Constant(1, 0.001 * noise(std::uint64_t(t) + 1)),
          JointVector::Constant(1, 0.52 + 0.01 * noise(std::uint64_t(t)))});
    }
    camera.items.push_back({r.touched[std::size_t(k) % r.touched.size()].view(), now - 20 * ms});
    return last = estimator.step(now);
  };
  for (int i = 0; i < 60; ++i) step();
  REQUIRE(last.contact[0].force_N);
  REQUIRE(std::abs(*last.contact[0].force_N - 9.0) < 2.0);  // 0.52 N·m on an arm of 58 mm
  BENCHMARK(named("one step of the force estimator", "1 frame of 640 x 480 with 33 torque samples", name)) {
    return step();
  };
}

}  // namespace

TEST_CASE("sense: profile of a picture", "[sense]") {
  const Recording& r = recording();
  GreenProfile green(r.finger.config());
  PositiveGreenProfile positive(r.finger.config(), r.finger.picture(false, 7));
  Profile p;
  std::size_t k = 0;
  const auto read = [&](auto& readout) {  // four pictures of a megabyte in turn
    readout.read(Frame{r.touched[++k % r.touched.size()].view()}, p);
    return p.value[30];
  };
  REQUIRE(read(green) > 50.0);
  BENCHMARK(named("profile of a picture", "1 picture of 640 x 480", "GreenProfile")) { return read(green); };
  BENCHMARK(named("profile of a picture", "1 picture of 640 x 480", "PositiveGreenProfile")) { return read(positive); };
}

TEST_CASE("sense: localisers", "[sense]") {
  time_localizer("PeakLocalizer", recording().peak());
  time_localizer("BayesLocalizer", recording().bayes());
}

TEST_CASE("sense: force", "[sense]") {
  time_estimator("PeakLocalizer", recording().peak());
  time_estimator("BayesLocalizer", recording().bayes());
}

TEST_CASE("sense: decoders", "[sense]") {
  LabelledResponses training{Eigen::MatrixXd(55, 70), {},
      Eigen::VectorXd::LinSpaced(7, -24e-3, 24e-3)};  // five loads of 11 bins, ten re-contacts of seven places
  for (int i = 0; i < 70; ++i) {
    training.place.push_back(i % 7);
    for (int f = 0; f < 55; ++f)
      training.response(f, i) =
          std::exp(-0.5 * std::pow(f % 11 - 1.5 * (i % 7), 2)) + 0.05 * noise(std::uint64_t(100 * i + f));
  }
  const auto linear = LinearDecoder{}.fit(training);
  const auto bayes = BayesDecoder{.steps = 5}.fit(training);
  const Eigen::VectorXd response = training.response.col(3);
  REQUIRE(linear.decode(response).place == 3);
  REQUIRE(bayes.decode(response).place == 3);
  const std::string input = "1 response of 55 features, 7 places";
  BENCHMARK(named("a place decoded", input, "LinearDecoder")) { return linear.decode(response).place; };
  BENCHMARK(named("a place decoded", input, "BayesDecoder, 5 steps")) { return bayes.decode(response).place; };
  BENCHMARK(named("a decoder fitted", "1 set of 70 responses of 55 features", "LinearDecoder")) {
    return LinearDecoder{}.fit(training).shrinkage();
  };
  BENCHMARK(named("a decoder fitted", "1 set of 70 responses of 55 features", "BayesDecoder, 5 steps")) {
    return BayesDecoder{.steps = 5}.fit(training);
  };
}
