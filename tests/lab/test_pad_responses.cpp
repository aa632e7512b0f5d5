#include "catch.hpp"

#include "lab/test_pad.hpp"
#include "lumo/lab/pad_file.hpp"
#include "temporary_folder.hpp"

using namespace lumo;

TEST_CASE("responses in between: exact at what was computed, mirrored below 0, nothing at 0 N", "[lab]") {
  const PadResponses r = test_pad();
  const PadLight light(r);
  CHECK(light.change(7e-3, 10.0) == r.change[7].col(1));
  CHECK((light.change(-7e-3, 10.0) - r.change[7].col(1).reverse()).norm() == 0.0);
  CHECK(light.change(7e-3, 0.0).norm() == 0.0);
  CHECK(light.change(7e-3, -1.0).norm() == 0.0);
  CHECK(light.depth_m(3.3e-3, 20.0) == Approx(4e-3));
  // Linear data stay linear between loads and between places.
  for (const double load : {0.7, 3.0, 6.0, 14.0})
    CHECK((light.change(4e-3, load) - r.change[4].col(0) * (load / 5.0)).norm() < 1e-12);
  CHECK((light.change(4.25e-3, 5.0) - (0.75 * r.change[4].col(0) + 0.25 * r.change[5].col(0))).norm() < 1e-15);
  for (const double load : {0.3, 5.0, 12.0, 19.9})
    CHECK(light.load_N(-8.5e-3, light.depth_m(-8.5e-3, load)) == Approx(load).epsilon(1e-9));
  CHECK(light.load_N(0.0, 5e-3) == Approx(25.0));  // goes on straight
  CHECK(light.load_N(0.0, -1e-3) == 0.0);
  // Beyond what was computed the last state counts.
  CHECK(light.change(40e-3, 30.0) == r.change[26].col(2));
}

TEST_CASE("responses of a pad with unequal ends: each side of 0 has its own", "[lab]") {
  const PadResponses half = test_pad();
  PadResponses whole = half;
  const Eigen::Index n = half.place_m.size();
  whole.place_m = Eigen::VectorXd::LinSpaced(2 * n - 1, -half.place_m[n - 1], half.place_m[n - 1]);
  whole.place_m[n - 1] = 0.0;
  whole.depth_m = half.depth_m.col(0).replicate(1, 2 * n - 1);
  whole.change.clear();
  for (Eigen::Index k = n - 1; k > 0; --k) whole.change.push_back(half.change[std::size_t(k)].colwise().reverse());
  for (const Eigen::MatrixXd& m : half.change) whole.change.push_back(m);
  whole.tilt_place_m = Eigen::Vector3d(-1e-3, 0.0, 1e-3);
  whole.tilt = {half.tilt[0], half.tilt[0], half.tilt[0]};
  const PadLight mirrored(half), same(whole);
  for (const double y : {-26e-3, -7.3e-3, 0.0, 4.25e-3, 30e-3})
    CHECK((same.change(y, 7.0) - mirrored.change(y, 7.0)).norm() < 1e-15);
  whole.change[std::size_t(n - 1 - 7)] *= 2.0;  // at −7 mm alone
  whole.tilt[0] *= 3.0;
  const PadLight other(whole);
  CHECK((other.change(-7e-3, 10.0) - 2.0 * mirrored.change(-7e-3, 10.0)).norm() < 1e-15);
  CHECK((other.change(7e-3, 10.0) - mirrored.change(7e-3, 10.0)).norm() < 1e-15);
  CHECK((other.change(-7e-3, 10.0, 0.01) - other.change(-7e-3, 10.0)).sum() ==
        Approx(3.0 * (other.change(7e-3, 10.0, 0.01) - other.change(7e-3, 10.0)).sum()).epsilon(1e-9));
  CHECK(other.load_N(-7e-3, other.depth_m(-7e-3, 12.0)) == Approx(12.0));
  CHECK(mirrored.reach_m() == std::pair(-26e-3, 26e-3));
  const std::vector<double> places = mirrored.places_m();
  CHECK((places.size() == 53 && std::is_sorted(places.begin(), places.end()) && places.front() == -26e-3));
  whole.place_m[0] = -25.5e-3;
  CHECK(PadLight(whole).reach_m() == std::pair(-25.5e-3, 26e-3));
}

TEST_CASE("a camera's exposure: the unloaded side's level, unless a contact would be too bright", "[lab]") {
  const PadLight light(test_pad());  // 5e-4 a bin; 4e-4 more under 20 N
  CHECK(light.scale_to(70.0, 220.0) == Approx(70.0 / 5e-4));
  CHECK(light.scale_to(70.0, 90.0) == Approx(90.0 / 9e-4).epsilon(0.02));  // places lie between bins
}

TEST_CASE("between loads the response never overshoots", "[lab]") {
  PadResponses r = test_pad();
  for (auto& m : r.change) {
    m.col(1) = 0.2 * m.col(0);
    m.col(2) = 1.1 * m.col(0);
  }  // down, then up again
  const PadLight light(r);
  double last = 0.0;
  for (double load = 0.0; load <= 5.0; load += 0.1) {
    const double v = light.change(0.0, load)[30];
    CHECK(v >= last - 1e-18);
    last = v;
  }
  for (double load = 5.0; load <= 10.0; load += 0.1) {
    const double v = light.change(0.0, load)[30];
    CHECK(v <= last + 1e-18);
    CHECK(v >= 0.2 * r.change[0](30, 0) - 1e-18);
    last = v;
  }
}

TEST_CASE("a tilt moves with the contact and changes its sign with the angle", "[lab]") {
  const PadLight light(test_pad());
  const Eigen::VectorXd straight = light.change(9e-3, 10.0), plus = light.change(9e-3, 10.0, 0.01),
                        minus = light.change(9e-3, 10.0, -0.01);
  CHECK((plus + minus - 2.0 * straight).norm() < 1e-18);
  Eigen::Index top = 0;
  (plus - straight).maxCoeff(&top);
  CHECK(std::abs(light.responses().position_m[top] - 9e-3) < 0.6e-3);
}

TEST_CASE("responses as a file: read back to the bit, and every damage is reported in one line", "[lab]") {
  const PadResponses r = test_pad();
  const TemporaryFolder folder;
  const std::string text = to_text(r, "a key"), path = folder / "pad";
  CHECK(to_text(pad_responses_from_text(text, "a key", "x"), "a key") == text);
  const auto refused = [&](const std::string& t, const std::string& key, const char* why) {
    try {
      pad_responses_from_text(t, key, "x");
      FAIL("was taken");
    } catch (const InputError& e) {
      const std::string what = e.what();
      CHECK(what.starts_with("x: "));
      CHECK(what.find('\n') == std::string::npos);
      CHECK(what.find(why) != std::string::npos);
    }
  };
  refused(text, "another key", "other settings");
  refused("", "a key", "holds no responses");
  refused(text.substr(0, text.size() / 2), "a key", "damaged");
  std::string flipped = text;
  flipped[text.size() / 3] ^= 1;
  refused(flipped, "a key", "damaged");
  // Whole, but not a column where one belongs.
  std::string wide = text.substr(0, text.rfind("checksum "));
  wide.replace(
      wide.find("theta_mm 5 1\n"), wide.find("diameter_m") - wide.find("theta_mm 5 1\n"), "theta_mm 1 5\n6 6 8 5 0\n");
  refused(wide + message("checksum ", checksum(wide), '\n'), "a key", "more than one column");
  CHECK_FALSE(read_pad_responses(path, "a key"));
  write_pad_responses(path, r, "a key");
  CHECK(to_text(*read_pad_responses(path, "a key"), "a key") == text);
  CHECK(folder.entries() == 1);
  CHECK_THROWS_AS(write_pad_responses("/no/such/folder/file", r, "a key"), InputError);
}

TEST_CASE("responses that do not fit together are refused", "[lab]") {
  PadResponses r = test_pad();
  r.change[3](5, 1) = std::numeric_limits<double>::quiet_NaN();
  CHECK_THROWS_AS(PadLight(r), InputError);
  r = test_pad();
  r.place_m[0] = 1e-3;
  CHECK_THROWS_AS(PadLight(r), InputError);
  r = test_pad();
  r.load_N[1] = 4.0;
  CHECK_THROWS_AS(PadLight(r), InputError);
}
