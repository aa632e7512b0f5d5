#include "catch.hpp"

#include "lumo/sense/estimate.hpp"
#include "sense/synthetic.hpp"

using namespace lumo;
using namespace lumo::sense;

namespace {

using synthetic::ms;
constexpr int rest_places = 55;

/// A profile at rest: light that differs along the finger, lamps that waver by 1 %, noise.
Profile at_rest(int k, std::uint64_t seed) {
  synthetic::Normal normal(seed * 1000 + std::uint64_t(k));
  Profile p;
  p.stamp_ns = k * 33 * ms;
  p.value.resize(rest_places);
  const double lamps = 1.0 + 0.01 * normal();
  for (int i = 0; i < rest_places; ++i) p.value[i] = lamps * (25.0 + 8.0 * std::sin(0.3 * i)) + 0.1 * normal();
  return p;
}

std::vector<Profile> rest(int n, std::uint64_t seed) {
  std::vector<Profile> list;
  for (int k = 0; k < n; ++k) list.push_back(at_rest(k, seed));
  return list;
}

std::vector<const Profile*> all_of(const std::vector<Profile>& list) {
  std::vector<const Profile*> all;
  for (const Profile& p : list) all.push_back(&p);
  return all;
}

const Eigen::VectorXd rest_places_m = LongitudinalBins::uniform(-27.5e-3, 27.5e-3, rest_places).centres_m();

Eigen::VectorXd bump_at(double y_m, double height) {
  return height * (-0.5 * ((rest_places_m.array() - y_m) / 4e-3).square()).exp();
}

/// A picture of a finger whose LEDs shine in one channel; the others see `leak` of it.
Image coloured_leds(int lit, double leak, double angle_rad = 0.0) {
  synthetic::View view{320, 240, {160.0, 120.0}, angle_rad, 4700.0, 0.0};
  const Image grey = synthetic::paint(
      view, [](double y, double across) { return synthetic::leds(y, across, 90.0); }, 1.0, 5, PixelFormat::grey);
  Image image = Image::black(grey.width, grey.height, PixelFormat::bgr);
  for (std::size_t i = 0; i < grey.pixels.size(); ++i)
    for (int c = 0; c < 3; ++c)
      image.pixels[3 * i + std::size_t(c)] =
          std::uint8_t(c == lit ? grey.pixels[i] : std::lround(leak * grey.pixels[i]));
  return image;
}

}  // namespace

TEST_CASE("of a finger at rest every picture counts, over fifty seeds", "[profiles]") {
  for (std::uint64_t seed = 1; seed <= 50; ++seed)
    for (const int n : {15, 30}) {
      const std::vector<Profile> list = rest(n, seed);
      const CheckedReference checked = checked_reference(all_of(list), {0.25});
      UnloadedReference plain;
      for (const Profile& p : list) plain.add(p);
      INFO("seed " << seed << ", " << n << " pictures");
      CHECK(checked.left_out == 0);
      CHECK(checked.repeated == 0);
      CHECK_FALSE(checked.repeats);
      CHECK_FALSE(checked.scatters);
      CHECK(checked.reference.mean() == plain.mean());
      CHECK(checked.reference.noise() == plain.noise());
    }
}

TEST_CASE("pictures of an exposure that settles are left out, though they are half of the stretch", "[profiles]") {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    std::vector<Profile> list = rest(30, seed);
    UnloadedReference settled;
    for (int k = 15; k < 30; ++k) settled.add(list[std::size_t(k)]);
    for (int k = 0; k < 15; ++k) list[std::size_t(k)].value *= 0.25 + 0.75 * k / 15.0;
    const CheckedReference checked = checked_reference(all_of(list));
    INFO("seed " << seed << ": " << checked.left_out << " left out");
    CHECK(checked.left_out >= 12);
    CHECK(checked.left_out <= 15);
    CHECK(checked.reference.mean().mean() == Approx(settled.mean().mean()).epsilon(0.01));
    CHECK(checked.reference.noise().mean() < 3.0 * settled.noise().mean());
  }
}

TEST_CASE("pictures in which the finger is touched are left out of the reference", "[profiles]") {
  std::vector<Profile> list = rest(30, 3);
  for (int k = 24; k < 30; ++k) list[std::size_t(k)].value += bump_at(8e-3, 6.0);
  const CheckedReference checked = checked_reference(all_of(list));
  CHECK(checked.left_out == 6);
  CHECK(checked.reference.count() == 24);
}

TEST_CASE("a picture that comes again counts once", "[profiles]") {
  std::vector<Profile> list;
  for (int k = 0; k < 20; ++k) {
    list.push_back(at_rest(k / 2, 4));
    list.back().stamp_ns = k * 33 * ms;
  }
  const CheckedReference checked = checked_reference(all_of(list));
  CHECK(checked.repeated == 10);
  CHECK(checked.reference.count() == 10);
  CHECK_FALSE(checked.repeats);
  list.resize(4);
  for (int k = 0; k < 26; ++k) list.push_back(list[1]);  // a codec's skipped pictures
  CHECK(checked_reference(all_of(list)).repeats);
}

TEST_CASE("pictures that repeat their pixels have a noise that their scatter does not undercut", "[profiles]") {
  synthetic::View view{160, 120, {80.0, 60.0}, 0.0, 2400.0, 0.0};
  const auto picture = [&](std::uint64_t seed) {
    return synthetic::paint(
        view, [](double y, double across) { return synthetic::leds(y, across); }, 1.5, seed, PixelFormat::grey);
  };
  RepeatedPixels camera, codec;
  const Image key = picture(1);
  for (std::uint64_t k = 0; k < 10; ++k) {
    const Image fresh = picture(2 + k);
    camera.add(fresh.view());
    Image coded = key;  // but for a few rows
    for (int y = 55; y < 60; ++y) std::copy_n(fresh.view().row(y), 160, coded.row(y));
    codec.add(coded.view());
  }
  CHECK(camera.share() < 0.3);
  CHECK(codec.share() > 0.8);
  RepeatedPixels handed_on, skipped;  // each picture twice, and one that a codec repeats where little changes
  for (std::uint64_t k = 0; k < 20; ++k) {
    handed_on.add(picture(2 + k / 2).view());
    skipped.add(picture(2 + (k < 15 ? k : 15)).view());
  }
  CHECK(handed_on.share() < 0.3);
  CHECK(skipped.share() == 1.0);

  std::vector<Profile> frozen = rest(30, 6);
  for (Profile& p : frozen) p.value = at_rest(0, 6).value + 0.02 * (p.value - at_rest(0, 6).value);
  const CheckedReference checked = checked_reference(all_of(frozen), {codec.share()});
  CHECK(checked.repeats);
  CHECK(checked.reference.noise().minCoeff() >= 1.5);
  std::vector<Profile> restless = frozen;
  for (Profile& p : restless) p.value = at_rest(0, 6).value + 200.0 * (p.value - at_rest(0, 6).value);
  const double one = checked_reference(all_of(restless), {codec.share()}).least_noise;
  CHECK(one > 1.5);  // beyond a step, a block's error is that of all of its bins
  CHECK(checked_reference(all_of(restless), {codec.share(), 4.0}).least_noise == Approx(1.5 + 2.0 * (one - 1.5)));
  // What the next key picture brings is no contact.
  FingerOptics optics;
  optics.unloaded = checked.reference;
  BayesLocalizer::Config c;
  c.position_m = rest_places_m;
  c.noise = checked.reference.noise();
  c.unloaded = checked.reference.mean();
  BayesLocalizer guarded(c);
  c.noise = checked_reference(all_of(frozen), {camera.share()}).reference.noise();
  BayesLocalizer believing(c);
  int seen_now = 0, seen_before = 0;
  for (int k = 0; k < 20; ++k) {
    Profile p = at_rest(0, 6);
    p.stamp_ns = k * 33 * ms;
    p.value += bump_at(-7e-3, 1.0) - bump_at(6e-3, 1.0);
    checked.reference.subtract(p);
    seen_now += guarded.update(p).contacts > 0;
    seen_before += believing.update(p).contacts > 0;
  }
  CHECK(seen_now == 0);
  CHECK(seen_before > 0);
}

TEST_CASE("light that moves along the finger in bands is noise of many places at once", "[profiles]") {
  const auto banded = [](double amplitude, double period_m, std::uint64_t seed) {
    std::vector<Profile> list = rest(30, seed);
    for (std::size_t k = 0; k < list.size(); ++k)
      list[k].value.array() *=
          1.0 + amplitude * (2.0 * pi * (rest_places_m.array() / period_m + 0.37 * double(k))).sin();
    return list;
  };
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    const CheckedReference clean = checked_reference(all_of(rest(30, seed)));
    CHECK(clean.bands == 0.0);
    CHECK(clean.least_noise == 0.0);
  }
  for (const double amplitude : {0.03, 0.08})
    for (const double period_m : {15e-3, 30e-3, 60e-3}) {
      CAPTURE(amplitude, period_m);
      const std::vector<Profile> list = banded(amplitude, period_m, 7);
      const CheckedReference seen = checked_reference(all_of(list));
      CHECK(seen.bands == Approx(amplitude / std::sqrt(2.0)).epsilon(0.3));
      CHECK(seen.left_out == 0);
      // No picture at rest is a contact to whoever knows this noise, and a strong one still is.
      BayesLocalizer::Config known;
      known.position_m = rest_places_m;
      known.noise = seen.reference.noise();
      known.unloaded = seen.reference.mean();
      BayesLocalizer localizer(known);
      const auto touched = [&](Profile p) {
        seen.reference.subtract(p);
        const LocationEstimate e = localizer.update(p);
        return e.contacts > 0 ? e.probability : 1.0 - e.probability;
      };
      double most = 0.0;
      for (const Profile& p : list) most = std::max(most, touched(p));
      CHECK(most < 0.9);
      Profile pressed = list.front();
      pressed.stamp_ns = list.back().stamp_ns;
      pressed.value += bump_at(0.0, 20.0);
      double found = 0.0;
      for (int k = 0; k < 10; ++k) {
        pressed.stamp_ns += 33 * ms;
        found = touched(pressed);
      }
      CHECK(found > 0.9);
    }
}

TEST_CASE("light that flickers as a whole is said to", "[profiles]") {
  std::vector<Profile> list = rest(30, 7);
  for (std::size_t k = 0; k < list.size(); ++k) list[k].value *= 1.0 + 0.1 * std::sin(2.1 * double(k));
  const CheckedReference checked = checked_reference(all_of(list));
  CHECK(checked.scatters);
  CHECK(checked.together > 0.05);
}

TEST_CASE("LEDs are looked for in the channel that is lit", "[leds]") {
  const Session session;
  for (const int lit : {0, 1, 2})
    for (const double leak : {0.0, 0.15}) {
      const FingerView seen = view_finger(coloured_leds(lit, leak).view(), session, "log");
      INFO("channel " << lit << ", leak " << leak);
      CHECK(seen.lit == lit);
      CHECK(seen.leds.map.y_m(seen.leds.map.u_px(Eigen::Vector2d(160.0, 120.0))) == Approx(0.0).margin(0.1e-3));
      GreenProfile readout = seen.readout(LongitudinalBins::regions());
      const Image image = coloured_leds(lit, leak);
      Profile p;
      REQUIRE(readout.read({image.view(), 0, 0.0, 0.0, 0}, p));
      CHECK(p.value.minCoeff() > 30.0);
    }
  CHECK(view_finger(coloured_leds(1, 1.0).view(), session, "log").lit == 1);  // white
}

TEST_CASE("where no LEDs are seen, an exposure that is too short or too long is named", "[leds]") {
  synthetic::View view{320, 240, {160.0, 120.0}, 0.0, 4700.0, 0.0};
  const auto through = [&](double exposure) {
    return synthetic::paint(
        view, [&](double y, double across) { return exposure * synthetic::leds(y, across, 90.0); }, 0.0, 5,
        PixelFormat::grey);
  };
  CHECK_THROWS_WITH(view_finger(through(0.05).view(), Session{}, "log"), Catch::Contains("under-exposed"));
  CHECK_THROWS_WITH(view_finger(through(40.0).view(), Session{}, "log"), Catch::Contains("over-exposed"));
}

TEST_CASE("a row of LEDs at a right angle to the tip's direction does not say which end is the tip", "[leds]") {
  Session session;
  constexpr double right = 1.5707963267948966;
  for (const double off : {-0.07, -0.01, 0.01, 0.07}) {
    CHECK_THROWS_WITH(view_finger(coloured_leds(1, 0.5, right + off).view(), session, "log"),
        Catch::Contains("which does not say which end is the tip") && Catch::Contains("[0, 1] if the tip is below"));
    session.distal = {0.0, 1.0};
    CHECK(view_finger(coloured_leds(1, 0.5, right + off).view(), session, "log").leds.map.direction.y() > 0.9);
    session.distal = {1.0, 0.0};
  }
  CHECK_NOTHROW(view_finger(coloured_leds(1, 0.5, 0.8).view(), session, "log"));
}

TEST_CASE("the monitor keeps black pictures and dead LEDs from the localiser", "[localizer]") {
  FingerOptics optics;
  synthetic::View view{320, 240, {160.0, 120.0}, 0.0, 4700.0, 0.0};
  const Image image = synthetic::paint(
      view, [](double y, double across) { return synthetic::leds(y, across, 90.0); }, 1.0, 5);
  optics.view = view_finger(image.view(), Session{}, "log");
  std::vector<Profile> list = rest(40, 8);
  optics.unloaded = checked_reference(all_of(rest(30, 9))).reference;
  list[10].value.setConstant(0.5);
  list[20].value.segment(20, 15) *= 0.3;
  list[30].value[3] = std::numeric_limits<double>::quiet_NaN();
  const std::vector<FrameEstimate> found = locate(list, optics, bayes_localizer);
  REQUIRE(found.size() == 40);
  for (std::size_t k = 0; k < found.size(); ++k) {
    INFO(k);
    CHECK((found[k].force.state == EstimatorState::invalid) == (k == 10 || k == 20 || k == 30));
    CHECK(found[k].location.contacts == 0);
  }
  CHECK(found[10].force.faults.has(Fault::frame_black));
  CHECK(found[20].force.faults.has(Fault::led_dead));
}
