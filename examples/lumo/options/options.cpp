#include "options/options.hpp"

#include "lumo/mechanics/scenario.hpp"
#include "lumo/morphology/design.hpp"
#include "computing/contacts.hpp"
#include "console/text.hpp"
#include "console/version.hpp"

#include <CLI/CLI.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <thread>

namespace lumo::program {

namespace {

/// Options as typed: the numbers are read below, strictly, not by the parser's own conversions.
struct Typed {
  std::string theta, material, threads, out, diameter, angle, y, loads, ensemble, evaluations, ray_error, seed, seeds, designs, source, decoder, localizer, from, noise, joints, stiffness, lamps, cache, camera, seconds, exposure, gain, rate, pixels, can, motors, motor_ranges, compression;
  std::string clearance, plate, wall, strip_width, strip_height, gate, vent;
  std::string mode, solver, element, size, sweeps, law, contact_stiffness, contact_points, friction;
  std::vector<std::string> stores;
  bool csv = false;
};

std::vector<std::string_view> split(std::string_view s, char separator = ',') {
  std::vector<std::string_view> fields;
  while (true) {
    const std::size_t comma = s.find(separator);
    fields.push_back(s.substr(0, comma));
    if (comma == std::string_view::npos) return fields;
    s.remove_prefix(comma + 1);
  }
}

std::string shortened(std::string s) { return s.size() > 80 ? s.substr(0, 77) + "..." : s; }

std::string in_quotes(std::string_view s) { return "'" + shortened(one_line(s)) + "'"; }

double number(const char* option, std::string_view typed, std::string_view unit) {
  const auto value = parse_number(typed);
  const std::string in_unit = unit.empty() ? "" : lumo::detail::text(" [", unit, "]");
  if (!value) throw UsageError(lumo::detail::text(option, " is ", in_quotes(typed), ", must be a number", in_unit));
  if (!std::isfinite(*value)) throw UsageError(lumo::detail::text(option, " is ", in_quotes(typed), ", must be a finite number", in_unit));
  return *value;
}

double in_range(const char* option, std::string_view typed, const Limits& limits, const char* unit) {
  const double value = number(option, typed, unit);
  if (value >= limits.low && value <= limits.high) return value;
  throw UsageError(lumo::detail::text(option, " is ", in_quotes(typed), ", must lie in [", limits.low, ", ", limits.high, "]", *unit ? " " : "", unit));
}

int whole_number(const char* option, std::string_view typed, int low, int high) {
  int value = 0;
  const auto [end, error] = std::from_chars(typed.data(), typed.data() + typed.size(), value);
  if (typed.empty() || error != std::errc{} || end != typed.data() + typed.size() || value < low || value > high)
    throw UsageError(lumo::detail::text(option, " is ", in_quotes(typed), ", must be a whole number from ", low, " to ", high));
  return value;
}

std::string one_of(const char* option, const std::string& typed, std::initializer_list<const char*> choices) {
  std::string list;
  for (const char* c : choices) {
    if (typed == c) return typed;
    list += (list.empty() ? "" : " or ") + std::string(c);
  }
  throw UsageError(lumo::detail::text(option, " is ", in_quotes(typed), ", must be ", list));
}

/// Not a number and infinity are read: they are values, and whether a value is feasible is the design space's to say.
std::array<double, 5> read_theta(std::string_view typed) {
  const auto fields = split(typed);
  const char* wanted = ", must be five numbers h_fp,h_ep,w_s,h_s,w_v [mm]";
  if (fields.size() != 5) throw UsageError(lumo::detail::text("--theta is ", in_quotes(typed), " (", fields.size(), fields.size() == 1 ? " field)" : " fields)", wanted));
  std::array<double, 5> theta{};
  for (std::size_t i = 0; i < 5; ++i) {
    const auto value = parse_number(fields[i]);
    if (!value) throw UsageError(lumo::detail::text("--theta is ", in_quotes(typed), " (", in_quotes(fields[i]), " is not a number)", wanted));
    theta[i] = *value + 0.0;   // no −0
  }
  return FingerDesign::from(theta).values();   // on the lattice in every bit, where it is but for rounding
}

/// Loads, in the order in which they are met.
std::vector<double> read_loads(std::string_view typed) {
  std::vector<double> loads;
  const auto fields = split(typed);
  for (std::size_t i = 0; i < fields.size(); ++i) {
    const auto refuse = [&](const std::string& why) {
      throw UsageError(lumo::detail::text("--loads is ", in_quotes(typed), " (field ", i + 1, " of ", fields.size(), ", ", in_quotes(fields[i]), ", ", why));
    };
    const auto load = parse_number(fields[i]);
    if (!load) refuse("is not a number), must be increasing loads [N]");
    if (!(*load >= loads_admitted_N.low && *load <= loads_admitted_N.high)) refuse(lumo::detail::text("is out of range), each must lie in [", loads_admitted_N.low, ", ", loads_admitted_N.high, "] N"));
    if (!loads.empty() && *load <= loads.back()) refuse(lumo::detail::text("follows ", lumo::detail::exact(loads.back()), " N), loads must increase"));
    loads.push_back(*load);
  }
  return loads;
}

/// How to compute presses. The mode decides solver, element and law; what else it says may be changed.
Mechanics read_mechanics(const Typed& t) {
  const bool paper = !t.mode.empty() && one_of("--mode", t.mode, {"default", "paper"}) == "paper";
  Mechanics m = paper ? paper_mechanics() : Mechanics{};
  const auto choose = [&](const char* option, const std::string& typed, const char* first, auto first_value, const char* second, auto second_value, auto& into) {
    if (typed.empty()) return;
    const auto value = one_of(option, typed, {first, second}) == first ? first_value : second_value;
    if (paper && value != into) throw UsageError(lumo::detail::text(option, " ", typed, " contradicts --mode paper, which is ", name(into)));
    into = value;
  };
  using enum Mechanics::Solver;
  using enum Mechanics::Element;
  using enum Mechanics::Law;
  choose("--solver", t.solver, "quasi_static", quasi_static, "vbd", vbd, m.solver);
  choose("--element", t.element, "linear", linear, "quadratic", quadratic, m.element);
  choose("--law", t.law, "neo_hookean", neo_hookean, "newton", newton, m.law);
  if (!t.size.empty()) m.size_mm = in_range("--size", t.size, {0.2, 10.0}, "mm");
  if (!t.sweeps.empty()) m.sweeps = whole_number("--sweeps", t.sweeps, 1, 1000000);
  if (!t.sweeps.empty() && m.solver != vbd) throw UsageError("--sweeps is an option of --solver vbd");
  if (!t.contact_stiffness.empty()) m.contact_stiffness_N_per_m3 = in_range("--contact-stiffness", t.contact_stiffness, {1e6, 1e15}, "N/m3");
  if (!t.contact_points.empty())
    m.points = one_of("--contact-points", t.contact_points, {"surface", "vertex"}) == "vertex" ? Mechanics::Points::vertex : Mechanics::Points::surface;
  if (!t.friction.empty()) m.friction = in_range("--friction", t.friction, {0.0, 10.0}, "");
  return m;
}

/// Sizes of the parts to print; in m, as the library wants them.
CastingOptions read_casting(const Typed& t) {
  namespace limits = casting_limits;
  CastingOptions o;
  const auto length = [](const char* option, const std::string& typed, const Limits& admitted_mm, double& into) {
    if (!typed.empty()) into = 1e-3 * in_range(option, typed, admitted_mm, "mm");
  };
  length("--clearance", t.clearance, limits::clearance_mm, o.clearance);
  length("--plate", t.plate, limits::plate_mm, o.plate);
  length("--wall", t.wall, limits::wall_mm, o.wall);
  length("--strip-width", t.strip_width, limits::strip_width_mm, o.strip_width);
  length("--strip-height", t.strip_height, limits::strip_height_mm, o.strip_height);
  length("--gate", t.gate, limits::gate_mm, o.gate_diameter);
  length("--vent", t.vent, limits::vent_mm, o.vent_diameter);
  return o;
}

bool of_log(Command c) { return c == Command::decode || c == Command::metrics || c == Command::locate || c == Command::force || c == Command::hand || c == Command::calibrate || c == Command::convert || c == Command::record; }

/// Fields between `separator`s.
template <std::size_t N>
std::array<double, N> read_numbers(const char* option, std::string_view typed, char separator, const Limits& limits, const char* unit, const char* wanted) {
  std::array<double, N> values{};
  const auto fields = split(typed, separator);
  if (fields.size() != N) throw UsageError(lumo::detail::text(option, " is ", in_quotes(typed), ", must be ", wanted));
  for (std::size_t i = 0; i < N; ++i) values[i] = in_range(option, fields[i], limits, unit);
  return values;
}

/// The live camera and the motors.
void read_devices(Options& o, const Typed& t) {
  const bool streamed = o.command == Command::locate || o.command == Command::force || o.command == Command::hand;
  if (!t.camera.empty()) o.camera = whole_number("--camera", t.camera, 0, 63);
  for (const auto& [option, typed] : {std::pair{"--seconds", &t.seconds}, {"--exposure", &t.exposure}, {"--gain", &t.gain}, {"--rate", &t.rate}, {"--pixels", &t.pixels}, {"--can", &t.can}})
    if (!typed->empty() && !o.camera) throw UsageError(lumo::detail::text(option, " is of a live camera, which --camera chooses"));
  for (const auto& [option, typed] : {std::pair{"--motors", &t.motors}, {"--motor-ranges", &t.motor_ranges}})
    if (!typed->empty() && t.can.empty()) throw UsageError(lumo::detail::text(option, " is of motors, whose bus --can chooses"));
  if (!t.seconds.empty()) o.seconds = in_range("--seconds", t.seconds, {1.0, 1e6}, "s");
  if (!t.exposure.empty()) o.exposure_ms = in_range("--exposure", t.exposure, {0.1, 200.0}, "ms");
  if (!t.gain.empty()) o.gain = in_range("--gain", t.gain, {0.0, 1e9}, "");
  if (!t.rate.empty()) o.rate_per_s = in_range("--rate", t.rate, {5.0, 1000.0}, "1/s");
  if (!t.pixels.empty()) {
    const auto size = read_numbers<2>("--pixels", t.pixels, 'x', {16.0, 10000.0}, "px", "a width and a height such as 640x480");
    o.pixels = {int(size[0]), int(size[1])};
    if (size[0] != o.pixels[0] || size[1] != o.pixels[1]) throw UsageError("--pixels is " + in_quotes(t.pixels) + ", must be whole numbers");
  }
  if (o.exposure_ms * o.rate_per_s > 1000.0) throw UsageError(lumo::detail::text("--exposure is ", o.exposure_ms, " ms, which ", o.rate_per_s, " pictures a second (--rate) do not leave"));
  o.can = t.can;
  if (!t.motors.empty()) {
    o.motors.clear();
    for (const std::string_view field : split(t.motors)) {
      o.motors.push_back(whole_number("--motors", field, 0, 255));
      if (std::count(o.motors.begin(), o.motors.end(), o.motors.back()) > 1 || o.motors.size() > 8) throw UsageError("--motors is " + in_quotes(t.motors) + ", must be at most 8 different numbers");
    }
  }
  if (!t.motor_ranges.empty()) o.motor_ranges = read_numbers<3>("--motor-ranges", t.motor_ranges, ',', {1e-3, 1e4}, "", "three numbers: position [rad], velocity [rad/s], torque [N·m]");
  if (!o.camera) return;
  if (streamed && !t.out.empty()) throw UsageError("--out keeps what is found in a log; a live camera's lines go to standard output (lumo record makes a log)");
  if (!t.from.empty()) throw UsageError("--from chooses frames by their true force, which a live camera does not tell");
  if ((o.command == Command::force || o.command == Command::hand) && o.can.empty()) throw UsageError(lumo::detail::text("--can is missing: lumo ", name(o.command), " needs the motors' samples beside a live camera's pictures"));
  if (o.command != Command::locate && o.command != Command::record && o.command != Command::doctor && o.log.empty())
    throw UsageError(lumo::detail::text("the log is missing (see lumo ", name(o.command), " --help)"));
  if ((o.command == Command::decode || o.command == Command::metrics) && t.out.empty()) throw UsageError("--out is missing: what the camera sees is recorded there");
}

void read(Options& o, const Typed& t) {
  if (o.command == Command::optimize && o.space.empty()) throw UsageError("--space is missing (see lumo optimize --help)");
  o.stores = t.stores;
  if (!t.stores.empty()) o.store = t.stores.front();
  if (t.stores.size() > 1 && o.command != Command::campaign_report) throw UsageError(lumo::detail::text("--store is given ", t.stores.size(), " times, must be given once"));
  if (name(o.command).starts_with("campaign") && o.store.empty()) throw UsageError(lumo::detail::text("--store is missing (see lumo ", name(o.command), " --help)"));
  if (!t.evaluations.empty()) o.evaluations = whole_number("--evaluations", t.evaluations, 1, 100000);
  if (!t.ray_error.empty()) o.ray_error_percent = in_range("--ray-error", t.ray_error, {0.1, 100.0}, "%");
  if (!t.seed.empty()) o.seed = whole_number("--seed", t.seed, 0, std::numeric_limits<int>::max());
  if (!t.seeds.empty()) o.seeds = whole_number("--seeds", t.seeds, 1, 1000);
  if (o.command == Command::study_readings) o.designs = 30;
  if (!t.designs.empty()) o.designs = whole_number("--designs", t.designs, 1, most_designs);
  if (!t.source.empty()) o.source = one_of("--source", t.source, {"default", "paper"});
  if (!t.theta.empty()) o.theta_mm = read_theta(t.theta);
  if (!t.decoder.empty()) o.decoder = one_of("--decoder", t.decoder, {"nearest", "linear", "gp", "bayes"});
  if (!t.localizer.empty()) o.localizer = one_of("--localizer", t.localizer, {"bayes", "peak"});
  if (!t.from.empty()) o.from_N = number("--from", t.from, "N");
  if (!t.joints.empty()) o.joints = whole_number("--joints", t.joints, 1, 2);
  if (!t.stiffness.empty()) o.stiffness = in_range("--stiffness", t.stiffness, {0.8, 2.0}, "");
  if (o.stiffness < 1.0 && o.command == Command::lab_force) throw UsageError(lumo::detail::text("--stiffness is ", o.stiffness, ", lab force goes to 20 N, which a softer pad than the computed one cannot be given"));
  if (!t.lamps.empty()) o.lamps = in_range("--lamps", t.lamps, {0.1, 3.0}, "");
  if (!t.noise.empty()) o.noise = in_range("--noise", t.noise, {0.0, 100.0}, "");
  if (!t.cache.empty()) o.cache = t.cache;
  read_devices(o, t);
  if (o.command == Command::record && !o.camera) throw UsageError("--camera is missing (see lumo record --help)");
  if (o.command == Command::record && t.out.empty()) throw UsageError("--out is missing (see lumo record --help)");
  const std::string_view command = name(o.command);
  if (command.starts_with("lab ")) {
    if (t.material.empty()) o.material = "Sol";
    if (t.out.empty()) throw UsageError(lumo::detail::text("--out is missing (see lumo ", command, " --help)"));
    o.log = t.out;
  }
  if (of_log(o.command) && o.log.empty() && !o.camera) throw UsageError(lumo::detail::text("the log is missing (see lumo ", command, " --help)"));
  if (o.command == Command::convert && o.target.empty()) throw UsageError("the folder or file to write is missing (see lumo convert --help)");
  if (!t.compression.empty()) o.compression = one_of("--compression", t.compression, {"zstd", "lz4", "none"});
  if (!t.material.empty()) o.material = one_of("--material", t.material, {"DS", "Sol"});
  o.all_contacts = !t.ensemble.empty();
  if (!t.ensemble.empty()) o.ensemble = one_of("--ensemble", t.ensemble, {"flat", "curved"}) == "flat" ? Ensemble::flat : Ensemble::curved;
  o.threads = t.threads.empty() ? std::clamp(int(std::thread::hardware_concurrency()), 1, 1024) : whole_number("--threads", t.threads, 1, 1024);
  if (o.command == Command::campaign_report && !t.out.empty()) o.page = t.out;
  else if (!command.starts_with("lab ") && !t.out.empty()) o.out = t.out;
  // The library's own limits, in the words and units of who typed the values.
  if (!t.diameter.empty()) o.diameter_mm = in_range("--diameter", t.diameter, sphere_diameters_mm, "mm");
  if (!t.angle.empty()) o.angle_deg = in_range("--angle", t.angle, approach_angles_deg, "deg");
  if (!t.y.empty()) o.y_mm = in_range("--y", t.y, contact_places_mm, "mm");
  if (!t.loads.empty()) o.loads_N = read_loads(t.loads);
  o.mechanics = read_mechanics(t);
  o.casting = read_casting(t);
  if (o.command == Command::fabricate && !o.out) throw UsageError("--out is missing (see lumo fabricate --help)");
}

/// `into` is a string, or a list of them for an option that may be repeated.
template <class T>
CLI::Option* text_option(CLI::App* app, const std::string& flag, T& into, const std::string& help, const std::string& kind) {
  auto* option = app->add_option(flag, into, help)->type_name(kind)->allow_extra_args(false);
  // An empty value would be taken for an absent one.
  option->each([flag](const std::string& value) {
    if (value.empty()) throw UsageError(flag + " is '', must have a value");
    if (value.starts_with("--")) throw UsageError(flag + " needs a value, found " + in_quotes(value));
  });
  return option;
}

/// The last command that was typed, or the program itself.
const CLI::App* innermost(const CLI::App& app) {
  const auto chosen = app.get_subcommands();
  return chosen.empty() ? &app : innermost(*chosen.front());
}

/// As typed: "lumo campaign run".
std::string full_name(const CLI::App& app) { return app.get_parent() == nullptr ? app.get_name() : full_name(*app.get_parent()) + " " + app.get_name(); }

/// What the parser objects to. It tells the option in its own sentences only, so that the options and the words are looked at again.
std::string objection(const CLI::App& command, std::span<char* const> arguments, const CLI::ParseError& e) {
  if (dynamic_cast<const CLI::ExcludesError*>(&e)) {
    std::string both;
    for (const CLI::Option* o : command.get_options([](const CLI::Option* o) { return o->count() > 0 && !o->get_excludes().empty(); })) both += (both.empty() ? "" : " and ") + o->get_name();
    return both + " exclude each other";
  }
  for (const CLI::Option* o : command.get_options())
    if (o->get_expected_max() == 1 && o->count() > 1) return lumo::detail::text(o->get_name(), " is given ", o->count(), " times, must be given once");
  for (const std::string_view word : arguments.subspan(1)) {
    const CLI::Option* const flag = word.starts_with('-') ? command.get_option_no_throw(std::string(word.substr(0, word.find('=')))) : nullptr;
    if (flag != nullptr && flag->get_expected_max() == 0 && word.find('=') != std::string_view::npos) return flag->get_name() + " takes no value";
  }
  const std::string_view last = arguments.back();
  if (const CLI::Option* const o = command.get_option_no_throw(std::string(last.substr(0, last.find('='))))) return o->get_name() + " has no value";
  return shortened(one_line(e.what()));
}

}  // namespace

std::optional<double> parse_number(std::string_view s) {
  if (s.starts_with('+') && s.size() > 1 && s[1] != '-' && s[1] != '+') s.remove_prefix(1);
  double value = 0.0;
  const auto [end, error] = std::from_chars(s.data(), s.data() + s.size(), value);
  if (s.empty() || end != s.data() + s.size()) return std::nullopt;
  if (error == std::errc::result_out_of_range) return std::strtod(std::string(s).c_str(), nullptr);  // 0 or infinite; the locale is always "C" here
  if (error != std::errc{}) return std::nullopt;
  return value;
}

std::string_view name(Command command) {
  static constexpr std::array<std::string_view, 31> names = {"section",         "mesh",            "press",           "trace",           "evaluate",        "fabricate",
                                                             "optimize",        "campaign run",    "campaign status", "campaign verify", "campaign export",
                                                             "campaign select", "campaign report", "study carrier",   "study void",      "study readings",
                                                             "study solver",    "doctor",          "lab recontact",   "lab cycle",       "lab imaging",
                                                             "lab force",       "lab hand",        "decode",          "metrics",         "locate",
                                                             "force",           "hand",            "calibrate",       "convert",         "record"};
  return names[std::size_t(command)];
}

std::optional<Options> parse(std::span<char* const> arguments, std::string& text) {
  Options o;
  Typed t;
  CLI::App app("Mechanics, optics and design of soft lit finger pads.", "lumo");
  app.set_version_flag("--version", lumo::detail::text("lumo ", version, ", results ", results_version));
  app.require_subcommand(0, 1);
  app.footer("Exit codes: 0 ok, 1 a fault of lumo itself, 2 usage, 3 infeasible design, 4 numerical failure, 5 bad file, 130 interrupted.\n"
             "Results go to standard output, progress to standard error.");

  const auto strict = [](CLI::App* c) {
    c->allow_extras();   // unknown words are reported below, with the nearest known one
    c->prefix_command(false);
  };
  const auto common = [&](CLI::App* c) {
    c->add_flag("--json", o.json, "Print the result as JSON")->disable_flag_override();
    c->add_flag("--quiet", o.quiet, "No progress on standard error")->disable_flag_override();
    strict(c);
  };
  const auto material = [&](CLI::App* c) { text_option(c, "--material", t.material, "Silicone: DS (Dragon Skin, default) or Sol (Solaris)", "NAME"); };
  const auto ensemble = [&](CLI::App* c) { text_option(c, "--ensemble", t.ensemble, "Approach angles: flat (0°, default) or curved (−30° … 30°)", "NAME"); };
  const auto ray_error = [&](CLI::App* c) {
    const std::string help = lumo::detail::text("Standard error of J_obs up to which rays are added [%], default ", o.ray_error_percent, "; at most ", rays_up_to(RayRefinement{}.rounds), " times the first ones");
    text_option(c, "--ray-error", t.ray_error, help, "N");
  };
  const auto threads = [&](CLI::App* c) { text_option(c, "--threads", t.threads, "Threads, 1 to 1024, default: all", "N"); };
  const auto theta = [&](CLI::App* c) { text_option(c, "--theta", t.theta, "Design h_fp,h_ep,w_s,h_s,w_v [mm], default 6,6,8,5,0", "N,N,N,N,N"); };
  const auto design = [&](CLI::App* c) {
    theta(c);
    material(c);
    threads(c);
    text_option(c, "--out", t.out, "Directory for files; made when there is something to write", "DIR");
    common(c);
  };
  const auto scenario = [&](CLI::App* c) {
    text_option(c, "--diameter", t.diameter, "Sphere's diameter [mm], default 10", "N");
    text_option(c, "--angle", t.angle, "Approach angle from the pad normal [deg], default 0", "N");
    text_option(c, "--y", t.y, "Place along the finger [mm], default 0", "N");
    text_option(c, "--loads", t.loads, "Increasing loads [N], default 1,2,5,10,15", "N,N,...");
  };
  const auto contact = [&](CLI::App* c) {
    text_option(c, "--law", t.law, "Neo-Hookean law: neo_hookean (default) or newton (Newton's, without a logarithm)", "NAME");
    text_option(c, "--contact-stiffness", t.contact_stiffness, "Of the contact penalty [N/m3], default 1e11", "N");
    text_option(c, "--contact-points", t.contact_points, "Contact all over the surface (default) or at each vertex", "NAME");
    text_option(c, "--friction", t.friction, "Coulomb's coefficient of contact, default 0, in paper mode 0.5", "N");
  };
  const auto mode = [&](CLI::App* c) {
    text_option(c, "--mode", t.mode, "default, or paper: 1 mm linear tetrahedra, vertex block descent in time, Newton's law, friction; held states are scored. A press of five loads takes about 1.5 min of one processor", "NAME");
  };
  const auto mechanics = [&](CLI::App* c) {
    mode(c);
    text_option(c, "--solver", t.solver, "quasi_static (default) or vbd: vertex block descent, 5 mm/s to each load, 1 s hold", "NAME");
    text_option(c, "--element", t.element, "Tetrahedra: quadratic (default) or linear, which lock", "NAME");
    text_option(c, "--size", t.size, "Of all edges [mm], default: graded, fine at the contact; in paper mode 1", "N");
    text_option(c, "--sweeps", t.sweeps, "Of vbd, per 0.01 s step, default 10", "N");
    contact(c);
  };
  const auto fabrication = [&](CLI::App* c) {
    theta(c);
    material(c);
    text_option(c, "--out", t.out, "Directory for the files; made when it is not there", "DIR");
    const CastingOptions normal;
    const auto length = [&](const char* option, std::string& typed, const char* what, double normal_m) {
      text_option(c, option, typed, lumo::detail::text(what, " [mm], default ", short_number(1e3 * normal_m)), "N");
    };
    length("--clearance", t.clearance, "On each side between printed parts", normal.clearance);
    length("--plate", t.plate, "Thickness of the carrier's plate", normal.plate);
    length("--wall", t.wall, "Of the mould about the pad", normal.wall);
    length("--strip-width", t.strip_width, "Width of the LED strip", normal.strip_width);
    length("--strip-height", t.strip_height, "Height of the LED strip with its LEDs", normal.strip_height);
    length("--gate", t.gate, "Diameter of the gate at the pad", normal.gate_diameter);
    length("--vent", t.vent, "Diameter of the vents at the pad", normal.vent_diameter);
    common(c);
  };
  const auto optimization = [&](CLI::App* c) {
    text_option(c, "--space", o.space, "Variables, constraints, objectives and budget (JSON)", "FILE");
    text_option(c, "--transcript", o.transcript, "Keeps all that is asked and told; continues from it where it exists", "FILE");
    strict(c);
  };
  const auto campaign = [&](CLI::App* c, Command command) {
    text_option(c, "--store", t.stores, command == Command::campaign_report ? "File that keeps a campaign; several make one figure" : "File that keeps the campaign", "FILE");
    if (command == Command::campaign_export) {
      c->add_flag("--json", o.json, "Everything, as JSON")->disable_flag_override();
      c->add_flag("--csv", t.csv, "A table (default)")->disable_flag_override()->excludes("--json");
      strict(c);
      return;
    }
    common(c);
    if (command == Command::campaign_select) text_option(c, "--seeds", t.seeds, "Optimisers that are run on a model of the results, default 20", "N");
    if (command == Command::campaign_report) text_option(c, "--out", t.out, "The page, default report.html", "FILE");
    if (command == Command::campaign_select || command == Command::campaign_report) threads(c);
    if (command != Command::campaign_run) return;
    material(c);
    ensemble(c);
    mode(c);
    ray_error(c);
    text_option(c, "--evaluations", t.evaluations, "Successful evaluations to reach, default 160", "N");
    text_option(c, "--seed", t.seed, "Of the optimiser, default 1", "N");
    text_option(c, "--source", t.source, "Where candidates come from: default (with neighbours of the front) or paper (256 fresh ones)", "NAME");
    threads(c);
  };
  const auto study = [&](CLI::App* c, Command command) {
    const bool readings = command == Command::study_readings;
    text_option(c, "--store", t.stores, "File that keeps the study; it continues if the file exists", "FILE");
    text_option(c, "--designs", t.designs, readings ? "Seeded designs to compare beside the five references, default 30" : "Feasible designs to compare, default 40", "N");
    text_option(c, "--seed", t.seed, "Of the designs, default 1", "N");
    if (readings) c->add_flag("--coarse", o.coarse, "Edges 1.4 times as long, J_obs by rays to 4 % instead of 1.5: half of the time")->disable_flag_override();
    material(c);
    text_option(c, "--ensemble", t.ensemble, readings ? "All contacts of flat or curved, default: 10 and 30 mm at y = 0 (0°, 30°) and 5.5 mm (0°)" : "All contacts of flat or curved, default: 10 and 30 mm at y = 0, 0°", "NAME");
    text_option(c, "--out", t.out, "Directory for files; made when there is something to write", "DIR");
    threads(c);
    common(c);
  };
  const auto lab = [&](CLI::App* c, Command command) {
    theta(c);
    text_option(c, "--material", t.material, "Silicone: Sol (Solaris, default) or DS (Dragon Skin)", "NAME");
    text_option(c, "--seed", t.seed, "Of everything random, default 1", "N");
    text_option(c, "--noise", t.noise, "Times the rig's noises, default 1", "N");
    if (command == Command::lab_force) text_option(c, "--joints", t.joints, "Of the finger: 1 (default), or 2, whose torques alone tell the place, too", "N");
    text_option(c, "--stiffness", t.stiffness, "Of this specimen's silicone, times the nominal one, 0.8 to 2, default 1", "N");
    text_option(c, "--lamps", t.lamps, "Power of this specimen's LEDs, times the nominal one, 0.1 to 3, default 1", "N");
    text_option(c, "--cache", t.cache, "Folder that keeps computed responses, default: beside DIR", "DIR");
    c->add_flag("--coarse", o.coarse, "Coarse mesh, few places, few rays: seconds instead of minutes, for trying out")->disable_flag_override();
    text_option(c, "--out", t.out, "Folder of the log; must not be there, or be empty", "DIR");
    threads(c);
    common(c);
  };
  const auto picture_options = [&](CLI::App* c) {
    text_option(c, "--exposure", t.exposure, "Of the camera [ms], default 1", "N");
    text_option(c, "--gain", t.gain, "Of the camera, its driver's number, default 64", "N");
    text_option(c, "--rate", t.rate, "Pictures a second, default 30", "N");
    text_option(c, "--pixels", t.pixels, "Size of its pictures, default 640x480", "WxH");
  };
  const auto devices = [&](CLI::App* c, Command command) {
    const char* what = command == Command::locate  ? "Number of a live camera instead of a log's pictures; the first second must show the unloaded finger. LOG, if given, describes the finger"
                       : command == Command::force ? "Number of a live camera instead of a log's pictures; the first second must show the unloaded finger. LOG tells of the joints, by its part without contact, and describes the finger"
                       : command == Command::hand  ? "Number of a live camera instead of a log's pictures. LOG shows the unloaded hand, and describes it"
                       : command == Command::record ? "Number of the camera"
                                                   : "Number of a live camera: LOG's plan (its segments) is carried out and recorded in DIR/recording, then evaluated";
    text_option(c, "--camera", t.camera, what, "N");
    text_option(c, "--seconds", t.seconds, command == Command::locate || command == Command::force || command == Command::hand ? "How long to look through the camera [s], default: until interrupted" : command == Command::record ? "How long to record [s], default: to the plan's end, or until interrupted where there is none" : "How long to record [s], default: to the plan's end", "N");
    picture_options(c);
    if (command == Command::locate) return;
    text_option(c, "--can", t.can, "Interface of the bus on which motors answer their controller (mini-cheetah protocol); lumo listens and commands nothing", "NAME");
    text_option(c, "--motors", t.motors, "Their CAN identifiers, in the order of the joints, default 1", "LIST");
    text_option(c, "--motor-ranges", t.motor_ranges, "Ends of the protocol's ranges: position [rad], velocity [rad/s], torque [N·m], default 12.5,65,18", "LIST");
  };
  const auto of_a_log = [&](CLI::App* c, Command command) {
    c->add_option("LOG", o.log, command == Command::record ? "Folder of a log, or an MCAP file, whose session is the plan (docs/log_format.md)" : "Folder of the log, or an MCAP file (docs/log_format.md)");
    if (command == Command::record) {
      devices(c, command);
      text_option(c, "--out", t.out, "Folder of the new log; must not be there, or be empty", "DIR");
      common(c);
      return;
    }
    if (command == Command::decode) text_option(c, "--decoder", t.decoder, "nearest (template, default), linear, gp (Gaussian process) or bayes (a filter over all loads from 2 N)", "NAME");
    if (command == Command::metrics) text_option(c, "--baseline", o.baseline, "Log of the pad to compare with, for the gain", "LOG");
    if (command == Command::locate || command == Command::force) text_option(c, "--localizer", t.localizer, "bayes (default) or peak (the paper's)", "NAME");
    if (command == Command::locate) text_option(c, "--from", t.from, "Least true force of the frames that count [N], default 5", "N");
    if (command == Command::convert) {
      c->add_option("OUT", o.target, "MCAP file to write, if it ends in .mcap, else a folder; must not be there, or be an empty folder");
      text_option(c, "--compression", t.compression, "Of an MCAP file: zstd (default), lz4 or none", "NAME");
      c->add_flag("--raw", o.raw, "Pixels in an MCAP file (sensor_msgs/Image), not PNG or JPEG (CompressedImage)")->disable_flag_override();
      text_option(c, "--image-topic", o.image_topic, "Topic of the pictures, where an MCAP file has several", "TOPIC");
      text_option(c, "--joint-topic", o.joint_topic, "Topic of the joint states, where it has several", "TOPIC");
      text_option(c, "--wrench-topic", o.wrench_topic, "Topic of the wrenches, where it has several", "TOPIC");
      common(c);
      return;
    }
    if (command == Command::calibrate) {
      text_option(c, "--cache", t.cache, "Folder that keeps computed responses, default: beside LOG", "DIR");
      c->add_flag("--coarse", o.coarse, "Nominal pad on a coarse mesh")->disable_flag_override();
      threads(c);
      common(c);
      return;
    }
    devices(c, command);
    text_option(c, "--out", t.out, "Directory for files; made when there is something to write", "DIR");
    common(c);
  };
  struct Entry {
    Command command;
    const char* help;
  };
  for (const Entry& e : {Entry{Command::section, "Draw the cross-section with its dimensions (SVG)"}, Entry{Command::mesh, "Make the tetrahedral mesh (VTU with --out)"},
                         Entry{Command::press, "Press a sphere on the pad: force, depth, contact"}, Entry{Command::trace, "Press, then trace light: response of each region"},
                         Entry{Command::evaluate, "Both objectives of a design over an ensemble"}, Entry{Command::fabricate, "Files to print and cast the finger: carrier, mould, drawings"},
                         Entry{Command::optimize, "Optimise any objectives by ask and tell: JSON lines on standard output and input"},
                         Entry{Command::decode, "Place from regional responses, one repetition left out"},
                         Entry{Command::metrics, "How far apart places are, and how well contacts repeat"}, Entry{Command::locate, "Where the finger was touched, frame by frame"},
                         Entry{Command::force, "How hard, from joint torque at the place seen, with its baselines"}, Entry{Command::hand, "Contacts on all links of a hand at once"}, Entry{Command::record, "Record a live camera and motors as a log, by a plan"}, Entry{Command::calibrate, "One specimen's stiffness, lamps and camera gain from one press and a dark view"},
                         Entry{Command::convert, "A log's folder as an MCAP file, as ROS 2 has them, or the other way round"},
                         Entry{Command::doctor, "What was found, which version, and what is off"}}) {
    CLI::App* c = app.add_subcommand(std::string(name(e.command)), e.help);
    if (e.command == Command::doctor) text_option(c, "--camera", t.camera, "Number of a camera to look through: rate, exposure, LEDs found", "N"), picture_options(c), common(c);
    else if (of_log(e.command)) of_a_log(c, e.command);
    else if (e.command == Command::optimize) optimization(c);
    else if (e.command == Command::fabricate) fabrication(c);
    else design(c);
    if (e.command == Command::press || e.command == Command::trace) scenario(c);
    if (e.command == Command::evaluate) ensemble(c), ray_error(c);
    if (e.command == Command::press || e.command == Command::trace)
      c->footer("press.pvd in DIR lists the states of the last run. A press_N.vtu of an earlier run with more loads stays where it is: nothing is removed.");
    if (e.command == Command::press || e.command == Command::trace || e.command == Command::evaluate) mechanics(c);
    c->parse_complete_callback([&o, command = e.command] { o.command = command; });
  }
  const auto group = [&](const char* title, const char* help) {
    CLI::App* g = app.add_subcommand(title, help);
    g->require_subcommand(0, 1);
    g->allow_extras();
    return g;
  };
  CLI::App* const campaigns = group("campaign", "Search for the best design; the store continues after any interruption");
  CLI::App* const labs = group("lab", "Logs of a virtual rig: computed mechanics and light, a camera, a motor and their errors");
  CLI::App* const studies = group("study", "What a feature of the design is worth, over many designs");
  for (const Entry& e : {Entry{Command::campaign_run, "Evaluate until the store holds enough; continues if the file exists"}, Entry{Command::campaign_status, "What a store holds"},
                         Entry{Command::campaign_verify, "Check every entry of a store; names the first bad one"}, Entry{Command::campaign_export, "All evaluations, to standard output"},
                         Entry{Command::campaign_select, "The balanced choice, how stable it is, and its progressive-constraint gain"},
                         Entry{Command::campaign_report, "One HTML page with charts and the chosen pad in 3-D"},
                         Entry{Command::lab_recontact, "Six places, five re-contacts each, up to 15 N"},
                         Entry{Command::lab_cycle, "Cycles within contact at three places"}, Entry{Command::lab_imaging, "Other camera places, other room light, LEDs off"},
                         Entry{Command::lab_force, "Six sequences up to 20 N, with joint torque"}, Entry{Command::lab_hand, "Grasps of two fingers with two links each, seen from beside"},
                         Entry{Command::study_carrier, "Each design against pads without a carrier in them"}, Entry{Command::study_void, "Each design against itself without lateral voids"},
                         Entry{Command::study_readings, "How far results move with each reading of what the paper leaves open (some 10 min a design on two cores)"},
                         Entry{Command::study_solver, "One press by the paper's solver and by equilibrium: depth, residual, distance (1 mm, five loads: some 20 min of one processor)"}}) {
    const std::string_view whole = name(e.command);
    CLI::App* const g = whole.starts_with("campaign") ? campaigns : whole.starts_with("lab") ? labs : studies;
    CLI::App* c = g->add_subcommand(std::string(whole.substr(g->get_name().size() + 1)), e.help);
    if (g == campaigns) campaign(c, e.command);
    else if (g == labs) lab(c, e.command);
    else if (e.command == Command::study_solver) {
      design(c);
      scenario(c);
      text_option(c, "--size", t.size, "Of all edges of the linear mesh [mm], default 1", "N");
      contact(c);
    }
    else study(c, e.command);
    c->parse_complete_callback([&o, command = e.command] { o.command = command; });
  }
  app.allow_extras();

  std::vector<std::string> words;
  for (std::size_t i = arguments.size(); i-- > 1;) words.emplace_back(arguments[i]);   // CLI11 wants them reversed
  try {
    app.parse(words);
  } catch (const CLI::CallForHelp&) {
    const CLI::App* chosen = innermost(app);
    text = chosen == &app ? app.help() : chosen->help(full_name(*chosen->get_parent()), CLI::AppFormatMode::Normal);
    return std::nullopt;
  } catch (const CLI::CallForVersion& e) {
    text = std::string(e.what()) + "\n";
    return std::nullopt;
  } catch (const CLI::ParseError& e) {
    throw UsageError(objection(*innermost(app), arguments, e) + " (see " + full_name(*innermost(app)) + " --help)");
  } catch (const UsageError& e) {
    throw UsageError(std::string(e.what()) + " (see " + full_name(*innermost(app)) + " --help)");
  }
  const CLI::App* chosen = innermost(app);
  const bool of_group = chosen == campaigns || chosen == studies || chosen == labs, complete = chosen != &app && !of_group;
  const std::string help = full_name(*chosen) + " --help";
  const auto extras = app.remaining(true);
  if (!extras.empty()) {
    const std::string& word = extras.front();
    const bool option = word.starts_with('-') && word.size() > 1;
    const bool after_end = std::any_of(arguments.begin(), arguments.end(), [](const char* a) { return std::string_view(a) == "--"; });
    const bool misplaced = option && complete && !after_end && chosen->get_option_no_throw(word) != nullptr;
    if (misplaced) throw UsageError("option " + in_quotes(word) + " must follow the command (see " + help + ")");
    throw UsageError((option ? "unknown option " : complete ? "unexpected argument " : "unknown command ") + in_quotes(word) + " (see " + help + ")");
  }
  if (!complete) throw UsageError("no command given (see " + help + ")");
  read(o, t);
  return o;
}

}  // namespace lumo::program
