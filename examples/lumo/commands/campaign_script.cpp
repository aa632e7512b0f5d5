#include "commands/campaigns.hpp"
#include "console/text.hpp"
#include "store/open_store.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace lumo::program {

namespace {

/// A script of a cluster's scheduler that starts workers on one store.
struct CampaignScript : StoreCommand {
  std::string engine, config, time_limit = "24:00:00";
  std::vector<std::string> settings;
  int workers = 1, threads = 1;

  void declare(CLI::App& app) {
    StoreCommand::declare(app);
    add_word(app, "--engine", engine, {"slurm"}, "Scheduler: slurm")->required();
    add_whole(app, "--workers", workers, 1, 100000, "Tasks of the array, default 1");
    add_whole(app, "--threads", threads, 1, 1024, "Of each worker, default 1");
    add_text(app, "--time", time_limit, "TIME", "Limit of a task, as Slurm takes it, default 24:00:00");
    add_text(app, "--config", config, "FILE", "Configuration that campaign run is given");
    add_texts(app, "--set", settings, "PATH=VALUE", "Setting that it is given, as search.pending=64; may be repeated");
  }
  void check() const {
    if (time_limit.empty() || time_limit.find_first_not_of("0123456789:-") != std::string::npos)
      throw UsageError("--time is " + in_quotes(time_limit) + ", must be as 90, 8:00:00 or 2-12:00:00");
  }
  /// What decides the problem, as campaign run takes it.
  std::string given() const {
    std::string text;
    if (!config.empty()) text += " --config " + shell_word(std::filesystem::absolute(config).string());
    for (const std::string& setting : settings) text += " --set " + shell_word(setting);
    return text;
  }
  Result run(Output&, Progress&) const {
    std::error_code unknown;
    const std::filesystem::path own = std::filesystem::read_symlink("/proc/self/exe", unknown);
    const std::string store_typed = is_database(store) ? shown_store(store) : std::filesystem::absolute(store).string();
    const std::string work = shell_word(unknown ? "lumo" : own.string()) + " campaign run --store " +
                             shell_word(store_typed) + lumo::message(" --threads ", threads) + given();
    const std::string script = lumo::message("#!/bin/sh\n#SBATCH --job-name=lumo\n#SBATCH --array=1-", workers,
        "\n#SBATCH --ntasks=1\n#SBATCH --cpus-per-task=", threads, "\n#SBATCH --time=", time_limit,
        "\n#SBATCH --requeue\n#SBATCH --signal=B:USR1@90\n#SBATCH --output=lumo-%A_%a.out\n",
        "# Each task is a worker; the store's address is all that they share. A password is read from ~/.pgpass.\n"
        "# 90 s before the time limit a worker gives its claim back, and its task is queued again.\n",
        work,
        " &\nworker=$!\nlate=\ntrap 'late=1; kill -TERM \"$worker\"' USR1\nwait \"$worker\"\ncode=$?\n"
        "if [ -n \"$late\" ]; then\n  wait \"$worker\"\n"
        "  scontrol requeue \"${SLURM_ARRAY_JOB_ID}_${SLURM_ARRAY_TASK_ID}\"\nfi\nexit \"$code\"\n");
    return json ? Json{{"engine", engine}, {"workers", workers}, {"script", script}}.dump(2) + "\n" : script;
  }
};

}  // namespace

void add_campaign_script(CommandLine& line) {
  line.add<CampaignScript>("campaign script", "A scheduler's script, to standard output, that starts workers");
}

}  // namespace lumo::program
