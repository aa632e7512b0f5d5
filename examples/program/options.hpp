#pragma once

#include "program/mechanics.hpp"

#include "lumo/pipeline/lighting.hpp"
#include "lumo/core/error.hpp"
#include "lumo/fabrication/casting_options.hpp"

#include <array>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace lumo::program {

enum class Command { section, mesh, press, trace, evaluate, fabricate, optimize, campaign_run, campaign_status, campaign_verify, campaign_export, campaign_select, campaign_report, study_carrier, study_void, study_readings, study_solver, doctor,
                     lab_recontact, lab_cycle, lab_imaging, lab_force, lab_hand, decode, metrics, locate, force, hand, calibrate, convert, record };
enum class Ensemble { flat, curved };

inline constexpr int most_designs = 500;   ///< of a study

/// A complete request. Lengths in mm, angles in degrees, loads in N, as typed.
struct Options {
  Command command = Command::doctor;
  std::array<double, 5> theta_mm = {6.0, 6.0, 8.0, 5.0, 0.0};
  std::string material = "DS";
  bool json = false;
  bool quiet = false;
  int threads = 1;
  std::optional<std::string> out;        ///< directory for files
  double diameter_mm = 10.0;
  double angle_deg = 0.0;
  double y_mm = 0.0;
  std::vector<double> loads_N = {1.0, 2.0, 5.0, 10.0, 15.0};
  Mechanics mechanics;
  Ensemble ensemble = Ensemble::flat;
  std::string space;
  std::string transcript;
  std::string store;
  std::vector<std::string> stores;       ///< of a report: one or more; `store` is the first
  std::string page = "report.html";      ///< of a report
  double ray_error_percent = 100.0 * RayRefinement{}.tolerance;   ///< wanted standard error of J_obs by rays
  int evaluations = 160;
  int seed = 1;
  int seeds = 20;
  int designs = 40;
  bool all_contacts = false;             ///< of a study: `ensemble` was asked for
  std::string source = "default";
  std::string log;                       ///< a log's folder or MCAP file: to read, or (a folder) for the virtual lab to make
  std::string baseline;                  ///< the log to compare with
  std::string target;                    ///< of a conversion: a folder, or a file that ends in .mcap
  std::string compression = "zstd";      ///< of an MCAP file's chunks
  bool raw = false;                      ///< pixels instead of image files, in an MCAP file
  std::string image_topic, joint_topic, wrench_topic;   ///< of an MCAP file that has several
  std::string decoder = "nearest";
  std::string localizer = "bayes";
  double from_N = 5.0;                   ///< force from which a location counts
  double noise = 1.0;                    ///< of the virtual lab, times the rig's
  int joints = 1;                        ///< of the virtual lab's rig
  double stiffness = 1.0, lamps = 1.0;   ///< of the virtual lab's specimen, times the computed pad's
  bool coarse = false;                   ///< virtual lab, study of readings: coarser meshes, fewer rays
  std::optional<std::string> cache;      ///< folder of the virtual lab's computed responses
  std::optional<int> camera;             ///< number of a live one
  double exposure_ms = 1.0, gain = 64.0, rate_per_s = 30.0;   ///< of it
  std::array<int, 2> pixels = {640, 480};
  double seconds = 0.0;                  ///< to look through it; 0: until interrupted
  std::string can;                       ///< interface of the motors' bus; empty: no motors
  std::vector<int> motors = {1};         ///< on it, in the order of the joints
  std::array<double, 3> motor_ranges = {12.5, 65.0, 18.0};   ///< position [rad], velocity [rad/s], torque [N·m]
  CastingOptions casting;
};

/// The command line makes no sense.
class UsageError : public Error {
 public:
  using Error::Error;
};

/// Reads a command line. Empty when it asked for help or the version, which are then in `text`. Throws UsageError.
std::optional<Options> parse(std::span<char* const> arguments, std::string& text);

/// As typed: "press", or "campaign run".
std::string_view name(Command command);
inline std::string_view name(Ensemble ensemble) { return ensemble == Ensemble::flat ? "flat" : "curved"; }

/// The number that the whole of `s` spells, the same in every locale; nothing otherwise. May be NaN or infinite.
std::optional<double> parse_number(std::string_view s);

}  // namespace lumo::program
