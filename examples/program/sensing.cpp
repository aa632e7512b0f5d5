#include "program/sensing.hpp"

#include "lumo/sense/decode/gaussian_process_decoder.hpp"
#include "lumo/sense/decode/constraint_gain.hpp"
#include "lumo/sense/decode/cross_validation.hpp"
#include "lumo/sense/decode/bayes_decoder.hpp"
#include "lumo/sense/decode/linear_decoder.hpp"
#include "lumo/sense/decode/nearest_template.hpp"
#include "lumo/sense/recording/normal_force.hpp"
#include "lumo/sense/decode/segment_responses.hpp"
#include "program/chart.hpp"
#include "program/convert.hpp"
#include "program/hand.hpp"
#include "program/json.hpp"
#include "program/lab.hpp"
#include "program/live.hpp"
#include "program/localizers.hpp"
#include "program/sensing_log.hpp"
#include "program/sensing_overlay.hpp"
#include "program/text.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <system_error>
#include <utility>

namespace lumo::program {

PlanarFinger finger_of(const OpenLog& log) { return {log.session.joint_to_joint_m, log.session.joint_to_origin_m}; }

JointReference finger_joints(const OpenLog& log, std::int64_t until_ns) {
  if (log.joints.empty()) throw InputError(log.path + ": has no joint samples (joint.csv) to estimate a force from");
  const int joints = finger_of(log).joints();
  if (log.joints.front().effort.size() != joints)
    throw InputError(lumo::message(log.session_place(), ": joint_to_joint_mm tells of ", joints, joints == 1 ? " joint" : " joints", ", the samples have ", log.joints.front().effort.size()));
  JointReference reference = about(log.path, [&] { return identify_joints(on_frames_clock(log), log.session, until_ns); });
  if (reference.torque.empty()) throw InputError(log.path + ": has no joint samples of the finger without contact");
  return reference;
}

std::vector<JointSample> on_frames_clock(const OpenLog& log) {
  std::vector<JointSample> samples = log.joints;
  for (JointSample& j : samples) j.stamp_ns = log.session.joint_clock(j.stamp_ns);
  return samples;
}

UnloadedStretch unloaded_stretch(const OpenLog& log) { return UnloadedStretch::of(log.session, log.frames.empty() ? 0 : log.frames.front().stamp_ns); }

OpenLog open_log(const std::string& path, Progress& progress, const McapTopics& topics) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return {read_log_folder(path), nullptr, {}};
  const auto file = std::make_shared<LogFile>(LogFile::open(path));
  McapLog read = read_log_file(*file, topics);
  if (!file->fault().empty()) progress.note(file->fault() + "; read up to there");
  return {std::move(read.log), file, std::move(read.pictures)};
}

SensedLog read_sensed_log(const std::string& path, const LongitudinalBins& bins, Progress& progress) {
  SensedLog s;
  s.bins = bins;
  s.log = open_log(path, progress);
  s.joints = on_frames_clock(s.log);
  s.stretch = unloaded_stretch(s.log);
  about(path, [&] {
    for (const FrameRecord& f : s.log.frames) s.frame_ns.push_back(f.stamp_ns);
    LogCamera first(s.log);
    s.view = view_finger(first, s.log.session, s.stretch, path);
    GreenProfile readout = s.view.readout(bins);
    LogCamera all(s.log);
    s.profiles = read_profiles(all, readout);
  });
  if (s.profiles.empty()) throw InputError(path + ": no picture can be read");
  return s;
}

namespace {

/// The truth where a lab left one, else what segments and the force sensor say. Opened when all estimates are made.
LogTruth truth_of(const OpenLog& log) {
  if (auto truth = left_truth<LogTruth>(log)) return std::move(*truth);
  return about(log.path, [&] { return LogTruth::from_log(log.session, log.wrenches); });
}

// decode

std::string decode(const Options& o, Output& files, Progress& progress) {
  const SensedLog s = read_sensed_log(o.log, LongitudinalBins::regions(), progress);
  const auto [task, report] = about(o.log, [&] {
    const auto holds = hold_responses(s.profiles, s.log.session.segments);
    const std::vector<double> loads = o.decoder == "bayes" ? common_loads(holds, 2.0) : std::vector{2.0, 5.0};   // the filter goes through the whole loading
    DecodingTask t = decoding_task(holds, loads);
    DecodingReport r = o.decoder == "bayes"    ? cross_validate(BayesDecoder{int(loads.size()) - 1}, t.data, t.fold)
                       : o.decoder == "linear" ? cross_validate(LinearDecoder{}, t.data, t.fold)
                       : o.decoder == "gp"   ? cross_validate(GaussianProcessDecoder{}, t.data, t.fold)
                                             : cross_validate(NearestTemplate{}, t.data, t.fold);
    return std::pair(std::move(t), std::move(r));
  });
  Json confusion = Json::array(), predictions = Json::array();
  std::string table = "repetition,y_mm,decoded_y_mm,probability\n";
  for (Eigen::Index i = 0; i < report.confusion.rows(); ++i) {
    Json row = Json::array();
    for (Eigen::Index j = 0; j < report.confusion.cols(); ++j) row.push_back(report.confusion(i, j));
    confusion.push_back(row);
  }
  for (const auto& p : report.predictions) {
    const double y = 1e3 * task.data.place_m[p.place], decoded = 1e3 * task.data.place_m[p.decoded];
    predictions.push_back({{"repetition", p.fold}, {"y_mm", y}, {"decoded_y_mm", decoded}, {"probability", number(p.probability)}});
    table += std::to_string(p.fold) + ',' + csv_number(y) + ',' + csv_number(decoded) + ',' + csv_number(p.probability) + '\n';
  }
  files.add("predictions.csv", table);
  files.add("confusion.svg", draw_confusion(report.confusion, task.data.place_m));
  if (o.json) return Json{{"accuracy", number(report.accuracy.value)}, {"confusion", confusion}, {"predictions", predictions}}.dump(2) + "\n";
  std::string text = lumo::message("accuracy ", short_number(report.accuracy.value, 3), " of ", report.predictions.size(), " (95 % from ", short_number(report.accuracy.low, 3), " to ",
                                        short_number(report.accuracy.high, 3), "), decoder: ", o.decoder, "\ntrue \\ decoded [mm]");
  for (const double y : task.data.place_m) text += cell(1e3 * y, 1, 7);
  for (Eigen::Index i = 0; i < report.confusion.rows(); ++i) {
    text += "\n" + cell(1e3 * task.data.place_m[i], 1, 19);
    for (Eigen::Index j = 0; j < report.confusion.cols(); ++j) text += pad(std::to_string(report.confusion(i, j)), 7);
  }
  return text + "\n";
}

// metrics

/// How far the marker goes from the first touch to 15 N, in the log's first contact that gets there.
std::optional<double> displacement(const Recording& log) {
  std::vector<double> force, marker;
  const TimeSeries series = normal_force(log.wrenches);
  for (const MarkerSample& m : log.markers)
    if (const auto f = series.at(m.stamp_ns, 0.1)) force.push_back((*f)[0]), marker.push_back(m.displacement_m);
  if (int(force.size()) <= OnsetDetector{}.baseline) return std::nullopt;
  return displacement_from_onset(force, marker, 14.9);
}

std::string metrics(const Options& o, Output& files, Progress& progress) {
  const SensedLog s = read_sensed_log(o.log, LongitudinalBins::uniform(-27.5_mm, 27.5_mm, 55), progress);
  std::optional<RecontactQuality> quality;
  std::optional<double> W_cycle, gain;
  const auto holds = about(o.log, [&] { return hold_responses(s.profiles, s.log.session.segments); });
  const auto slopes = about(o.log, [&] { return slope_profiles(holds); });
  const bool repeated = slopes.size() >= 2 && std::all_of(slopes.begin(), slopes.end(), [&](const auto& m) { return m.cols() >= 3 && m.cols() == slopes.front().cols(); });
  if (repeated) quality = about(o.log, [&] { return recontact_quality(slopes); });
  if (const auto runs = cycle_runs(holds); !runs.empty()) W_cycle = about(o.log, [&] { return cycle_variation(runs); });
  if (!o.baseline.empty()) {
    const auto here = displacement(s.log), base = displacement(open_log(o.baseline, progress));
    if (here && base) gain = progressive_constraint_gain_percent(*here, *base);
  }
  LineChart chart{"Intensity–force slopes", "median over re-contacts at each place", "y [mm]", "slope [DN/N]", {}};
  std::string table = "place,repetition,y_mm,slope_DN_per_N\n";
  const Eigen::VectorXd at = s.bins.centres_m();
  for (std::size_t i = 0; i < slopes.size(); ++i) {
    const Eigen::VectorXd middle = pointwise_median(slopes[i]);
    Curve curve{"place " + std::to_string(i + 1), palette[i % palette.size()], {}, 1.8, false};
    for (Eigen::Index b = 0; b < at.size(); ++b) {
      curve.points.push_back({1e3 * at[b], middle[b]});
      for (Eigen::Index r = 0; r < slopes[i].cols(); ++r) table += lumo::message(i, ',', r, ',', csv_number(1e3 * at[b]), ',', csv_number(slopes[i](b, r)), '\n');
    }
    chart.curves.push_back(std::move(curve));
  }
  if (!slopes.empty()) files.add("slopes.csv", table), files.add("slopes.svg", draw(chart));
  const auto of = [&](auto get) { return quality ? std::optional<double>(get(*quality)) : std::nullopt; };
  const auto D = of([](const auto& q) { return q.metrics.D_neighbor; }), W = of([](const auto& q) { return q.metrics.W_recontact; }), Q = of([](const auto& q) { return *q.metrics.Q; });
  const auto low = of([](const auto& q) { return q.Q_low; }), high = of([](const auto& q) { return q.Q_high; });
  const auto from = of([](const auto& q) { return q.bootstrap_low; }), to = of([](const auto& q) { return q.bootstrap_high; });
  if (o.json)
    return Json{{"D_neighbor", maybe(D)}, {"W_recontact", maybe(W)}, {"Q", maybe(Q)}, {"Q_low", maybe(low)}, {"Q_high", maybe(high)},
                {"Q_bootstrap_low", maybe(from)}, {"Q_bootstrap_high", maybe(to)}, {"W_cycle", maybe(W_cycle)}, {"gain_percent", maybe(gain)}}.dump(2) + "\n";
  const auto show = [](const std::optional<double>& v, int digits) { return cell(v.value_or(undefined), digits); };
  return "D_neighbor   " + show(D, 4) + " DN/N\nW_recontact  " + show(W, 4) + " DN/N\n" +
         "Q            " + show(Q, 2) + " (" + show(low, 2) + " to " + show(high, 2) + " with one re-contact left out; 95 % bootstrap interval " +
         show(from, 2) + " to " + show(to, 2) + ")\nW_cycle      " + show(W_cycle, 4) + " DN\ngain         " + show(gain, 1) + " %\n";
}

// locate and force

/// Calls `use` with the localiser that was asked for.
template <class Use>
auto with_localizer(const Options& o, const SensedLog& s, const UnloadedReference& unloaded, Use use) {
  const GreenProfile readout = s.view.readout(s.bins);
  return o.localizer == "peak" ? use(peak_localizer(readout, unloaded)) : use(bayes_localizer(readout, unloaded));
}

std::optional<ContactLocation> seen(const LogEstimate& e) { return e.location.contacts == 1 ? std::optional(e.location.contact[0]) : std::nullopt; }

/// A further column of a table, empty for what is not known.
std::string field(const std::optional<double>& v, double scale = 1.0) { return ',' + (v ? csv_number(scale * *v) : std::string()); }

double seconds_between(const LogEstimate& first, const LogEstimate& e) { return 1e-9 * double(e.stamp_ns - first.stamp_ns); }

LineChart timeline(const std::string& title, const std::string& quantity) { return {title, "estimate at each frame against the truth", "time [s]", quantity, {}}; }

/// What is not known for some frames interrupts a line.
void add_curve(LineChart& chart, std::string label, std::string_view colour, double width, const std::vector<Point>& points) {
  constexpr double gap_s = 0.15;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (i == 0 || points[i][0] - points[i - 1][0] > gap_s) chart.curves.push_back({std::exchange(label, ""), std::string(colour), {}, width, true});
    chart.curves.back().points.push_back(points[i]);
    chart.curves.back().markers = chart.curves.back().points.size() == 1;   // which no line shows
  }
}

void add_curves(LineChart& chart, const std::vector<Point>& truth, const std::vector<Point>& estimate) {
  add_curve(chart, "truth", palette[6], 2.4, truth);
  add_curve(chart, "estimate", palette[1], 1.4, estimate);
}

std::string located(const Options& o, Output& files, Progress& progress) {
  const SensedLog s = read_sensed_log(o.log, LongitudinalBins::uniform(-27.5_mm, 27.5_mm, 55), progress);
  const UnloadedReference unloaded = unloaded_reference(s.profiles, s.stretch, o.log);
  const auto estimates = with_localizer(o, s, unloaded, [&](const auto& l) { return lumo::sense::locate(s.profiles, unloaded, l); });
  const LogTruth truth = truth_of(s.log);
  const LocationScore score = location_score(estimates, truth, o.from_N, seen);
  std::string table = "stamp_ns,contacts,y_mm,y_sigma_mm,probability,true_y_mm,true_force_N\n";
  std::vector<Point> line, points;
  const LogEstimate* strongest = nullptr;
  for (const LogEstimate& e : estimates) {
    const auto t = truth.at(e.stamp_ns);
    const auto y = seen(e);
    table += std::to_string(e.stamp_ns) + ',' + std::to_string(e.location.contacts) + field(y ? std::optional(y->y_m) : std::nullopt, 1e3) +
             field(y ? std::optional(std::sqrt(y->variance_m2)) : std::nullopt, 1e3) + field(e.location.probability) + field(t.y_m, 1e3) + field(t.force_N) + '\n';
    const double seconds = seconds_between(estimates.front(), e);
    if (t.y_m && t.force_N.value_or(0.0) > 0.5) line.push_back({seconds, 1e3 * *t.y_m});
    if (y) points.push_back({seconds, 1e3 * y->y_m});
    if (y && (!strongest || y->amplitude > seen(*strongest)->amplitude)) strongest = &e;
  }
  files.add("locations.csv", table);
  if (!points.empty()) {
    LineChart chart = timeline("Location", "y [mm]");
    add_curves(chart, line, points);
    files.add("locations.svg", draw(chart));
  }
  if (files.wanted() && strongest) files.add("overlay.png", overlay_png(s, strongest->stamp_ns, *seen(*strongest)));
  const bool known = score.samples > 0, found = score.located > 0;
  if (o.json)
    return Json{{"samples", score.samples}, {"mae_mm", found ? number(1e3 * score.mae_m) : Json(nullptr)}, {"coverage_90", found ? number(score.coverage_90) : Json(nullptr)}}.dump(2) + "\n";
  if (!known) return lumo::message(estimates.size(), " frames; the log does not tell where contacts were, so that nothing can be compared\n");
  return lumo::message(score.samples, " frames at ", short_number(o.from_N), " N and more, ", score.located, " located\nmean error   ", cell(found ? 1e3 * score.mae_m : undefined, 2),
                            " mm\n90 % interval holds the truth in ", cell(found ? 100.0 * score.coverage_90 : undefined, 1), " % of them\n");
}

std::string force(const Options& o, Output& files, Progress& progress) {
  const SensedLog s = read_sensed_log(o.log, LongitudinalBins::uniform(-27.5_mm, 27.5_mm, 55), progress);
  const PlanarFinger finger = finger_of(s.log);
  const LogReference reference{s.view, unloaded_reference(s.profiles, s.stretch, o.log), finger_joints(s.log, s.stretch.to_ns)};
  const std::vector<TorqueModel>& torque = reference.joints.torque;
  const double map_sigma = std::sqrt(s.view.leds.map.variance_m2(0.0));
  const auto estimates = about(o.log, [&] {
    return with_localizer(o, s, reference.unloaded, [&](const auto& l) {
      return estimate_forces([&] { return LogCamera(s.log); }, s.joints, s.frame_ns, reference, s.bins, l, finger, s.log.session, map_sigma, finger.pad_link());
    });
  });
  const Eigen::VectorXd residual = ContactTorques(s.joints, torque).residual();   // positions, torques
  const Eigen::Index joints = residual.size() / 2;
  const double off_rad = residual.head(joints).maxCoeff(), off_Nm = residual.tail(joints).maxCoeff();
  const double clock_s = s.log.session.joint_clock.residual_s;
  const double noise_Nm = std::max_element(torque.begin(), torque.end(), [](const auto& a, const auto& b) { return a.noise_Nm < b.noise_Nm; })->noise_Nm;
  const LogTruth truth = truth_of(s.log);
  const ForceScore score = force_score(estimates, truth, finger, -25.0_mm, 25.0_mm, noise_Nm, 0.5, finger.pad_link());
  std::string table = "stamp_ns,state,force_N,force_sigma_N,y_mm,y_sigma_mm,true_force_N,true_y_mm,faults\n";
  std::vector<Point> line, points;
  std::vector<double> times;
  for (const LogEstimate& e : estimates) {
    const auto t = truth.at(e.stamp_ns);
    const ContactForce& c = e.force.contact[0];
    table += std::to_string(e.stamp_ns) + ',' + to_string(e.force.state) + field(c.force_N) + field(std::sqrt(c.force_variance_N2)) + field(c.y_m, 1e3) + field(std::sqrt(c.y_variance_m2), 1e3) +
             field(t.force_N) + field(t.y_m, 1e3) + ',' + to_string(e.force.faults) + '\n';
    const double seconds = seconds_between(estimates.front(), e);
    if (t.force_N) line.push_back({seconds, *t.force_N});
    if (c.force_N) points.push_back({seconds, *c.force_N});
    times.push_back(1e3 * e.seconds);
  }
  files.add("forces.csv", table);
  if (!points.empty()) {
    LineChart chart = timeline("Force", "normal force [N]");
    add_curves(chart, line, points);
    files.add("forces.svg", draw(chart));
  }
  const auto mae = [](const ForceErrors::Error& e) { return e.samples > 0 ? e.mae_N : undefined; };
  const ForceErrors& e = score.errors;
  const double middle = times.empty() ? undefined : quantile(times, 0.5), slow = times.empty() ? undefined : quantile(times, 0.95);
  if (o.json)
    return Json{{"samples", score.samples},
                {"mae_N", {{"fused", number(mae(e.fused))}, {"optical", number(mae(e.optical))}, {"fixed_arm", number(mae(e.fixed_arm))}, {"known_location", number(mae(e.known_location))}, {"torque_only", number(mae(e.torque_only))}}},
                {"coverage_90", score.samples > 0 ? number(score.coverage_90) : Json(nullptr)},
                {"frame_ms", {{"median", number(middle)}, {"p95", number(slow)}}},
                {"alignment", {{"clock_s", number(clock_s)}, {"position_rad", number(off_rad)}, {"torque_Nm", number(off_Nm)}}}}.dump(2) + "\n";
  return lumo::message(score.samples, " frames in contact; mean error [N]\n  fused           ", cell(mae(e.fused), 2), "\n  optical         ", cell(mae(e.optical), 2), "\n  fixed arm       ",
                            cell(mae(e.fixed_arm), 2), "\n  known location  ", cell(mae(e.known_location), 2), "\n  torque only     ", cell(mae(e.torque_only), 2), "\n90 % interval holds the truth in ",
                            cell(score.samples > 0 ? 100.0 * score.coverage_90 : undefined, 1), " %\nframe to estimate ", cell(middle, 3), " ms (median), ", cell(slow, 3), " ms (95 %)\nalignment        a joint sample and the line through its neighbours differ by ", cell(1e3 * off_rad, 2), " mrad, ",
                            cell(1e3 * off_Nm, 1), " mN·m (RMS: noise, and what interpolation at the pictures' times misses)", clock_s > 0.0 ? lumo::message(", their clock by ", cell(1e3 * clock_s, 3), " ms") : std::string(), "\n");
}

}  // namespace

std::string sense(const Options& o, Output& files, Progress& progress, char**) {
  switch (o.command) {
    case Command::doctor: return watch(o);
    case Command::record: return record(o, *o.out, progress);
    case Command::lab_recontact:
    case Command::lab_cycle:
    case Command::lab_imaging:
    case Command::lab_force:
    case Command::lab_hand: return lab(o, progress);
    case Command::hand: return o.camera ? sense_live(o, progress) : hand(o, files, progress);
    case Command::calibrate: return calibrate(o, progress);
    case Command::convert: return convert(o, progress);
    default: break;
  }
  const bool streamed = o.command == Command::locate || o.command == Command::force;
  if (o.camera && streamed) return sense_live(o, progress);
  if (o.camera) {   // the plan is carried out, then looked at
    Options recorded = o;
    recorded.log = *o.out + "/recording";
    recorded.camera.reset();
    if (open_log(o.log, progress).session.segments.empty()) throw InputError(o.log + ": its session has no segments, nothing tells what was touched when");
    Options recording = o;
    recording.json = false;
    std::string counts = record(recording, recorded.log, progress);
    counts.pop_back();
    progress.note(counts);
    return sense(recorded, files, progress, nullptr);
  }
  progress.stage("reading the log");
  switch (o.command) {
    case Command::decode: return decode(o, files, progress);
    case Command::metrics: return metrics(o, files, progress);
    case Command::locate: return located(o, files, progress);
    default: return force(o, files, progress);
  }
}

}  // namespace lumo::program
