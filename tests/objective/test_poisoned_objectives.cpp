#include "catch.hpp"
#include "lumo/objective/contact_progression.hpp"
#include "lumo/objective/optical_separation.hpp"
#include "lumo/objective/selection.hpp"
#include "mechanics/bodies.hpp"
#include "poison.hpp"

using namespace lumo;
using test::Numbers;

namespace {

Eigen::MatrixXd matrix(const Numbers& x, std::size_t from) {
  Eigen::MatrixXd m(2, 2);
  m << x[from], x[from + 1], x[from + 2], x[from + 3];
  return m;
}

Numbers of(const std::optional<Estimate>& e) { return e ? Numbers{e->value, e->error} : Numbers{}; }

Response response(const Numbers& x, std::size_t from, double emitted) {
  Response r;
  r.replicates = matrix(x, from);
  r.ledger.emitted = emitted;
  return r;
}

std::vector<ObservedState> two_places(const Numbers& x) {
  return {{0, 0.01, 0.0, -0.02, 1.0, matrix(x, 0), TiltPlane::xz, x[9], x[10]},
      {1, 0.01, 0.0, 0.02, 1.0, matrix(x, 4), TiltPlane::xz, x[10], x[9]}};
}

struct TermsOfFourLoads {
  Body body = test::block_body(test::small_size);
  TetMesh mesh = test::small_mesh<QuadraticTet>();

  // radius, three errors, four loads; force, depth, area and a node's gap of each state
  Numbers operator()(const Numbers& x) const {
    std::vector<MechanicalState> states(4);
    for (std::size_t k = 0; k < 4; ++k) {
      MechanicalState& s = states[k];
      s.status = Status::converged;
      s.load_N = x[4 + k];
      s.force_N = x[8 + 4 * k];
      s.depth_m = x[9 + 4 * k];
      s.contact_area_m2 = x[10 + 4 * k];
      s.energy_error = 0.01 * x[9 + 4 * k];
      s.spots = {{.force_N = x[8 + 4 * k], .area_m2 = x[10 + 4 * k], .rim_m = 1e-2, .edge_m = x[11 + 4 * k]}};
      s.contact_field.assign(mesh.nodes.size(), -1e-3);
      for (std::size_t n = 0; n < mesh.nodes.size(); n += 2) s.contact_field[n] = 1e-3 * double(k);
      s.contact_field[mesh.nodes.size() / 2] = x[11 + 4 * k];
    }
    const ContactTerms q = contact_terms(body, mesh, states, x[0], {x[1], x[2], x[3]}, {x[4], x[5], x[6], x[7]});
    Numbers all;
    for (const auto& e : {q.form, q.stable, q.stiff, q.score()})
      for (const double v : of(e)) all.push_back(v);
    return all;
  }
};

}  // namespace

TEST_CASE("numbers that are none, fed to objectives, give a typed error or a finite answer") {
  const Numbers eight{1.0, 2.0, 1.5, 2.5, 3.0, 5.0, 3.5, 4.5};
  Numbers nine = eight, terms{0.005, 0.03, 0.015, 0.008, 1.0, 2.0, 5.0, 10.0};
  nine.push_back(2.0);
  Numbers pair = nine;
  pair.insert(pair.end(), {0.3, 0.02});
  for (const double load : {1.0, 2.0, 5.0, 10.0})
    for (const double v : {load, 1e-3 * std::sqrt(load), 1e-6 * load, 1e-4}) terms.push_back(v);
  const int calls = test::check_poisoned({
      {"response_distance", eight,
          [](const Numbers& x) {
            const Estimate e = response_distance(matrix(x, 0), matrix(x, 4));
            return Numbers{e.value, e.error};
          }},
      {"response_change", nine,
          [](const Numbers& x) {
            const Eigen::MatrixXd c = response_change(response(x, 0, x[8]), response(x, 4, 1.0));
            return Numbers(c.data(), c.data() + c.size());
          }},
      {"undecided_states", pair,
          [](const Numbers& x) {
            Numbers excess;
            for (const Undecided& u : undecided_states(two_places(x), x[8])) excess.push_back(u.excess);
            return excess;
          }},
      {"optical_separation", pair,
          [](const Numbers& x) {
            const auto least = optical_separation(two_places(x), {x[8]});
            return least ? of(least->distance) : Numbers{};
          }},
      {"load_rises", {1.0, 2.0, 3.0, 5.0},
          [](const Numbers& x) {
            return load_rises(
                {x[0], x[1]}, {Eigen::RowVectorXd::Constant(1, x[2]), Eigen::RowVectorXd::Constant(1, x[3])});
          }},
      {"balanced_choice", {0.4, 3.0, 0.5, 2.0},
          [](const Numbers& x) {
            const auto best = balanced_choice({{x[0], x[1]}, {x[2], x[3]}});
            return best ? Numbers{double(*best)} : Numbers{};
          }},
      {"contact_terms", terms, TermsOfFourLoads{}},
      {"score", {0.5, 0.01, 0.4, 0.02, 0.6, 0.01},
          [](const Numbers& x) {
            return of(ContactTerms{Estimate{x[0], x[1]}, Estimate{x[2], x[3]}, Estimate{x[4], x[5]}}.score());
          }},
      {"progressive_constraint_gain", {1e-3, 2e-3},
          [](const Numbers& x) { return Numbers{progressive_constraint_gain(x[0], x[1])}; }},
  });
  CHECK(calls > 250);
}

TEST_CASE("NaN is refused by name, and sound terms stay") {
  Eigen::MatrixXd a(2, 1), b(2, 1);
  a << 1.0, 1.2;
  b << std::nan(""), 0.5;
  CHECK_THROWS_AS(response_distance(a, b), InvalidArgument);
  CHECK_THROWS_AS(response_distance(a, Eigen::MatrixXd(2, 3)), InvalidArgument);
  CHECK_THROWS_AS(balanced_choice({{0.1, std::nan("")}}), InvalidArgument);
  CHECK_THROWS_AS(contact_terms({}, {}, {}, std::nan("")), InvalidArgument);
  Numbers terms{0.005, 0.03, 0.015, 0.008, 1.0, 2.0, 5.0, 10.0};
  for (const double load : {1.0, 2.0, 5.0, 10.0})
    for (const double v : {load, 1e-3 * std::sqrt(load), 1e-6 * load, 1e-4}) terms.push_back(v);
  CHECK(TermsOfFourLoads{}(terms).size() == 8);
}
