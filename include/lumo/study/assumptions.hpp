#pragma once

#include "lumo/campaign/finger_campaign.hpp"
#include "lumo/objective/selection.hpp"
#include "lumo/pipeline/evaluate.hpp"
#include "lumo/study/paired_differences.hpp"

#include <array>
#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace lumo {

/// Assumptions where the paper leaves a quantity open. The default is lumo's.
struct FingerAssumptions {
  Silicone silicone;
  FingerOptions finger;
  double friction = 0.0;  ///< Coulomb's coefficient between tool and pad
  TiltPlane tilt = TiltPlane::xz;

  bool operator==(const FingerAssumptions&) const = default;
};

/// Another assumption about one quantity. By its key, a word without blanks, it is asked for.
struct AssumptionVariant {
  std::string key, quantity, value;
  std::function<void(FingerAssumptions&)> apply;

  std::string name() const { return quantity + ": " + value; }
};

/// Contacts of the study: the smallest and the largest sphere at y = 0, straight and under 30°, and straight at
/// y = 5.5 mm, because J_obs compares places; only the straight ones enter it.
inline std::vector<Scenario<Sphere>> assumption_contacts() {
  std::vector<Scenario<Sphere>> contacts;
  for (const double d : {10e-3, 30e-3})
    for (const auto& [angle, y] : {std::pair(0.0, 0.0), {pi / 6.0, 0.0}, {0.0, 5.5e-3}})
      contacts.push_back({Sphere{d}, angle, y});
  return contacts;
}

/// Comparisons of a study of assumptions.
struct AssumptionStudy {
  FingerAssumptions usual;
  std::vector<AssumptionVariant> variants;  ///< each is compared with `usual`
  std::vector<Scenario<Sphere>> contacts;
};

/// A design under one set of assumptions.
struct AssumptionResult {
  std::string why;  ///< empty: it has both objectives
  Evaluation evaluation;
};

/// Scores of a design under one set of assumptions, and which contacts decide it (named as the caller likes).
struct AssumptionScore {
  std::optional<Estimate> J_contact, J_obs;
  std::string worst_contact, worst_observation;

  bool whole() const { return J_contact && J_obs; }
};

/// How a variant moves the results of many designs.
struct AssumptionEffect {
  std::size_t compared = 0;                    ///< designs with both objectives under both assumptions
  std::size_t lost = 0;                        ///< designs with both objectives under the usual assumption only
  std::optional<PairedSummary> J_contact;      ///< of the differences
  std::optional<PairedSummary> J_obs;          ///< of the differences as fractions of the usual J_obs
  std::optional<double> tau_contact, tau_obs;  ///< Kendall's, of the rankings under both assumptions
  std::size_t worst_contact_moved = 0, worst_observation_moved = 0;  ///< designs of which another contact decides
  std::optional<std::size_t> usual_choice, choice;  ///< i* among the designs compared, as indices into all
};

namespace detail {

inline std::vector<Scenario<Sphere>> tilted(std::vector<Scenario<Sphere>> contacts, TiltPlane tilt) {
  for (Scenario<Sphere>& s : contacts)
    if (s.angle_rad != 0.0) s.tilt = tilt;
  return contacts;
}

}  // namespace detail

/// Do two sets of assumptions have the same equilibria, whatever their light?
inline bool same_mechanics(const FingerAssumptions& a, const FingerAssumptions& b) {
  const auto &f = a.finger, &g = b.finger;
  return a.silicone.mu_Pa == b.silicone.mu_Pa && a.silicone.lambda_Pa == b.silicone.lambda_Pa &&
         a.silicone.density_kg_per_m3 == b.silicone.density_kg_per_m3 && a.friction == b.friction && a.tilt == b.tilt &&
         f.twin == g.twin && f.pad == g.pad && f.mesh == g.mesh && f.bonded_ends == g.bonded_ends &&
         f.pivot == g.pivot && f.recess.depth == g.recess.depth && f.recess.length_y == g.recess.length_y &&
         led_places(f.leds) == led_places(g.leds);
}

namespace detail {

using Apply = std::function<void(FingerAssumptions&)>;

inline Apply with_friction(double mu) {
  return [mu](FingerAssumptions& a) { a.friction = mu; };
}
inline Apply with_stiffness(double factor) {
  return [factor](FingerAssumptions& a) { a.silicone.mu_Pa *= factor; };
}
inline Apply with_carrier(double albedo) {
  return [albedo](FingerAssumptions& a) { a.finger.carrier_albedo = albedo; };
}
inline Apply wetted_by(SurfaceOptics tool) {
  return [tool](FingerAssumptions& a) { a.finger.touched = tool; };
}
/// That share of the extinction is scattering.
inline Apply with_scattering(double albedo) {
  return [albedo](FingerAssumptions& a) {
    a.silicone = scattering_the_rest(a.silicone, (1.0 - albedo) * a.silicone.extinction_per_m(), 0.9);
  };
}
inline Apply absorbing(double per_m, double anisotropy) {
  return [=](FingerAssumptions& a) { a.silicone = scattering_the_rest(a.silicone, per_m, anisotropy); };
}

/// Where LEDs lie in recesses. `height_m`: Body::film_closes_m.
inline Apply film_closing(double height_m) {
  return [height_m](FingerAssumptions& a) {
    if (a.finger.recess.depth > 0.0) a.finger.recess.film_closes = height_m;
  };
}

/// How the pad is built and held.
inline std::vector<AssumptionVariant> assumptions_about_the_pad() {
  using Changed = FingerAssumptions;
  return {
      {"narrow_pad", "pad width", "20 mm, t_min only above",
          [](Changed& a) {
            a.finger.pad.width = 20.0;
            a.finger.pad.thickness = Thickness::above;
          }},
      {"held_ends", "end faces", "held, clear", [](Changed& a) { a.finger.bonded_ends = true; }},
      {"tilt_along", "tilt plane", "y–z", [](Changed& a) { a.tilt = TiltPlane::yz; }},
      {"friction_0.3", "friction", "0.3", with_friction(0.3)},
      {"friction_0.5", "friction", "0.5", with_friction(0.5)},
      {"friction_1", "friction", "1", with_friction(1.0)},
      {"softer", "shear modulus", "−10 %", with_stiffness(0.9)},
      {"stiffer", "shear modulus", "+10 %", with_stiffness(1.1)},
  };
}

/// Where light starts, what it meets and what is seen of it.
inline std::vector<AssumptionVariant> assumptions_about_light() {
  using Changed = FingerAssumptions;
  return {
      {"leds_on_sides", "LEDs", "on the sides",
          [](Changed& a) { a.finger.leds.place = FingerOptions::Leds::Place::sides; }},
      {"steep_sides_seen", "visible normal", "|n_x| ≥ 0.9", [](Changed& a) { a.finger.readout.min_abs_nx = 0.9; }},
      {"one_side_seen", "visible side", "one", [](Changed& a) { a.finger.readout.one_side = true; }},
      {"both_sides_seen", "visible side", "both", [](Changed& a) { a.finger.readout.one_side = false; }},
      {"seen_by_direction", "visible light", "all towards +x",
          [](Changed& a) { a.finger.readout.by_direction = true; }},
      {"bins_in_space", "bins", "in space", [](Changed& a) { a.finger.readout.in_space = true; }},
      {"scattering_0.5", "scattering albedo", "0.5, g = 0.9", with_scattering(0.5)},
      {"scattering_0.9", "scattering albedo", "0.9, g = 0.9", with_scattering(0.9)},
      {"wetted_black", "indenter", "wetted, black", wetted_by(Absorber{})},
      {"wetted_white", "indenter", "wetted, white (0.8)", wetted_by(Lambertian{0.8})},
      {"carrier_0.5", "carrier albedo", "0.5", with_carrier(0.5)},
      {"carrier_0.95", "carrier albedo", "0.95", with_carrier(0.95)},
      {"carrier_0.8", "carrier albedo", "0.8", with_carrier(0.8)},
      {"film_closes_on_touch", "film over LEDs", "closes on touch", film_closing(0.0)},
      {"film_closes_20_um", "film over LEDs", "closes below 20 µm", film_closing(20e-6)},
      {"film_closes_60_um", "film over LEDs", "closes below 60 µm", film_closing(60e-6)},
  };
}

}  // namespace detail

/// Every other assumption about one quantity, of pads and their light.
inline std::vector<AssumptionVariant> all_assumption_variants() {
  std::vector<AssumptionVariant> all = detail::assumptions_about_the_pad();
  for (const FingerVariant& v : finger_variants())
    all.push_back(
        {v.key, v.quantity, v.value, [apply = v.apply](FingerAssumptions& assumed) { apply(assumed.finger); }});
  for (AssumptionVariant& v : detail::assumptions_about_light()) all.push_back(std::move(v));
  return all;
}

/// Those of them that the study compares with the usual assumptions: all that change them.
inline std::vector<AssumptionVariant> assumption_variants(const FingerAssumptions& usual = {dragon_skin(), {}}) {
  std::vector<AssumptionVariant> all = all_assumption_variants();
  std::erase_if(all, [&](const AssumptionVariant& v) {
    FingerAssumptions assumed = usual;
    v.apply(assumed);
    return assumed == usual;
  });
  return all;
}

/// How much of a silicone's extinction is absorbed [1/m], where the paper takes all of it: the rest is scattered.
inline std::vector<AssumptionVariant> absorption_variants() {
  std::vector<AssumptionVariant> all;
  for (const int per_m : {7, 20, 41, 71}) {
    const std::string n = std::to_string(per_m);
    all.push_back({"absorbed_" + n, "absorbed", n + " per m, g = 0", detail::absorbing(per_m, 0.0)});
    all.push_back({"absorbed_" + n + "_forward", "absorbed", n + " per m, g = 0.9", detail::absorbing(per_m, 0.9)});
  }
  return all;
}

/// All of both lists.
inline std::vector<AssumptionVariant> known_assumption_variants() {
  std::vector<AssumptionVariant> all = all_assumption_variants();
  for (AssumptionVariant& v : absorption_variants()) all.push_back(std::move(v));
  return all;
}

/// A design under the usual assumptions, then under each variant; a failure in one leaves the others whole. Equilibria
/// that a variant does not move are found once. If the usual assumptions fail, no variant can be compared with them:
/// their result is the only one. `pipeline_for(assumptions)` gives the tools with their silicone and friction. Throws
/// InfeasibleDesign for the usual assumptions, and MeshError if the machine's limits ended a mesh: another try may have
/// them all.
template <class PipelineFor, Executor E> std::vector<AssumptionResult> evaluate_assumptions(const FingerDesign& design,
    const AssumptionStudy& study, const PipelineFor& pipeline_for, const E& executor,
    const ProgressReport& progress = {}) {
  const auto result = [](Evaluation e) {
    std::string why = failure_of(e);
    return AssumptionResult{std::move(why), std::move(e)};
  };
  const FingerAssumptions& usual = study.usual;
  const Body body = finger(design, usual.silicone, usual.finger);
  const auto pipeline = pipeline_for(usual);
  const auto pressed = press(body, detail::tilted(study.contacts, usual.tilt), pipeline, executor, progress);
  std::vector<AssumptionResult> results = {
      result(score(observe(body, pressed, pipeline, executor, progress), pipeline))};
  if (!results.front().why.empty()) return results;
  for (const AssumptionVariant& variant : study.variants) {
    const ProgressReport named = [&](std::string_view stage, int done, int total) {
      if (progress) progress(message(variant.quantity, " ", variant.value, ", ", stage), done, total);
    };
    FingerAssumptions assumed = usual;
    variant.apply(assumed);
    try {
      const Body other = finger(design, assumed.silicone, assumed.finger);
      const auto tools = pipeline_for(assumed);
      const auto turned = detail::tilted(study.contacts, assumed.tilt);
      if (turned == pressed.scenarios) assumed.tilt = usual.tilt;  // none of them is tilted
      const bool shared = same_mechanics(assumed, usual) && has_image_channels(other, pressed, tools);
      Observations seen =
          shared ? observe(other, pressed, tools, executor, named) : observe(other, turned, tools, executor, named);
      results.push_back(result(score(std::move(seen), tools)));
    } catch (const MeshError& e) {
      if (is_machine_limit(e)) throw;
      results.push_back({message("mesh: ", e.what()), {}});
    } catch (const InfeasibleDesign& e) {
      results.push_back({e.what(), {}});
    }
  }
  return results;
}

/// Both lists are in the order of the designs.
inline AssumptionEffect effect_of(
    const std::vector<AssumptionScore>& usual, const std::vector<AssumptionScore>& varied) {
  AssumptionEffect effect;
  std::vector<std::size_t> both;
  for (std::size_t k = 0; k < usual.size() && k < varied.size(); ++k) {
    if (usual[k].whole() && varied[k].whole()) both.push_back(k);
    else effect.lost += usual[k].whole();
  }
  effect.compared = both.size();
  std::vector<Estimate> contact, observation;
  std::array<std::vector<double>, 2> contacts, observations;
  std::array<std::vector<std::pair<double, double>>, 2> pairs;
  for (const std::size_t k : both) {
    contact.push_back(paired_difference(*varied[k].J_contact, *usual[k].J_contact));
    if (const double J = usual[k].J_obs->value; J > 0.0) {
      const Estimate d = paired_difference(*varied[k].J_obs, *usual[k].J_obs);
      observation.push_back({d.value / J, d.error / J});
    }
    for (const auto& [side, scores] : {std::pair(0, &usual), {1, &varied}}) {
      const AssumptionScore& s = (*scores)[k];
      contacts[std::size_t(side)].push_back(s.J_contact->value);
      observations[std::size_t(side)].push_back(s.J_obs->value);
      pairs[std::size_t(side)].emplace_back(s.J_contact->value, s.J_obs->value);
    }
    effect.worst_contact_moved += usual[k].worst_contact != varied[k].worst_contact;
    effect.worst_observation_moved += usual[k].worst_observation != varied[k].worst_observation;
  }
  effect.J_contact = summarize(contact);
  effect.J_obs = summarize(observation);
  effect.tau_contact = kendall_tau(contacts[0], contacts[1]);
  effect.tau_obs = kendall_tau(observations[0], observations[1]);
  if (const auto i = balanced_choice(pairs[0])) effect.usual_choice = both[*i];
  if (const auto i = balanced_choice(pairs[1])) effect.choice = both[*i];
  return effect;
}

}  // namespace lumo
