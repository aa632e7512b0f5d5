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
  double hypervolume = 0.0;
  std::optional<std::size_t> selected;  ///< index into `trials`

  int count(Trial::State state) const;
};

enum class Check { as_read, whole };

/// Reads what a file or a database keeps; `whole` checks more than what is read. Throws StoreError, or InputError for
/// another program's.
StoredCampaign read_campaign(const std::string& store, Check check = Check::as_read);

}  // namespace lumo::program
