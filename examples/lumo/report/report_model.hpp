#pragma once

#include "computing/request.hpp"
#include "report/json.hpp"
#include "report/report.hpp"
#include "store/campaign_store.hpp"

#include <string>

namespace lumo::program {

/// A campaign as the page shows it, all but the presses of the selected design. From records it takes numbers and what
/// it knows; nothing else.
Json campaign_model(const StoredCampaign& campaign, const std::string& store);

/// "DS, flat": what distinguishes campaigns.
std::string campaign_name(const CampaignProblem& problem);

/// What the page shows of a press along z at y = 0: the pad's whole surface at each load and the edges of contact.
/// Lengths of the surface are whole µm, which keeps the page small. States after a failure are left out; `note` then
/// says so.
Json press_model(const PressRequest& request, const PressOutcome& outcome);

}  // namespace lumo::program
