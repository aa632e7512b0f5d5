#include "catch.hpp"

#include "lumo/sense/force/latency.hpp"
#include "sense/synthetic.hpp"

#include <cmath>

using namespace lumo;
using namespace lumo::sense;

namespace {

/// Six presses: light and torque rise together, each by a law of its own, and joints are stamped `late_s` later.
struct PressedFinger {
  std::vector<Profile> profiles;
  std::vector<JointSample> samples;
  UnloadedReference unloaded;
};

double press_at(double t_s) {
  const double in = std::fmod(t_s, 4.0);
  const auto ramp = [&](double from, double to) { return std::clamp((in - from) / (to - from), 0.0, 1.0); };
  return 10.0 * (ramp(1.0, 1.15) - ramp(3.0, 3.1));
}

PressedFinger six_presses(double late_s, std::uint64_t seed, double sign = 1.0) {
  synthetic::Normal normal(seed);
  PressedFinger f;
  for (int k = 0; k < 720; ++k) {
    const double t = 0.0333 * k + 0.002 * normal.uniform(), force = press_at(t);
    Profile p;
    p.stamp_ns = std::llround(1e9 * t);
    p.value.resize(55);
    for (Eigen::Index i = 0; i < 55; ++i)
      p.value[i] = 40.0 * (1.0 + 0.005 * normal()) +
                   std::sqrt(force) * 6.0 * std::exp(-0.5 * std::pow((double(i) - 20.0) / 5.0, 2));
    f.profiles.push_back(p);
    if (k < 20) f.unloaded.add(p);
  }
  for (int k = 0; k < 6000; ++k) {
    const double t = 0.004 * k;
    f.samples.push_back({std::llround(1e9 * (t + late_s)), JointVector::Zero(1), JointVector::Zero(1),
        JointVector::Constant(1, sign * 0.06 * press_at(t) + 0.01 * normal()), Effort::torque_Nm});
  }
  return f;
}

std::optional<Latency> latency_in(const PressedFinger& f, double joint_delay_s = 0.0) {
  return joint_latency(f.profiles, f.unloaded, ContactTorques(f.samples, {TorqueModel{}}, {}, joint_delay_s));
}

}  // namespace

TEST_CASE("the latency between pictures and torques is found from contacts, with its error", "[latency]") {
  for (const double late : {0.0, 0.15, -0.15})
    for (const double sign : {1.0, -1.0}) {
      const auto l = latency_in(six_presses(late, 3, sign));
      REQUIRE(l);
      CHECK(l->seconds == Approx(late).margin(0.012));
      CHECK(std::abs(l->seconds - late) < 4.0 * l->sigma_s);
      CHECK(l->sigma_s < 0.035);
      CHECK(l->events >= 6);
      CHECK(l->is_significant == (late != 0.0));
    }
  CHECK(latency_in(six_presses(0.06, 3), 0.06)->seconds == Approx(0.0).margin(0.012));
}

TEST_CASE("streams that are stamped alike have no latency, over fifty seeds", "[latency]") {
  int significant = 0;
  for (std::uint64_t seed = 1; seed <= 50; ++seed) significant += latency_in(six_presses(0.0, seed))->is_significant;
  CHECK(significant == 0);
}

TEST_CASE("a log without contacts says nothing of latency", "[latency]") {
  PressedFinger f = six_presses(0.0, 1);
  f.profiles.resize(20);
  CHECK_FALSE(latency_in(f));
  f.profiles.clear();
  CHECK_FALSE(latency_in(f));
}
