#include "commands/campaigns.hpp"
#include "store/campaign_store.hpp"

namespace lumo::program {

namespace {

struct CampaignVerify : StoreCommand {
  Result run(Output&, Progress&) const {
    const SqliteJournal log(store);
    log.verify();
    const StoredCampaign c = read_campaign(log, store);
    if (json)
      return Json{{"store", store}, {"ok", true}, {"trials", c.trials.size()}, {"digest", c.digest}}.dump(2) + "\n";
    return lumo::message(store, ": ok, ", c.trials.size(), " trials, digest ", c.digest, "\n");
  }
};

}  // namespace

void add_campaign_verify(CommandLine& line) {
  line.add<CampaignVerify>("campaign verify", "Check every entry of a store; names the first bad one");
}

}  // namespace lumo::program
