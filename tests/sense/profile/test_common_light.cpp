#include "catch.hpp"

#include "lumo/sense/profile/common_light.hpp"
#include "lumo/sense/profile/finger_view.hpp"
#include "lumo/sense/profile/first_touch.hpp"
#include "sense/synthetic.hpp"

using namespace lumo;
using namespace lumo::sense;

namespace {

/// Profiles thirty times a second, each times `light(k)`; a bump of `height_DN` from picture `touched` on.
template <class Light>
std::vector<Profile> lit_profiles(int count, std::uint64_t seed, Light light, double height_DN = 0.0, int touched = 0) {
  synthetic::Normal normal(seed);
  std::vector<Profile> list;
  for (int k = 0; k < count; ++k) {
    Profile p;
    p.stamp_ns = k * 33 * synthetic::ms;
    p.value.resize(55);
    const double factor = light(k) * (1.0 + 0.017 * normal());
    for (Eigen::Index i = 0; i < 55; ++i)
      p.value[i] =
          factor * (40.0 + 10.0 * std::sin(0.4 * double(i)) +
                       (k >= touched ? height_DN * std::exp(-0.5 * std::pow((double(i) - 30) / 5.0, 2)) : 0.0)) +
          0.15 * normal();
    list.push_back(p);
  }
  return list;
}

double steady(int) { return 1.0; }
double on_mains(int k) { return 1.0 + 0.08 * std::sin(1.9 * k); }
double on_pulses(int k) { return k % 3 == 0 ? 0.8 : 1.0; }
double settling(int k) { return std::min(1.0, 0.3 + 0.05 * k); }

Flicker flicker_in(const std::vector<Profile>& list) {
  std::vector<const Profile*> all;
  for (const Profile& p : list) all.push_back(&p);
  return flicker_of(all);
}

}  // namespace

TEST_CASE("lamps on mains or pulses flicker, steady ones and an exposure that settles do not", "[profiles]") {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    CHECK(flicker_in(lit_profiles(15, seed, steady)).half_range == 0.0);
    CHECK(flicker_in(lit_profiles(30, seed, steady)).half_range == 0.0);
    CHECK(flicker_in(lit_profiles(30, seed, settling)).half_range == 0.0);
    CHECK(flicker_in(lit_profiles(30, seed, on_mains)).half_range == Approx(0.08).margin(0.03));
    CHECK(flicker_in(lit_profiles(30, seed, on_pulses)).half_range == Approx(0.1).margin(0.04));
  }
  CHECK(flicker_in(lit_profiles(30, 1, on_mains)).rate_Hz == Approx(1.9 / 6.2832 / 0.033).epsilon(0.15));
  CHECK(flicker_in({}).half_range == 0.0);
}

TEST_CASE("what changes all light alike is divided out, a contact's bump stays", "[profiles]") {
  for (const auto& light : {on_mains, on_pulses}) {
    std::vector<Profile> list = lit_profiles(200, 3, light, 20.0, 100);
    FingerView view;
    CHECK(take_out_flicker(view, list, UnloadedStretch{{0, 33 * 33 * synthetic::ms}}).half_range > 0.0);
    CHECK(view.steady.is_set());
    UnloadedReference unloaded;
    for (int k = 0; k < 30; ++k) unloaded.add(list[std::size_t(k)]);
    CHECK(unloaded.noise().maxCoeff() < 0.5);  // 4 DN with the flicker
    for (std::size_t k = 35; k < list.size(); ++k) {
      unloaded.subtract(list[k]);
      CHECK(list[k].value[30] == Approx(k >= 100 ? 20.0 : 0.0).margin(1.6));
      CHECK(std::abs(list[k].value[5]) < 1.5);
    }
  }
  std::vector<Profile> list = lit_profiles(60, 3, steady);
  const std::vector<Profile> before = list;
  FingerView view;
  CHECK(take_out_flicker(view, list, UnloadedStretch{{0, 33 * 33 * synthetic::ms}}).half_range == 0.0);
  CHECK_FALSE(view.steady.is_set());
  for (std::size_t k = 0; k < list.size(); ++k) CHECK(list[k].value == before[k].value);
}

TEST_CASE("the first touch that pictures show ends what is taken for untouched", "[profiles]") {
  const auto until_s = [](const std::vector<Profile>& list) {
    UnloadedReference unloaded;
    for (int k = 0; k < 15; ++k) unloaded.add(list[std::size_t(k)]);
    return 1e-9 * double(untouched_until_ns(list, unloaded));
  };
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    CHECK(until_s(lit_profiles(200, seed, steady)) == Approx(199 * 0.033));
    CHECK(until_s(lit_profiles(200, seed, steady, 12.0, 100)) == Approx(100 * 0.033 - 0.25).margin(0.04));
  }
  CHECK(until_s(lit_profiles(200, 1, [](int k) { return k < 100 ? 1.0 : 1.2; })) == Approx(199 * 0.033));
}
