#pragma once

#include "lumo/campaign/finger_campaign.hpp"
#include "lumo/objective/selection.hpp"
#include "lumo/pipeline/evaluate.hpp"
#include "lumo/study/paired_differences.hpp"
#include "lumo/study/rank_correlation.hpp"

#include <array>
#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace lumo {

/// One way to read what the paper leaves open. The default is lumo's.
struct FingerReading {
  Silicone silicone;
  FingerOptions finger;
  double friction = 0.0;  ///< Coulomb's coefficient between tool and pad
  TiltPlane tilt = TiltPlane::xz;

  bool operator==(const FingerReading&) const = default;
};

/// Do two readings have the same equilibria, whatever their light?
bool same_mechanics(const FingerReading& a, const FingerReading& b);

/// Another reading of one quantity.
struct Departure {
  std::string quantity, value;
  std::function<void(FingerReading&)> apply;

  std::string name() const { return quantity + ": " + value; }
};

/// All readings that the study compares with lumo's own.
std::vector<Departure> departures();

/// Contacts of the readings study: the smallest and the largest sphere at y = 0, straight and under 30°, and straight
/// at y = 5.5 mm, because J_obs compares places; only the straight ones enter it.
inline std::vector<Scenario<Sphere>> readings_contacts() {
  std::vector<Scenario<Sphere>> contacts;
  for (const double d : {10e-3, 30e-3})
    for (const auto& [angle, y] : {std::pair(0.0, 0.0), {pi / 6.0, 0.0}, {0.0, 5.5e-3}})
      contacts.push_back({Sphere{d}, angle, y});
  return contacts;
}

/// A design under one reading.
struct ReadingResult {
  std::string why;  ///< empty: it has both objectives
  Evaluation evaluation;
};

/// A design under the usual reading, then under each departure from it; what fails in one leaves the others whole.
/// Equilibria that a departure does not move are found once. Where the usual reading fails, nothing is compared with
/// it: its result is the only one. `pipeline_for(reading)` gives the tools with the reading's silicone and friction.
/// Throws InfeasibleDesign for the usual reading, and MeshError where a mesh failed for the machine's limits: another
/// try may have them all.
template <class PipelineFor, Executor E>
std::vector<ReadingResult> evaluate_readings(const FingerDesign& design, const FingerReading& usual,
                                             const std::vector<Departure>& departures,
                                             const std::vector<Scenario<Sphere>>& contacts,
                                             const PipelineFor& pipeline_for, const E& executor,
                                             const ProgressReport& progress = {});

/// What a design scores under one reading, and which contacts decide it (named as the caller likes).
struct ReadingScore {
  std::optional<Estimate> J_contact, J_obs;
  std::string worst_contact, worst_observation;

  bool whole() const { return J_contact && J_obs; }
};

/// How a departure moves the results of many designs.
struct ReadingEffect {
  std::size_t compared = 0,
              lost = 0;  ///< designs with both objectives under both readings; those that only the usual one scores
  std::optional<PairedSummary> J_contact;      ///< of the differences
  std::optional<PairedSummary> J_obs;          ///< of the differences as fractions of the usual J_obs
  std::optional<double> tau_contact, tau_obs;  ///< Kendall's, of the rankings under both readings
  std::size_t worst_contact_moved = 0, worst_observation_moved = 0;  ///< designs of which another contact decides
  std::optional<std::size_t> usual_choice, choice;  ///< i* among the designs compared, as indices into all
};

/// Both lists are in the order of the designs.
ReadingEffect effect_of(const std::vector<ReadingScore>& usual, const std::vector<ReadingScore>& departed);

namespace detail {

inline std::vector<Scenario<Sphere>> tilted(std::vector<Scenario<Sphere>> contacts, TiltPlane tilt) {
  for (Scenario<Sphere>& s : contacts)
    if (s.angle_rad != 0.0) s.tilt = tilt;
  return contacts;
}

}  // namespace detail

inline bool same_mechanics(const FingerReading& a, const FingerReading& b) {
  const auto &f = a.finger, &g = b.finger;
  return a.silicone.mu_Pa == b.silicone.mu_Pa && a.silicone.lambda_Pa == b.silicone.lambda_Pa &&
         a.silicone.density_kg_per_m3 == b.silicone.density_kg_per_m3 && a.friction == b.friction && a.tilt == b.tilt &&
         f.twin == g.twin && f.pad == g.pad && f.mesh == g.mesh && f.bonded_ends == g.bonded_ends;
}

inline std::vector<Departure> departures() {
  using Reading = FingerReading;
  const auto scattering = [](double albedo) {
    return [albedo](Reading& r) { r.silicone.scattering_albedo = albedo, r.silicone.anisotropy = 0.9; };
  };
  const auto friction = [](double mu) { return [mu](Reading& r) { r.friction = mu; }; };
  const auto carrier = [](double albedo) { return [albedo](Reading& r) { r.finger.carrier_albedo = albedo; }; };
  const auto stiffer = [](double factor) { return [factor](Reading& r) { r.silicone.mu_Pa *= factor; }; };
  const auto wetted = [](SurfaceOptics tool) { return [tool](Reading& r) { r.finger.touched = tool; }; };
  return {
      {"pad width", "20 mm, t_min only above",
       [](Reading& r) { r.finger.pad.width = 20.0, r.finger.pad.t_min_beside = false; }},
      {"end faces", "held, clear", [](Reading& r) { r.finger.bonded_ends = true; }},
      {"tilt plane", "y–z", [](Reading& r) { r.tilt = TiltPlane::yz; }},
      {"friction", "0.3", friction(0.3)},
      {"friction", "0.5", friction(0.5)},
      {"friction", "1", friction(1.0)},
      {"shear modulus", "−10 %", stiffer(0.9)},
      {"shear modulus", "+10 %", stiffer(1.1)},
      {"LEDs", "on the sides", [](Reading& r) { r.finger.leds.place = FingerOptions::Leds::Place::sides; }},
      {"visible normal", "|n_x| ≥ 0.9", [](Reading& r) { r.finger.readout.min_abs_nx = 0.9; }},
      {"visible side", "one", [](Reading& r) { r.finger.readout.one_side = true; }},
      {"bins", "in space", [](Reading& r) { r.finger.readout.in_space = true; }},
      {"scattering albedo", "0.5, g = 0.9", scattering(0.5)},
      {"scattering albedo", "0.9, g = 0.9", scattering(0.9)},
      {"indenter", "wetted, black", wetted(Absorber{})},
      {"indenter", "wetted, white (0.8)", wetted(Lambertian{0.8})},
      {"carrier albedo", "0.5", carrier(0.5)},
      {"carrier albedo", "0.95", carrier(0.95)},
  };
}

template <class PipelineFor, Executor E>
std::vector<ReadingResult> evaluate_readings(const FingerDesign& design, const FingerReading& usual,
                                             const std::vector<Departure>& departures,
                                             const std::vector<Scenario<Sphere>>& contacts,
                                             const PipelineFor& pipeline_for, const E& executor,
                                             const ProgressReport& progress) {
  const auto result = [](Evaluation e) {
    std::string why = failure_of(e);
    return ReadingResult{std::move(why), std::move(e)};
  };
  const Body body = finger(design, usual.silicone, usual.finger);
  const auto pipeline = pipeline_for(usual);
  const auto pressed = press(body, detail::tilted(contacts, usual.tilt), pipeline, executor, progress);
  std::vector<ReadingResult> results = {result(score(observe(body, pressed, pipeline, executor, progress), pipeline))};
  if (!results.front().why.empty()) return results;
  for (const Departure& d : departures) {
    const ProgressReport named = [&](std::string_view stage, int done, int total) {
      if (progress) progress(message(d.quantity, " ", d.value, ", ", stage), done, total);
    };
    FingerReading reading = usual;
    d.apply(reading);
    try {
      const Body other = finger(design, reading.silicone, reading.finger);
      const auto tools = pipeline_for(reading);
      const auto turned = detail::tilted(contacts, reading.tilt);
      if (turned == pressed.scenarios) reading.tilt = usual.tilt;  // none of them is tilted
      const bool shared = same_mechanics(reading, usual) && lights(other, pressed, tools);
      Observations seen =
          shared ? observe(other, pressed, tools, executor, named) : observe(other, turned, tools, executor, named);
      results.push_back(result(score(std::move(seen), tools)));
    } catch (const MeshError& e) {
      if (of_the_machine(e)) throw;
      results.push_back({message("mesh: ", e.what()), {}});
    } catch (const InfeasibleDesign& e) {
      results.push_back({e.what(), {}});
    }
  }
  return results;
}

inline ReadingEffect effect_of(const std::vector<ReadingScore>& usual, const std::vector<ReadingScore>& departed) {
  ReadingEffect effect;
  std::vector<std::size_t> both;
  for (std::size_t k = 0; k < usual.size() && k < departed.size(); ++k) {
    if (usual[k].whole() && departed[k].whole())
      both.push_back(k);
    else
      effect.lost += usual[k].whole();
  }
  effect.compared = both.size();
  std::vector<Estimate> contact, observation;
  std::array<std::vector<double>, 2> contacts, observations;
  std::array<std::vector<std::pair<double, double>>, 2> pairs;
  for (const std::size_t k : both) {
    contact.push_back(difference(*departed[k].J_contact, *usual[k].J_contact));
    if (const double J = usual[k].J_obs->value; J > 0.0) {
      const Estimate d = difference(*departed[k].J_obs, *usual[k].J_obs);
      observation.push_back({d.value / J, d.error / J});
    }
    for (const auto& [side, scores] : {std::pair(0, &usual), {1, &departed}}) {
      const ReadingScore& s = (*scores)[k];
      contacts[std::size_t(side)].push_back(s.J_contact->value),
          observations[std::size_t(side)].push_back(s.J_obs->value);
      pairs[std::size_t(side)].emplace_back(s.J_contact->value, s.J_obs->value);
    }
    effect.worst_contact_moved += usual[k].worst_contact != departed[k].worst_contact;
    effect.worst_observation_moved += usual[k].worst_observation != departed[k].worst_observation;
  }
  effect.J_contact = summarize(contact), effect.J_obs = summarize(observation);
  effect.tau_contact = kendall_tau(contacts[0], contacts[1]),
  effect.tau_obs = kendall_tau(observations[0], observations[1]);
  if (const auto i = balanced_choice(pairs[0])) effect.usual_choice = both[*i];
  if (const auto i = balanced_choice(pairs[1])) effect.choice = both[*i];
  return effect;
}

}  // namespace lumo
