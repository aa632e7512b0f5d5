// Takes the place of campaigns and studies where a component is missing, so that `lumo doctor` can still say which.
#include "commands/campaign.hpp"
#include "commands/study.hpp"

namespace lumo::program {

namespace {

[[noreturn]] void off(const Options& o) { throw Error("'" + std::string(name(o.command)) + "' was built without a library that it needs; run 'lumo doctor'"); }

}  // namespace

std::string campaign_run(const Options& o, Progress&) { off(o); }
std::string campaign_status(const Options& o) { off(o); }
std::string campaign_verify(const Options& o) { off(o); }
std::string campaign_export(const Options& o) { off(o); }
std::string campaign_select(const Options& o, Progress&) { off(o); }
std::string campaign_report(const Options& o, Progress&) { off(o); }
std::string study(const Options& o, Output&, Progress&) { off(o); }
std::string study_readings(const Options& o, Output&, Progress&) { off(o); }

}  // namespace lumo::program
