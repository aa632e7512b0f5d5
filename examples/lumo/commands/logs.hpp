#pragma once

#include "commands/commands.hpp"
#include "commands/topics.hpp"
#include "sensing/camera_options.hpp"

#include <string>

namespace lumo::program {

using namespace sense;

/// A command about a log.
struct LogCommand : Common {
  std::string log;    ///< folder, MCAP file, or a ROS 2 bag's folder
  std::string hint;   ///< where its help is
  McapTopics topics;  ///< of a bag that has several

  void add_log(CLI::App& app,
      const char* help = "Folder of the log, an MCAP file, or the folder of a ROS 2 bag (docs/log_format.md)") {
    app.add_option("LOG", log, help);
    add_topics(app, topics);
    hint = " (see " + full_name(app) + " --help)";
  }
  void require_log() const {
    if (log.empty()) throw UsageError("the log is missing" + hint);
  }
};

/// A command that may look through a camera instead.
struct CameraCommand : LogCommand {
  CameraOptions camera;

  /// Throws UsageError, and Error where pictures cannot be read.
  void check_camera() const {
    camera.check();
    if (!camera.number) require_log();
    if (camera.number && out)
      throw UsageError(
          "--out keeps what is found in a log; a live camera's lines go to standard output (lumo record makes a log)");
  }
};

/// A command on a log that a live camera may record before, by the plan of another log.
struct PlannedCommand : LogCommand {
  CameraOptions camera;

  void declare_planned(CLI::App& app);
  void check() const;
  /// The log to look at: the one that was given, or the new one. Throws InputError.
  std::string recorded(Progress& progress) const;
};

}  // namespace lumo::program
