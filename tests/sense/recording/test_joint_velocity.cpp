#include "catch.hpp"

#include "lumo/sense/recording/joint_velocity.hpp"
#include "sense/synthetic.hpp"

using namespace lumo;
using namespace lumo::sense;

namespace {

/// A joint that swings, its velocities times `scale`, with noise, beside one that rests.
std::vector<JointSample> swinging(double scale, std::uint64_t seed = 1) {
  synthetic::Normal normal(seed);
  std::vector<JointSample> list;
  for (int i = 0; i < 2000; ++i) {
    const double t = 0.004 * i;
    JointSample s{i * 4 * synthetic::ms, JointVector(2), JointVector(2), JointVector::Zero(2)};
    s.position_rad << 0.4 * std::sin(1.3 * t) + 1e-5 * normal(), 0.2 + 1e-5 * normal();
    s.velocity_rad_per_s << scale * (0.52 * std::cos(1.3 * t) + 0.02 * normal()), 0.02 * normal();
    list.push_back(std::move(s));
  }
  return list;
}

}  // namespace

TEST_CASE("velocities in rad/s stay as they are, over fifty seeds", "[log]") {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    std::vector<JointSample> samples = swinging(1.0, seed), before = samples;
    CHECK(mend_velocities(samples).empty());
    for (std::size_t i = 0; i < samples.size(); ++i)
      REQUIRE(samples[i].velocity_rad_per_s == before[i].velocity_rad_per_s);
  }
}

TEST_CASE("velocities that positions contradict are taken from these, and said to be", "[log]") {
  for (const double scale : {0.0, 57.29578, 9.549, -1.0, 0.001}) {
    std::vector<JointSample> samples = swinging(scale);
    INFO("scale " << scale);
    CHECK(check_velocity(samples, 0).scale == Approx(scale).epsilon(0.05).margin(0.01));
    const std::vector<std::string> notes = mend_velocities(samples);
    REQUIRE(notes.size() == 1);
    CHECK_THAT(notes[0], Catch::Contains("velocities of joint 0") && Catch::Contains("taken from the positions"));
    double squares = 0.0;
    for (const JointSample& s : samples)
      squares += std::pow(s.velocity_rad_per_s[0] - 0.52 * std::cos(1.3e-9 * double(s.stamp_ns)), 2);
    CHECK(std::sqrt(squares / double(samples.size())) < 0.005);
    CHECK(mend_velocities(samples).empty());
  }
}

TEST_CASE("positions in degrees are refused by name", "[log]") {
  std::vector<JointSample> samples = swinging(1.0);
  for (JointSample& s : samples) s.position_rad *= 180.0 / pi;
  CHECK_THROWS_WITH(mend_velocities(samples), Catch::Contains("joint 0") && Catch::Contains("degrees"));
}

TEST_CASE("a joint that rests, wraps round or has few samples shows nothing of its velocities", "[log]") {
  CHECK_FALSE(check_velocity(swinging(1.0), 1).moves);
  CHECK_FALSE(check_velocity({}, 0).moves);
  CHECK_THROWS_AS(check_velocity(swinging(1.0), 2), InvalidArgument);
  std::vector<JointSample> wrapped = swinging(1.0);
  for (JointSample& s : wrapped)
    if (s.stamp_ns > 4'000 * synthetic::ms) s.position_rad[0] -= 6.283185307179586;
  CHECK(check_velocity(wrapped, 0).agrees);
  std::vector<JointSample> alone(1, swinging(1.0).front());
  take_velocity_from_positions(alone, 0);
  CHECK(alone[0].velocity_rad_per_s[0] == 0.0);
}
