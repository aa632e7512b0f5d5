#pragma once

#include "report/json.hpp"
#include "store/campaign_problem.hpp"

#include "lumo/campaign/campaign.hpp"

#include <optional>
#include <string>
#include <vector>

namespace lumo::program {

/// A state as campaigns report it: "evaluated", "failed" or "under way".
const char* name(Trial::State state);

/// One trial of a campaign as it stands in the store.
struct StoredTrial {
  int id = 0;
  std::array<double, 5> theta_mm{};
  Trial::State state = Trial::State::pending;
  std::string why;     ///< it failed
  Json record, notes;  ///< null while it is under way, or where they are damaged
  bool on_front = false, selected = false;
  /// J_contact and J_obs as the front and the selection take them, as StoredCampaign::modelled says: reported values,
  /// or the models' means with their standard deviations. Undefined unless it was evaluated.
  std::array<double, 2> value = {undefined, undefined}, deviation = {undefined, undefined};
  double hypervolume = undefined;  ///< of all that was evaluated up to it; undefined unless it was

  double seconds() const;  ///< that its evaluation took, as noted; undefined when it was not
};

/// A campaign that was run, whole or in part.
struct StoredCampaign {
  CampaignProblem problem;
  std::string problem_text;  ///< as it stands in the store
  std::string digest, problem_digest;
  std::vector<StoredTrial> trials;
  std::vector<Trial> asked;   ///< the same trials as the optimiser knows them
  std::vector<Claim> claims;  ///< of living workers, by trial: their numbers are indices into `trials`
  double hypervolume = 0.0, low = 0.0, high = 0.0;  ///< with its 90 % interval, equal to it for reported values
  std::vector<std::string> modelled;                ///< objectives that are the models' means, as there is noise
  std::vector<int> known_on_front;                  ///< indices into `problem.known`
  std::optional<std::size_t> selected;              ///< index into `trials`

  int count(Trial::State state) const;
  /// Which values front, hypervolume and selection are made of, in words.
  std::string values() const { return values_words(modelled); }
  /// What is known from the start, in words; empty if nothing is.
  std::string known_words() const;
};

/// What the models believe of a trial: J_contact and J_obs with their standard deviations.
inline Json means_json(const StoredTrial& t) {
  return {{"J_contact_mean", number(t.value[0])}, {"J_contact_mean_err", number(t.deviation[0])},
      {"J_obs_mean", number(t.value[1])}, {"J_obs_mean_err", number(t.deviation[1])}};
}
/// The hypervolume's 90 % interval; null where it has none.
inline Json interval_json(const StoredCampaign& c) {
  return c.low == c.high ? Json(nullptr) : Json{number(c.low), number(c.high)};
}

enum class Check { as_read, whole };

/// Reads what a file or a database keeps; `whole` checks more than what is read. Throws StoreError, or InputError for
/// another program's.
StoredCampaign read_campaign(const std::string& store, Check check = Check::as_read);

}  // namespace lumo::program
