#include "program/live.hpp"

#include "lumo/sense/live/live_force.hpp"
#include "lumo/sense/live/live_hand.hpp"
#include "lumo/sense/live/live_location.hpp"
#include "lumo/sense/live/log_recorder.hpp"
#include "lumo/sense/localize/peak_localizer.hpp"
#include "lumo/sense/joints/planar_finger.hpp"
#include "lumo/sense/recording/recording_plan.hpp"
#include "lumo/support/socketcan.hpp"
#include "program/interrupt.hpp"
#include "program/json.hpp"
#include "program/localizers.hpp"
#include "program/sensing_log.hpp"
#include "program/text.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <limits>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

namespace lumo::program {

namespace fs = std::filesystem;

namespace {

V4l2Camera::Config camera_of(const Options& o) {
  V4l2Camera::Config c;
  c.device = "/dev/video" + std::to_string(*o.camera);
  c.width = o.pixels[0], c.height = o.pixels[1];
  c.frames_per_s = o.rate_per_s, c.exposure_s = 1e-3 * o.exposure_ms, c.gain = o.gain;
  return c;
}

/// Listens on the bus; whoever controls the motors commands them.
MiniCheetahMotors motors_of(const Options& o) {
  MiniCheetahMotors::Config c;
  c.motors = o.motors;
  c.protocol.position_rad = o.motor_ranges[0], c.protocol.velocity_rad_per_s = o.motor_ranges[1], c.protocol.torque_Nm = c.protocol.effort = o.motor_ranges[2];
  return MiniCheetahMotors::open(o.can, c);
}

/// As many motors as the log's joints; said before a device is opened. Throws UsageError.
void require_motors(const Options& o, int joints) {
  if (int(o.motors.size()) != joints) throw UsageError(lumo::message("--motors tells of ", o.motors.size(), o.motors.size() == 1 ? " motor" : " motors", ", the log of ", joints, joints == 1 ? " joint" : " joints"));
}

/// One line for each picture, and how long after its stamp it was told.
class Told {
 public:
  Told(const Options& o, std::string device) : o_(o), device_(std::move(device)) {}

  /// Since the first line.
  double seconds(std::int64_t stamp_ns) {
    if (begun_ == 0) first_ = stamp_ns, begun_ = steady_ns();
    return 1e-9 * double(stamp_ns - first_);
  }
  /// A line about a picture, or none (of a time without pictures). Says whether to go on.
  bool operator()(std::optional<std::int64_t> picture_ns, bool used, const std::string& line) {
    if (picture_ns) late_ms_.push_back(1e-6 * double(steady_ns() - *picture_ns));
    unused_ += !used;
    print(line + "\n");
    return std::cout && (o_.seconds == 0.0 || 1e-9 * double(steady_ns() - begun_) < o_.seconds);   // whoever read has gone: enough
  }
  void close(Progress& progress) {
    if (late_ms_.empty()) throw InputError(device_ + ": gives no pictures that tell anything");
    progress.note(lumo::message(late_ms_.size(), " pictures, ", unused_, " lines without an estimate; from stamp to estimate ", cell(quantile(late_ms_, 0.5), 2), " ms (median), ", cell(quantile(late_ms_, 0.99), 2), " ms (99 %)"));
  }

 private:
  const Options& o_;
  std::string device_;
  std::vector<double> late_ms_;
  int unused_ = 0;
  std::int64_t first_ = 0, begun_ = 0;
};

/// Calls `use` with a maker of the localiser that was asked for.
template <class Use>
void with_maker(const Options& o, Use use) {
  if (o.localizer == "peak") use(peak_localizer);
  else use(bayes_localizer);
}

void locate(const Options& o, Told& told, Progress& progress) {
  Session session;
  if (!o.log.empty()) session = open_log(o.log, progress).session;
  const auto config = camera_of(o);
  V4l2Camera camera(config);
  progress.tell("leave the finger alone for a second");
  const auto line = [&](std::int64_t stamp_ns, const std::optional<LocationEstimate>& e, Faults faults) {
    const double seconds = told.seconds(stamp_ns);
    const auto y = e && e->contacts == 1 ? std::optional(1e3 * e->contact[0].y_m) : std::nullopt, sigma = y ? std::optional(1e3 * std::sqrt(e->contact[0].variance_m2)) : std::nullopt;
    if (o.json)
      return told(stamp_ns, e.has_value(), Json{{"stamp_ns", stamp_ns}, {"contacts", e ? Json(e->contacts) : Json(nullptr)}, {"y_mm", maybe(y)}, {"y_sigma_mm", maybe(sigma)},
                                                {"probability", e ? number(e->probability) : Json(nullptr)}, {"faults", to_string(faults)}}.dump());
    return told(stamp_ns, e.has_value(), cell(seconds, 3) + " s  " + (!e ? "picture not used: " + to_string(faults) : y ? "y " + cell(*y, 1) + " ± " + cell(*sigma, 1) + " mm" : e->contacts == 0 ? "no contact" : "two contacts"));
  };
  with_maker(o, [&](auto make) { locate_live(camera, session, LongitudinalBins::uniform(-27.5_mm, 27.5_mm, 55), make, line, config.device); });
}

void estimate_force(const Options& o, Told& told, Progress& progress) {
  const OpenLog log = open_log(o.log, progress);
  const PlanarFinger finger = about(log.session_place(), [&] { return finger_of(log); });
  const JointReference joints = finger_joints(log, unloaded_stretch(log).to_ns);
  require_motors(o, finger.joints());
  const auto config = camera_of(o);
  V4l2Camera camera(config);
  MiniCheetahMotors motors = motors_of(o);
  progress.tell("leave the finger alone for a second");
  std::int64_t newest = 0;
  const auto line = [&](const ForceEstimate& e) {
    const double seconds = told.seconds(e.stamp_ns);
    const bool good = e.state == EstimatorState::ok || e.state == EstimatorState::degraded, fresh = e.frame_stamp_ns > newest;
    newest = std::max(newest, e.frame_stamp_ns);
    const auto picture = fresh ? std::optional(e.frame_stamp_ns) : std::nullopt;
    Json contacts = Json::array();
    std::string text;
    for (int k = 0; k < e.contacts; ++k) {
      const ContactForce& c = e.contact[std::size_t(k)];
      const auto y = c.y_m ? std::optional(1e3 * *c.y_m) : std::nullopt;
      const double force_sigma = std::sqrt(c.force_variance_N2), y_sigma = 1e3 * std::sqrt(c.y_variance_m2);
      contacts.push_back({{"force_N", maybe(c.force_N)}, {"force_sigma_N", number(force_sigma)}, {"y_mm", maybe(y)}, {"y_sigma_mm", number(y_sigma)}});
      text += (c.force_N ? "  F " + cell(*c.force_N, 2) + " ± " + cell(force_sigma, 2) + " N" : "  F not known") + (y ? ", y " + cell(*y, 1) + " ± " + cell(y_sigma, 1) + " mm" : ", y not known");
    }
    if (o.json) return told(picture, good, Json{{"stamp_ns", e.stamp_ns}, {"frame_stamp_ns", e.frame_stamp_ns}, {"state", to_string(e.state)}, {"contacts", contacts}, {"faults", to_string(e.faults)}}.dump());
    return told(picture, good, cell(seconds, 3) + " s  " + to_string(e.state) + (e.faults.any() ? ", " + to_string(e.faults) : std::string()) + (text.empty() ? "  no contact" : text));
  };
  with_maker(o, [&](auto make) {
    estimate_forces_live(camera, motors, joints, log.session, LongitudinalBins::uniform(-27.5_mm, 27.5_mm, 55), make, finger, line, config.device, finger.pad_link());
  });
}

void observe(const Options& o, Told& told, Progress& progress) {
  const OpenLog log = open_hand_log(o.log, progress);
  HandObserver observer = about(log.session_place(), [&] { return hand_observer(log.session); });
  const TimeSeries positions = about(o.log, [&] { return joint_positions(log.joints, log.session); });
  LogCamera recorded(log);
  require_motors(o, int(log.joints.front().position_rad.size()));
  progress.stage("pictures of the unloaded hand");
  if (add_references(recorded, observer, positions, log.session) == 0) throw InputError(o.log + ": no picture of the unloaded hand in which a link is found");
  progress.finish();
  const auto config = camera_of(o);
  V4l2Camera camera(config);
  MiniCheetahMotors motors = motors_of(o);
  observe_hand_live(
      camera, motors, observer, log.session,
      [&](const HandEstimate& e, const ImageView&) {
        const double seconds = told.seconds(e.stamp_ns);
        const auto seen = std::count(e.seen.begin(), e.seen.end(), true);
        Json contacts = Json::array();
        std::string text;
        for (const HandContact& c : e.contacts) {
          const std::string& name = observer.links()[std::size_t(c.link)].name;
          contacts.push_back({{"link", c.link}, {"name", name}, {"y_mm", number(1e3 * c.y_m)}, {"z_mm", number(1e3 * c.z_m)}, {"area_mm2", number(1e6 * c.area_m2)}, {"peak_DN", number(c.peak_DN)}});
          text += "  " + one_line(name) + " y " + cell(1e3 * c.y_m, 1) + " mm";
        }
        if (o.json) return told(e.stamp_ns, seen > 0, text_of(Json{{"stamp_ns", e.stamp_ns}, {"seen", seen}, {"contacts", contacts}}, -1));
        return told(e.stamp_ns, seen > 0, cell(seconds, 3) + " s  " + lumo::message(seen, " links seen") + (text.empty() ? "  no contact" : text));
      },
      config.device);
}

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

/// Unlike NewFolder's it keeps what is in it, whatever happens.
void make_folder(const std::string& path) {
  std::error_code error;
  if (fs::exists(path, error) && !(fs::is_directory(path, error) && fs::is_empty(path, error))) throw InputError("cannot write to '" + path + "': it is there and not empty");
  fs::create_directories(fs::path(path) / "frames", error);
  if (error) throw InputError("cannot write to '" + path + "': " + error.message());
}

}  // namespace

std::string sense_live(const Options& o, Progress& progress) {
  const std::string device = camera_of(o).device;
  Told told(o, device);
  about(device, [&] {
    if (o.command == Command::locate) locate(o, told, progress);
    else if (o.command == Command::force) estimate_force(o, told, progress);
    else observe(o, told, progress);
  });
  told.close(progress);
  return "";
}

std::string record(const Options& o, const std::string& to, Progress& progress) {
  Session session;
  if (!o.log.empty()) session = open_log(o.log, progress).session;
  session.video.clear();
  session.joint_clock = session.wrench_clock = {};   // camera and motors are stamped on one clock
  RecordingPlan plan(std::exchange(session.segments, {}));
  const bool planned = !plan.segments().empty();
  const double seconds = o.seconds > 0.0 ? o.seconds : planned ? plan.seconds() : std::numeric_limits<double>::infinity();
  const auto config = camera_of(o);
  V4l2Camera camera(config);
  std::optional<MiniCheetahMotors> motors;
  if (!o.can.empty()) motors.emplace(motors_of(o));
  make_folder(to);
  const GentleStop gentle;
  bool whole = false;   // it lasted as long as it was to
  const auto going_on = [&](double now_s) {
    while (const Segment* s = plan.announced(now_s)) progress.tell(lumo::message(cell(now_s, 1), " s: in ", cell(std::max(0.0, 1e-9 * double(s->from_ns) - now_s), 1), " s ", wanted(*s)));
    whole = now_s > seconds;
    return !whole && !GentleStop::asked();
  };
  progress.tell(to + (std::isinf(seconds) ? ": recording until it is interrupted" : lumo::message(": recording for ", cell(seconds, 1), " s")));
  std::string fault;
  std::size_t frames = 0, samples = 0, lost_frames = 0, lost_samples = 0;
  {
    LogRecorder recorder(to, to_json(session), [](const ImageView& v) { return encode_image(".png", v); });
    try {
      if (motors) {
        record_live(camera, *motors, recorder, going_on, config.device);
      } else {
        NoActuator none;
        record_live(camera, none, recorder, going_on, config.device);
      }
      recorder.finish();
    } catch (const Error& e) {
      fault = e.what();
    }
    frames = recorder.frames(), samples = recorder.samples(), lost_frames = recorder.lost_frames(), lost_samples = recorder.lost_samples();
    session.segments = plan.done(recorder.end_ns());
  }
  if (frames == 0) {   // nothing to keep
    std::error_code error;
    fs::remove_all(to, error);
    throw InputError(fault.empty() ? config.device + ": gives no pictures" : fault);
  }
  write_whole(to + "/session.json", to_json(session));
  const std::string counts = lumo::message(to, ": ", frames, " pictures, ", samples, " joint samples; left out ", lost_frames, " and ", lost_samples,
                                                planned ? lumo::message("; ", session.segments.size(), " of ", plan.segments().size(), " segments done") : std::string());
  if (fault.empty() && !whole && !GentleStop::asked()) fault = config.device + ": has gone";
  if (!fault.empty()) throw InputError(fault + "; recorded is " + counts);
  if (GentleStop::asked() && (planned || o.seconds > 0.0)) {
    progress.tell(counts);
    end_interrupted();
  }
  if (o.json) return Json{{"out", to}, {"frames", frames}, {"joint_samples", samples}, {"frames_left_out", lost_frames}, {"joint_samples_left_out", lost_samples}, {"segments", session.segments.size()}}.dump(2) + "\n";
  return counts + "\n";
}

std::string watch(const Options& o) {
  auto config = camera_of(o);
  config.wait_s = 0.05;
  V4l2Camera source(config);
  MeanImage mean;
  std::int64_t first = 0, last = 0;
  int frames = 0;
  for (const std::int64_t end = steady_ns() + 2'000'000'000; steady_ns() < end && source.state() == StreamState::open;)
    if (const auto f = source.next()) {
      mean.add(f->image);
      if (frames++ == 0) first = f->stamp_ns;
      last = f->stamp_ns;
    }
  if (frames < 2) throw InputError(config.device + ": gives no frames");
  const Image image = mean.image();
  double light = 0.0;
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) light += image.view().green(x, y) / (double(image.width) * image.height);
  const auto leds = LedDetector{}.find(image.view());
  const double rate = 1e9 * (frames - 1) / double(last - first);
  if (o.json)
    return Json{{"device", config.device}, {"width", image.width}, {"height", image.height}, {"frames_per_s", number(rate)}, {"exposure_s", number(source.exposure_s())}, {"gain", number(source.gain())},
                {"mean_green_DN", number(light)}, {"leds", leds ? Json(leds->centroid_px.cols()) : Json(0)}, {"led_residual_px", leds ? number(leds->map.residual_px) : Json(nullptr)}}.dump(2) + "\n";
  return lumo::message(config.device, ": ", image.width, " x ", image.height, " px, ", cell(rate, 1), " frames/s, exposure ", 1e3 * source.exposure_s(), " ms, gain ", source.gain(), ", mean green ", cell(light, 1),
                            " DN\n", leds ? lumo::message("LEDs found: ", leds->centroid_px.cols(), ", ", cell(leds->map.residual_px, 2), " px off an even row\n") : std::string("no row of five LEDs found\n"));
}

}  // namespace lumo::program
