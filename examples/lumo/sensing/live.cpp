#include "sensing/live.hpp"

#include "console/interrupt.hpp"
#include "console/output.hpp"
#include "console/text.hpp"
#include "sensing/log.hpp"

#include "lumo/core/files.hpp"
#include "lumo/core/stopwatch.hpp"
#include "lumo/sense/live/live.hpp"
#include "lumo/sense/live/log_recorder.hpp"
#include "lumo/sense/recording/recording.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <limits>
#include <system_error>
#include <utility>

namespace lumo::program {

using namespace sense;

namespace fs = std::filesystem;

MiniCheetahMotors motors_of(const CameraOptions& o) {
  MiniCheetahMotors::Config c;
  c.motors = o.motors;
  c.protocol.position_rad = o.motor_ranges[0];
  c.protocol.velocity_rad_per_s = o.motor_ranges[1];
  c.protocol.torque_Nm = c.protocol.effort = o.motor_ranges[2];
  return MiniCheetahMotors::open(o.can, c);
}

void require_motors(const CameraOptions& o, int joints) {
  if (int(o.motors.size()) == joints) return;
  throw UsageError(lumo::message("--motors has ", o.motors.size(), o.motors.size() == 1 ? " motor" : " motors",
      ", the log ", joints, joints == 1 ? " joint" : " joints"));
}

double LiveLines::seconds(std::int64_t stamp_ns) {
  if (begun_ == 0) {
    first_ = stamp_ns;
    begun_ = steady_ns();
  }
  return 1e-9 * double(stamp_ns - first_);
}

bool LiveLines::operator()(std::optional<std::int64_t> picture_ns, bool used, const std::string& line) {
  if (picture_ns) late_ms_.push_back(1e-6 * double(steady_ns() - *picture_ns));
  unused_ += !used;
  print(line + "\n");
  // Whoever read has gone: enough.
  return std::cout && (o_.seconds == 0.0 || 1e-9 * double(steady_ns() - begun_) < o_.seconds);
}

void LiveLines::close(Progress& progress) const {
  if (late_ms_.empty()) throw InputError(o_.device() + ": gives no pictures that say anything");
  progress.note(
      lumo::message(late_ms_.size(), " pictures, ", unused_, " lines without an estimate; from stamp to estimate ",
          cell(quantile(late_ms_, 0.5), 2), " ms (median), ", cell(quantile(late_ms_, 0.99), 2), " ms (99 %)"));
}

std::string before_camera(const CameraOptions& o, Progress& progress, const std::function<void(LiveLines&)>& work) {
  LiveLines lines(o);
  about(o.device(), [&] { work(lines); });
  lines.close(progress);
  return "";
}

namespace {

/// What the plan asks for next.
std::string wanted(const Segment& s) {
  std::string text = one_line(s.kind_name());
  if (s.place >= 0) text += lumo::message(", place ", s.place, " (y ", short_number(s.y_mm), " mm)");
  if (s.load_N > 0.0) text += ", " + short_number(s.load_N) + " N";
  if (s.angle_deg != 0.0) text += ", " + short_number(s.angle_deg) + "°";
  if (s.diameter_mm > 0.0) text += ", sphere of " + short_number(s.diameter_mm) + " mm";
  if (s.repetition >= 0) text += lumo::message(", repetition ", s.repetition);
  if (s.cycle >= 0) text += lumo::message(", cycle ", s.cycle);
  return text + lumo::message(", for ", cell(1e-9 * double(s.to_ns - s.from_ns), 1), " s");
}

void announce(RecordingPlan& plan, double now_s, Progress& progress) {
  while (const Segment* s = plan.announced(now_s)) {
    const double ahead_s = std::max(0.0, 1e-9 * double(s->from_ns) - now_s);
    progress.tell(lumo::message(cell(now_s, 1), " s: in ", cell(ahead_s, 1), " s ", wanted(*s)));
  }
}

/// Unlike NewFolder's it keeps what is in it, whatever happens.
void make_folder(const std::string& path) {
  std::error_code error;
  if (fs::exists(path, error) && !(fs::is_directory(path, error) && fs::is_empty(path, error)))
    throw InputError("cannot write to '" + path + "': it is there and not empty");
  fs::create_directories(fs::path(path) / "frames", error);
  if (error) throw InputError("cannot write to '" + path + "': " + error.message());
}

}  // namespace

namespace {

std::string counts_of(const Recorded& r, const std::string& to, const RecordingPlan& plan) {
  std::string text = lumo::message(to, ": ", r.frames, " pictures, ", r.samples, " joint samples; left out ",
      r.lost_frames, " and ", r.lost_samples);
  if (!plan.segments().empty())
    text += lumo::message("; ", r.segments, " of ", plan.segments().size(), " segments done");
  return text;
}

template <class Recorder> Recorded recorded_by(const Recorder& recorder, std::size_t segments) {
  return {"", recorder.frames(), recorder.samples(), recorder.lost_frames(), recorder.lost_samples(), segments};
}

}  // namespace

Recorded record(const CameraOptions& o, const std::string& log, const std::string& to, Progress& progress) {
  Session session;
  if (!log.empty()) session = open_log(log, progress).session;
  session.video.clear();
  session.joint_clock = session.wrench_clock = {};  // camera and motors are stamped on one clock
  RecordingPlan plan(std::exchange(session.segments, {}));
  const bool planned = !plan.segments().empty();
  const double seconds = o.seconds > 0.0 ? o.seconds
                         : planned       ? plan.seconds()
                                         : std::numeric_limits<double>::infinity();
  const std::string device = o.device();
  const auto camera = pictures().live(settings_of(o));
  std::optional<MiniCheetahMotors> motors;
  if (!o.can.empty()) motors.emplace(motors_of(o));
  make_folder(to);
  const GentleStop gentle;
  bool whole = false;  // it lasted as long as it was to
  const auto going_on = [&](double now_s) {
    announce(plan, now_s, progress);
    whole = now_s > seconds;
    return !whole && !GentleStop::asked();
  };
  progress.tell(to + (std::isinf(seconds) ? ": recording until it is interrupted"
                                          : ": recording for " + cell(seconds, 1) + " s"));
  std::string fault;
  Recorded r;
  {
    LogRecorder recorder(to, to_json(session), [](const ImageView& v) { return pictures().encode(".png", v); });
    try {
      NoActuator none;
      if (motors) record_live(*camera, *motors, recorder, going_on, {.name = device});
      else record_live(*camera, none, recorder, going_on, {.name = device});
      recorder.finish();
    } catch (const Error& e) {
      fault = e.what();
    }
    session.segments = plan.done(recorder.end_ns());
    r = recorded_by(recorder, session.segments.size());
  }
  if (r.frames == 0) {  // nothing to keep
    std::error_code error;
    fs::remove_all(to, error);
    throw InputError(fault.empty() ? device + ": gives no pictures" : fault);
  }
  write_whole(to + "/session.json", to_json(session));
  r.counts = counts_of(r, to, plan);
  if (fault.empty() && !whole && !GentleStop::asked()) fault = device + ": has gone";
  if (!fault.empty()) throw InputError(fault + "; recorded is " + r.counts);
  if (GentleStop::asked() && (planned || o.seconds > 0.0)) {
    progress.tell(r.counts);
    end_interrupted();
  }
  return r;
}

}  // namespace lumo::program
