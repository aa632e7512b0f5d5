#include "commands/logs.hpp"

#include "sensing/live.hpp"
#include "sensing/log.hpp"

namespace lumo::program {

using namespace sense;

void PlannedCommand::declare_planned(CLI::App& app) {
  add_camera(app, camera,
      "Number of a live camera: LOG's plan (its segments) is carried out and recorded in DIR/recording, then "
      "evaluated");
  add_seconds(app, camera, "How long to record [s], default: to the plan's end");
  add_picture_options(app, camera);
  add_motor_options(app, camera);
  add_out(app, *this);
  add_common(app, *this);
}

void PlannedCommand::check() const {
  camera.check();
  require_log();
  if (camera.number && !out) throw UsageError("--out is missing: what the camera sees is recorded there");
  pictures();
}

std::string PlannedCommand::recorded(Progress& progress) const {
  if (!camera.number) return log;
  if (open_log(log, progress, topics).session.segments.empty())
    throw InputError(log + ": its session has no segments, nothing states what was touched when");
  const std::string folder = *out + "/recording";
  progress.note(record(camera, log, folder, progress).counts);
  return folder;
}

}  // namespace lumo::program
