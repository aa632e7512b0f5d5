#include "commands/doctor.hpp"

#include "commands/commands.hpp"
#include "computing/provenance.hpp"
#include "console/text.hpp"
#include "console/version.hpp"
#include "sensing/camera_options.hpp"

#include <thread>

namespace lumo::program {

using namespace sense;

namespace {

#ifdef NDEBUG
constexpr bool assertions = false;
#else
constexpr bool assertions = true;
#endif

std::string report_of(bool as_json) {
  const auto parts = components();
  const unsigned threads = std::thread::hardware_concurrency();
  std::vector<std::string> off;
  for (const auto& c : parts)
    if (!c.on)
      off.push_back(c.name + " (" + c.use + "): apt install " + c.package + ", then configure and build again");

  if (as_json) {
    Json j{{"lumo", version}, {"compiler", compiler()}, {"assertions", assertions}, {"processor", processor()},
        {"threads", threads}};
    j["cpu_flags"] = Json::object();
    for (const auto& f : features()) j["cpu_flags"][f.name] = {{"available", f.here}, {"compiled_for", f.used}};
    j["components"] = Json::array();
    for (const auto& c : parts)
      j["components"].push_back({{"name", c.name}, {"on", c.on},
          {"version", c.version.empty() ? Json(nullptr) : Json(c.version)}, {"licence", c.licence},
          {"package", c.package}, {"use", c.use}, {"detail", c.detail.empty() ? Json(nullptr) : Json(c.detail)}});
    j["off"] = off;
    return j.dump(2) + "\n";
  }

  std::string text = pad("lumo", -15) + version + "\n" + pad("compiler", -15) + compiler() +
                     (assertions ? ", with assertions (slow)" : "") + "\n";
  text +=
      pad("processor", -15) + processor() + ", " + std::to_string(threads) + " threads\n" + pad("instructions", -15);
  for (const auto& f : features())
    if (f.here) text += std::string(f.name) + (f.used ? " " : " (not used) ");
  text += "\n\n";
  for (const auto& c : parts) {
    text += (c.on ? "[on]  " : "[off] ") + pad(c.name, -15) + (c.version.empty() ? "-" : c.version);
    if (!c.detail.empty()) text += " (" + c.detail + ")";
    text += ": " + c.use + "; " + c.licence + "\n";
  }
  text += off.empty() ? "\nEverything is on.\n" : "\nOff:\n";
  for (const auto& line : off) text += "  " + line + "\n";
  return text;
}

/// What was found, or with --camera what a camera shows, or what a log holds.
struct Doctor : Common {
  CameraOptions camera;
  std::string log;  ///< empty: none
  McapTopics topics;

  void declare(CLI::App& app) {
    app.add_option("LOG", log,
        "Log to look at, without estimating anything: streams, times, pictures; a folder, an MCAP file, or the folder "
        "of a ROS 2 bag");
    add_topics(app, topics);
    add_camera(app, camera, "Number of a camera to look through: rate, exposure, LEDs found");
    add_picture_options(app, camera);
    add_common(app, *this);
  }
  void check() const {
    camera.check();
    if (camera.number && !log.empty()) throw UsageError("LOG and --camera: one of them can be looked at");
  }
  Result run(Output&, Progress& progress) const {
    if (camera.number) return watch(camera, json);
    if (log.empty()) return report_of(json);
    if (examine_log == nullptr)
      throw Error("logs cannot be read here: the libraries that 'lumo doctor' lists as off are missing");
    return examine_log(log, topics, json, progress);
  }
};

}  // namespace

void add_doctor(CommandLine& line) { line.add<Doctor>("doctor", "What was found, which version, and what is off"); }

}  // namespace lumo::program
