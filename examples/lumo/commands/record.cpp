#include "commands/logs.hpp"
#include "report/json.hpp"
#include "sensing/live.hpp"

namespace lumo::program {

using namespace sense;

namespace {

struct Record : LogCommand {
  CameraOptions camera;
  std::string folder;

  void declare(CLI::App& app) {
    add_log(app, "Folder of a log, or an MCAP file, whose session is the plan (docs/log_format.md)");
    add_camera(app, camera, "Number of the camera")->required();
    add_seconds(
        app, camera, "How long to record [s], default: to the plan's end, or until interrupted where there is none");
    add_picture_options(app, camera);
    add_motor_options(app, camera);
    add_text(app, "--out", folder, "DIR", "Folder of the new log; must not be there, or be empty")->required();
    add_common(app, *this);
  }
  void check() const {
    camera.check();
    pictures();
  }
  Result run(Output&, Progress& progress) const {
    const Recorded r = record(camera, log, folder, progress);
    if (!json) return r.counts + "\n";
    return Json{{"out", folder}, {"frames", r.frames}, {"joint_samples", r.samples}, {"frames_left_out", r.lost_frames},
               {"joint_samples_left_out", r.lost_samples}, {"segments", r.segments}}
               .dump(2) +
           "\n";
  }
};

}  // namespace

void add_record(CommandLine& line) {
  line.add<Record>("record", "Record a live camera and motors as a log, by a plan");
}

}  // namespace lumo::program
