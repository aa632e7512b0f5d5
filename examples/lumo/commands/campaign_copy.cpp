#include "commands/campaigns.hpp"
#include "console/text.hpp"
#include "store/open_store.hpp"

#include "lumo/campaign/copy_store.hpp"

#include <filesystem>

namespace lumo::program {

namespace {

/// A store into another, or what that one lacks of it.
struct CampaignCopy : Common {
  std::string from, to;

  void declare(CLI::App& app) {
    app.add_option("FROM", from, "Store that is there: a file or postgresql://HOST/DATABASE");
    app.add_option("TO", to, "Store to make, or to bring up to date");
    add_common(app, *this);
  }
  void check() const {
    if (from.empty() || to.empty())
      throw UsageError("'lumo campaign copy' needs two stores, FROM and TO; see 'lumo campaign copy --help'");
    std::error_code none;
    if (shown_store(from) == shown_store(to) ||
        (!is_database(from) && !is_database(to) && std::filesystem::equivalent(from, to, none)))
      throw UsageError("FROM and TO are the same store");
  }
  Result run(Output&, Progress&) const {
    const auto [entries, digest] = with_store(from, [&](const auto& source) {
      source.verify();
      return with_store(to, source.entries().front().content, [&](auto& copy) {
        copy_store(source, copy);
        return std::pair(copy.entries().size(), copy.digest());
      });
    });
    if (json)
      return Json{{"from", shown_store(from)}, {"to", shown_store(to)}, {"entries", entries}, {"digest", digest}}.dump(
                 2) +
             "\n";
    return lumo::message(shown_store(to), ": ", entries, " entries, digest ", digest, "\n");
  }
};

}  // namespace

void add_campaign_copy(CommandLine& line) {
  line.add<CampaignCopy>("campaign copy", "A store into another, file or database, to the same bits");
}

}  // namespace lumo::program
