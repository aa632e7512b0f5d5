#include "catch.hpp"

#include "german_locale.hpp"
#include "lumo/core/error.hpp"

#include <limits>
#include <string>

namespace {

constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN(),
                 infinity = std::numeric_limits<double>::infinity();

template <class Call> std::string message(Call&& call) {
  try {
    call();
  } catch (const lumo::Error& e) {
    return e.what();
  }
  return "";
}

}  // namespace

TEST_CASE("a range is closed and refuses what is not finite") {
  CHECK_NOTHROW(lumo::require_in_range("angle", -80.0, -80.0, 80.0, "deg"));
  CHECK_NOTHROW(lumo::require_in_range("angle", 80.0, -80.0, 80.0, "deg"));
  for (const double bad : {80.5, -81.0, not_a_number, infinity, -infinity})
    CHECK_THROWS_AS(lumo::require_in_range("angle", bad, -80.0, 80.0, "deg"), lumo::InvalidArgument);
}

TEST_CASE("positive means finite and above zero") {
  CHECK_NOTHROW(lumo::require_positive("edge", 1e-300, "m"));
  for (const double bad : {0.0, -1.0, not_a_number, infinity})
    CHECK_THROWS_AS(lumo::require_positive("edge", bad, "m"), lumo::InvalidArgument);
}

TEST_CASE("a message is one line with what, value, limit and unit") {
  const std::string text = message([] { lumo::require_in_range("angle", 95.5, -80.0, 80.0, "deg"); });
  for (const char* part : {"angle", "95.5", "-80", "80", "deg"}) CHECK(text.find(part) != std::string::npos);
  CHECK(text.find('\n') == std::string::npos);
}

TEST_CASE("an infeasible design reports by how much") {
  const lumo::InfeasibleDesign e("thickness", 4.5, 5.0, "mm", "too thin");
  CHECK(e.excess() == 0.5);
  CHECK(e.constraint() == "thickness");
  CHECK(e.unit() == "mm");
  CHECK(std::string(e.what()) == "too thin");
  CHECK(std::isnan(lumo::InfeasibleDesign("thickness", not_a_number, 5.0, "mm", "").excess()));
}

TEST_CASE("every error of lumo is caught as one") {
  CHECK_THROWS_AS(throw lumo::InvalidArgument("x"), lumo::Error);
  CHECK_THROWS_AS(throw lumo::InputError("x"), lumo::Error);
  CHECK_THROWS_AS(throw lumo::MeshError(lumo::MeshError::Reason::open, "x"), lumo::Error);
  CHECK_THROWS_AS(throw lumo::InfeasibleDesign("c", 1, 0, "mm", "x"), lumo::Error);
}

TEST_CASE("a message is the same under every locale") {
  const GermanLocale german;
  CHECK(lumo::message("of ", 3213, " points, ", 0.5, " s") == "of 3213 points, 0.5 s");
}
