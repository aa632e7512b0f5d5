#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/sense/localize/location_estimator.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <utility>
#include <vector>

namespace lumo::sense {

/// What contacts at known places and loads do to the light along one pad: computed, or recorded. In any unit;
/// `unloaded` is in the same one.
struct ResponseTemplates {
  Eigen::VectorXd position_m;          ///< of a response's values, ascending
  Eigen::VectorXd unloaded;            ///< light at rest at each; empty: not known, responses are in the readout's unit
  Eigen::VectorXd place_m;             ///< ascending
  Eigen::VectorXd load_N;              ///< ascending, > 0
  std::vector<Eigen::MatrixXd> value;  ///< by place: positions × loads
  /// By place: what a contact does on top that comes from the side, one standard deviation of its angle; empty: not
  /// known.
  std::vector<Eigen::MatrixXd> sideways;
};

/// Throws InvalidArgument for parts that do not fit together or are not finite.
inline void validate(const ResponseTemplates& t) {
  const Eigen::Index positions = t.position_m.size(), places = t.place_m.size(), loads = t.load_N.size();
  const auto require = [](bool good, const char* what) {
    if (!good) throw InvalidArgument(message("templates of responses: ", what));
  };
  require(positions >= 3, "there must be at least 3 positions");
  require_ascending_positions(t.position_m);
  require(t.unloaded.size() == 0 || (t.unloaded.size() == positions && t.unloaded.allFinite() && t.unloaded.sum() > 0),
      "light at rest must be finite, and there must be some");
  require(places >= 2 && t.place_m.allFinite() && loads >= 1 && t.load_N.allFinite(),
      "there must be at least 2 places and a load");
  for (Eigen::Index k = 1; k < places; ++k) require(t.place_m[k] > t.place_m[k - 1], "places must ascend");
  for (Eigen::Index k = 0; k < loads; ++k)
    require(t.load_N[k] > (k > 0 ? t.load_N[k - 1] : 0.0), "loads must be positive and ascend");
  require(Eigen::Index(t.value.size()) == places && (t.sideways.empty() || t.sideways.size() == t.value.size()),
      "each place must have its responses");
  for (const auto* list : {&t.value, &t.sideways})
    for (const Eigen::MatrixXd& m : *list)
      require(m.rows() == positions && m.cols() == loads && is_usable({0, m.reshaped(), 0.0}),
          "a response is missing or not finite");
}

/// The response to one contact between the known places, at given positions.
struct TemplateResponse {
  Eigen::VectorXd value;
  Eigen::VectorXd doubt;     ///< what two ways to go from place to place differ by
  Eigen::VectorXd sideways;  ///< as in the templates; 0 where not known
};

/// Templates in between. From load to load linear, from 0 at 0 N, beyond the last load with its slope. From place to
/// place the mean of two ways: each value changes linearly, or the shape moves along with the contact and changes
/// linearly. The first is right for light that stays at an LED, the second for light that stays at the contact. Places
/// beyond the first or last move with the contact.
class TemplateField {
 public:
  /// Throws InvalidArgument for templates that do not fit together.
  explicit TemplateField(ResponseTemplates templates) : t_(std::move(templates)) { validate(t_); }

  const ResponseTemplates& templates() const { return t_; }
  double first_place_m() const { return t_.place_m[0]; }
  double last_place_m() const { return t_.place_m[t_.place_m.size() - 1]; }
  double max_load_N() const { return t_.load_N[t_.load_N.size() - 1]; }

  TemplateResponse at(const Eigen::VectorXd& position_m, double y_m, double load_N) const {
    const Eigen::Index last = t_.place_m.size() - 1;
    const auto above = std::upper_bound(t_.place_m.begin(), t_.place_m.end(), y_m) - t_.place_m.begin();
    const Eigen::Index k = std::clamp<Eigen::Index>(above - 1, 0, last - 1);
    const double gap = t_.place_m[k + 1] - t_.place_m[k], share = std::clamp((y_m - t_.place_m[k]) / gap, 0.0, 1.0);
    const double beyond = y_m - (t_.place_m[k] + share * gap);
    const auto between = [&](const std::vector<Eigen::MatrixXd>& list, double moved) {
      const Eigen::VectorXd a = at_load(list[std::size_t(k)], load_N), b = at_load(list[std::size_t(k) + 1], load_N);
      Eigen::VectorXd v(position_m.size());
      for (Eigen::Index i = 0; i < v.size(); ++i) {
        const double x = position_m[i] - beyond;
        v[i] =
            (1.0 - share) * sampled(a, x - moved * share * gap) + share * sampled(b, x + moved * (1.0 - share) * gap);
      }
      return v;
    };
    const Eigen::VectorXd stays = between(t_.value, 0.0), moves = between(t_.value, 1.0);
    return {0.5 * (stays + moves), moves - stays,
        t_.sideways.empty() ? Eigen::VectorXd(Eigen::VectorXd::Zero(position_m.size())) : between(t_.sideways, 0.0)};
  }
  /// Light at rest at given positions; none where it is not known.
  Eigen::VectorXd unloaded_at(const Eigen::VectorXd& position_m) const {
    if (t_.unloaded.size() == 0) return {};
    Eigen::VectorXd v(position_m.size());
    for (Eigen::Index i = 0; i < v.size(); ++i) v[i] = sampled(t_.unloaded, position_m[i]);
    return v;
  }

 private:
  Eigen::VectorXd at_load(const Eigen::MatrixXd& by_load, double load_N) const {
    const Eigen::Index last = t_.load_N.size() - 1;
    const auto above = std::upper_bound(t_.load_N.begin(), t_.load_N.end(), load_N) - t_.load_N.begin();
    const Eigen::Index k = std::min<Eigen::Index>(above, last);
    if (k == 0) return load_N / t_.load_N[0] * by_load.col(0);
    const double share = (load_N - t_.load_N[k - 1]) / (t_.load_N[k] - t_.load_N[k - 1]);
    return (1.0 - share) * by_load.col(k - 1) + share * by_load.col(k);
  }
  /// Linear between the positions, the end values beyond them.
  double sampled(const Eigen::VectorXd& v, double x) const {
    const Eigen::VectorXd& p = t_.position_m;
    if (!(x > p[0])) return v[0];
    if (!(x < p[p.size() - 1])) return v[v.size() - 1];
    const Eigen::Index k = std::upper_bound(p.begin(), p.end(), x) - p.begin() - 1;
    return v[k] + (x - p[k]) / (p[k + 1] - p[k]) * (v[k + 1] - v[k]);
  }

  ResponseTemplates t_;
};

/// A response at a known place and load, as a hold of a log has it.
struct PressedResponse {
  double y_m = 0.0, load_N = 0.0;
  Eigen::VectorXd response;
};

/// Templates from recorded contacts, in their unit: the mean at each place and load. Loads that not all places have are
/// left out. Throws InvalidArgument for fewer than two places, or no load that all of them have.
inline ResponseTemplates recorded_templates(
    const Eigen::VectorXd& position_m, const std::vector<PressedResponse>& pressed) {
  std::map<double, std::map<double, std::pair<Eigen::VectorXd, int>>> sums;  // by place and load
  std::map<double, std::size_t> places_with;                                 // by load
  for (const PressedResponse& p : pressed) {
    if (p.response.size() != position_m.size())
      throw InvalidArgument(
          message("recorded response has ", p.response.size(), " values, must have ", position_m.size()));
    const bool seen = sums[p.y_m].contains(p.load_N);
    auto& [sum, count] = sums[p.y_m][p.load_N];
    sum = seen ? Eigen::VectorXd(sum + p.response) : p.response;
    ++count;
    places_with[p.load_N] += !seen;
  }
  ResponseTemplates t;
  t.position_m = position_m;
  std::vector<double> loads;
  for (const auto& [load, places] : places_with)
    if (load > 0.0 && places == sums.size()) loads.push_back(load);
  if (sums.size() < 2 || loads.empty())
    throw InvalidArgument(message("recorded responses are of ", sums.size(), " places with ", loads.size(),
        " loads that all of them have, must be at least 2 places and a load"));
  t.load_N = Eigen::Map<const Eigen::VectorXd>(loads.data(), Eigen::Index(loads.size()));
  t.place_m.resize(Eigen::Index(sums.size()));
  for (const auto& [place, by_load] : sums) {
    t.place_m[Eigen::Index(t.value.size())] = place;
    Eigen::MatrixXd value(position_m.size(), t.load_N.size());
    for (Eigen::Index l = 0; l < t.load_N.size(); ++l) {
      const auto& [sum, count] = by_load.at(t.load_N[l]);
      value.col(l) = sum / double(count);
    }
    t.value.push_back(std::move(value));
  }
  validate(t);
  return t;
}

/// Templates in the readout's unit [DN], by what the picture of the unloaded finger has for the templates' light at
/// rest. Room light and the camera's black level are on top of it, so that the size is known to a quarter at best.
/// Positions within 2.5 mm of a lamp, whose package shows through, are left out. Templates without light at rest stay
/// as they are. Throws InvalidArgument where none of the light is seen.
inline ResponseTemplates scaled_to(ResponseTemplates t, const Eigen::VectorXd& position_m,
    const Eigen::VectorXd& unloaded_DN, const std::vector<double>& lamp_m) {
  constexpr double near_m = 2.5e-3, room_DN = 5.0, room_sigma_DN = 5.0, fit_sigma_DN = 5.0;  // assumed
  if (t.unloaded.size() == 0) return t;
  const Eigen::VectorXd light = TemplateField(t).unloaded_at(position_m);
  if (unloaded_DN.size() != position_m.size())
    throw InvalidArgument(
        message("unloaded profile has ", unloaded_DN.size(), " values, must have ", position_m.size()));
  // Least squares of scale · light + room, with the room's prior.
  const double by_room = 1.0 / (room_sigma_DN * room_sigma_DN), by_value = 1.0 / (fit_sigma_DN * fit_sigma_DN);
  Eigen::Matrix2d normal{{0.0, 0.0}, {0.0, by_room}};
  Eigen::Vector2d right(0.0, by_room * room_DN);
  for (Eigen::Index i = 0; i < light.size(); ++i) {
    if (std::any_of(lamp_m.begin(), lamp_m.end(), [&](double y) { return std::abs(position_m[i] - y) < near_m; }))
      continue;
    const Eigen::Vector2d row(light[i], 1.0);
    normal += by_value * row * row.transpose();
    right += by_value * unloaded_DN[i] * row;
  }
  const double scale = (normal(1, 1) * right[0] - normal(0, 1) * right[1]) / normal.determinant();
  if (!(scale > 0.0) || !std::isfinite(scale))
    throw InvalidArgument("unloaded profile shows none of the light that the pad's templates have at rest");
  t.unloaded *= scale;
  for (auto* list : {&t.value, &t.sideways})
    for (Eigen::MatrixXd& m : *list) m *= scale;
  return t;
}

}  // namespace lumo::sense
