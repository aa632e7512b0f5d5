#include "commands/campaigns.hpp"
#include "store/campaign_store.hpp"
#include "store/open_store.hpp"

namespace lumo::program {

namespace {

struct CampaignVerify : StoreCommand {
  Result run(Output&, Progress&) const {
    const StoredCampaign c = read_campaign(store, Check::whole);
    const std::string shown = shown_store(store);
    if (json)
      return Json{{"store", shown}, {"ok", true}, {"trials", c.trials.size()}, {"digest", c.digest}}.dump(2) + "\n";
    return lumo::message(shown, ": ok, ", c.trials.size(), " trials, digest ", c.digest, "\n");
  }
};

}  // namespace

void add_campaign_verify(CommandLine& line) {
  line.add<CampaignVerify>("campaign verify", "Check every entry of a store; names the first bad one");
}

}  // namespace lumo::program
