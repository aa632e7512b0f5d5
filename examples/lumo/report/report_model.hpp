#pragma once

#include "store/campaign_store.hpp"

#include <string>

namespace lumo::program {

/// A campaign as the page shows it, all but the presses of the selected design. From records it takes numbers and what
/// it knows; nothing else.
Json campaign_model(const StoredCampaign& campaign, const std::string& store);

/// "DS, flat": what distinguishes campaigns.
std::string campaign_name(const CampaignProblem& problem);

}  // namespace lumo::program
