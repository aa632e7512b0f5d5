#include "catch.hpp"
#include "lumo/campaign/ensemble.hpp"

#include <set>

using namespace lumo;

TEST_CASE("the paper's ensembles have 28 and 140 scenarios: without mirror images 16 and 48 solves on 4 and 12 meshes") {
  const auto count = [](const Ensemble& e, Symmetry s) {
    const auto scenarios = e.scenarios();
    const ContactPlan p = plan_contacts(scenarios, s);
    CHECK(p.images.size() == scenarios.size());
    for (std::size_t k = 0; k < p.images.size(); ++k) {
      const auto &given = scenarios[k], &solved = p.solves[p.images[k].solve].scenario;
      CHECK(solved.indenter == given.indenter);
      CHECK((p.images[k].mirror_x ? -1.0 : 1.0) * solved.angle_rad == given.angle_rad);
      CHECK((p.images[k].mirror_y ? -1.0 : 1.0) * solved.y_m == given.y_m);
    }
    return std::pair(p.solves.size(), p.places.size());
  };
  CHECK(flat_ensemble().scenarios().size() == 28);
  CHECK(curved_ensemble().scenarios().size() == 140);
  CHECK(count(flat_ensemble(), {true, true}) == std::pair<std::size_t, std::size_t>(16, 4));
  CHECK(count(curved_ensemble(), {true, true}) == std::pair<std::size_t, std::size_t>(48, 12));
  CHECK(count(flat_ensemble(), {false, false}) == std::pair<std::size_t, std::size_t>(28, 7));
  CHECK(plan_contacts(flat_ensemble().scenarios(), {true, true}, {}).solves.size() == 28);
}
