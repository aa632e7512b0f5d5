#include "sensing/findings.hpp"

#include "console/text.hpp"

#include "lumo/core/statistics.hpp"

#include <algorithm>
#include <array>
#include <utility>

namespace lumo::program {

namespace {

constexpr double noted_share = 0.01;  ///< of what is lost, from which a note reports it

template <class Rows, class Clock> StreamFinding finding_of(LogStream stream, const Rows& rows, Clock on_frames_clock) {
  StreamFinding f;
  f.stream = stream;
  f.rows = rows.size();
  if (rows.empty()) return f;
  f.stretch = Stretch{on_frames_clock(rows.front().stamp_ns), on_frames_clock(rows.back().stamp_ns)};
  std::vector<double> period_s;
  for (std::size_t i = 1; i < rows.size(); ++i)
    period_s.push_back(1e-9 * double(rows[i].stamp_ns - rows[i - 1].stamp_ns));
  if (period_s.empty()) return f;
  f.period_s = median(period_s);
  for (const double p : period_s)
    if (p > StreamFinding::pause_periods * f.period_s) {
      ++f.pauses;
      f.paused_s += p;
    }
  return f;
}

std::string counted(std::size_t n, const char* what) { return lumo::message(n, ' ', what); }

/// Parts that are not empty, with commas.
std::string listed(const std::vector<std::string>& parts) {
  std::string text;
  for (const std::string& p : parts)
    if (!p.empty()) text += (text.empty() ? "" : ", ") + p;
  return text;
}

std::string left_out(const StreamReading& r) {
  return listed({r.repeated > 0 ? counted(r.repeated, "came twice and are left out") : "",
      r.backward > 0 ? counted(r.backward, "with stamps against the order are left out") : "",
      r.incomplete > 0 ? counted(r.incomplete, "without a position or an effort are left out") : ""});
}

std::string lost(const PictureCount& p) {
  return listed({p.missing > 0 ? counted(p.missing, "missing") : "", p.damaged > 0 ? counted(p.damaged, "damaged") : "",
      p.other_size > 0 ? counted(p.other_size, "of another size or format") : ""});
}

std::string paused(const StreamFinding& f) {
  return f.pauses == 0 ? ""
                       : lumo::message(f.pauses, f.pauses == 1 ? " pause, " : " pauses, ", cell(f.paused_s, 3),
                             " s in all (period ", cell(1e3 * f.period_s, 1), " ms)");
}

double duration_s(const StreamFinding& f) {
  return f.stretch ? 1e-9 * double(f.stretch->to_ns - f.stretch->from_ns) : 0.0;
}

}  // namespace

Json lines_json(const std::vector<std::string>& texts) {
  Json list = Json::array();
  for (const std::string& t : texts) list.push_back(one_line(t));
  return list;
}

std::string_view name_of(LogStream stream) {
  static constexpr std::array<std::string_view, log_streams> names{
      "pictures", "joint states", "wrenches", "displacements", "photodiodes"};
  return names[std::size_t(stream)];
}

std::vector<StreamFinding> streams_of(const OpenLog& log) {
  const auto same = [](std::int64_t t) { return t; };
  std::vector<StreamFinding> all = {finding_of(LogStream::frames, log.frames, same),
      finding_of(LogStream::joints, log.joints, log.session.joint_clock),
      finding_of(LogStream::wrenches, log.wrenches, log.session.wrench_clock),
      finding_of(LogStream::markers, log.markers, log.session.wrench_clock),
      finding_of(LogStream::photodiodes, log.photodiodes, same)};
  std::vector<StreamFinding> found;
  for (StreamFinding& f : all) {
    f.reading = log.reading[std::size_t(f.stream)];
    if (f.stretch)
      f.outside = std::size_t(std::count_if(log.frames.begin(), log.frames.end(),
          [&](const FrameRecord& frame) { return !f.stretch->holds(frame.stamp_ns); }));
    if (f.rows > 0 || !f.reading.fault.empty()) found.push_back(std::move(f));
  }
  return found;
}

void tell_findings(const OpenLog& log, const PictureCount& pictures, Progress& progress) {
  const auto note = [&](const std::string& text) { progress.note(log.path + ": " + text); };
  for (const StreamFinding& f : streams_of(log)) {
    const std::string name(name_of(f.stream));
    if (!f.reading.fault.empty()) progress.note(name + " are not used: " + f.reading.fault);
    if (f.reading.left_out() > 0)
      note(lumo::message("of ", f.reading.rows, " rows of ", name, ' ', left_out(f.reading)));
    if (f.paused_s > noted_share * duration_s(f)) note(name + ": " + paused(f));
    if (f.stream == LogStream::joints && double(f.outside) > noted_share * double(log.frames.size()))
      note(lumo::message(f.outside, " of ", log.frames.size(), " pictures are outside of the ", name, "' time, ",
          to_string(*f.stretch)));
  }
  if (double(pictures.lost()) > noted_share * double(pictures.rows))
    note(lumo::message("of ", pictures.rows, " pictures ", lost(pictures)));
}

std::string findings_text(const OpenLog& log, const PictureCount& pictures) {
  constexpr int column = -14;
  std::string text;
  for (const StreamFinding& f : streams_of(log)) {
    const std::string name = pad(std::string(name_of(f.stream)), column);
    if (!f.reading.fault.empty()) {
      text += name + "not used: " + f.reading.fault + "\n";
      continue;
    }
    const bool joints = f.stream == LogStream::joints && f.outside > 0;
    const std::string more = listed({f.stream == LogStream::frames ? lost(pictures) : "", left_out(f.reading),
        paused(f), joints ? lumo::message(f.outside, " pictures outside") : ""});
    text += lumo::message(name, f.rows, ", ", to_string(*f.stretch), more.empty() ? "" : "; ", more, "\n");
  }
  return text;
}

Json findings_json(const OpenLog& log, const PictureCount& pictures, std::vector<std::string> notes) {
  const std::string place = log.path + ": ";  // which the result's reader has asked for
  for (std::string& n : notes)
    if (n.starts_with(place)) n.erase(0, place.size());
  Json streams = Json::object();
  for (const StreamFinding& f : streams_of(log)) {
    std::string key(name_of(f.stream));
    std::replace(key.begin(), key.end(), ' ', '_');
    streams[key] = {{"rows", f.rows}, {"from_ns", f.stretch ? Json(f.stretch->from_ns) : Json(nullptr)},
        {"to_ns", f.stretch ? Json(f.stretch->to_ns) : Json(nullptr)}, {"period_ms", number(1e3 * f.period_s)},
        {"pauses", f.pauses}, {"paused_s", number(f.paused_s)}, {"left_out_repeated", f.reading.repeated},
        {"left_out_backward", f.reading.backward}, {"left_out_incomplete", f.reading.incomplete},
        {"pictures_outside", f.outside},
        {"fault", f.reading.fault.empty() ? Json(nullptr) : Json(one_line(f.reading.fault))}};
  }
  return {{"pictures", {{"rows", pictures.rows}, {"read", pictures.read}, {"missing", pictures.missing},
                           {"damaged", pictures.damaged}, {"other_size", pictures.other_size}}},
      {"streams", streams}, {"joint_names", lines_json(log.joint_names)}, {"notes", lines_json(notes)}};
}

std::string examined(const std::string& path, const McapTopics& topics, bool as_json, Progress& progress) {
  progress.stage("reading the log");
  const OpenLog log = open_log(path, progress, topics);
  PictureCount count;
  int width = 0, height = 0;
  std::string fault = log.reading[std::size_t(LogStream::frames)].fault;
  if (!log.frames.empty()) {
    LogCamera camera(log);
    while (const auto f = camera.next()) {
      if (f->image.empty()) continue;
      if (width == 0) {
        width = f->image.width;
        height = f->image.height;
      }
      count.other_size += f->image.width != width || f->image.height != height;
    }
    const std::size_t other = count.other_size;
    count = camera.count();
    count.other_size = other;
  }
  progress.finish();
  tell_findings(log, count, progress);
  const UnloadedStretch rest = unloaded_stretch(log);
  const bool stated = std::any_of(log.session.segments.begin(), log.session.segments.end(),
      [](const Segment& s) { return s.kind == SegmentKind::unloaded; });
  if (as_json) {
    Json j = findings_json(log, count, progress.notes());
    j["width_px"] = width > 0 ? Json(width) : Json(nullptr);
    j["height_px"] = height > 0 ? Json(height) : Json(nullptr);
    j["unloaded"] = {{"from_ns", rest.from_ns}, {"to_ns", rest.to_ns}, {"stated", stated}};
    j["segments"] = log.session.segments.size();
    j["joints"] = log.joints.empty() ? 0 : log.joints.front().position_rad.size();
    return text_of(j, 2) + "\n";
  }
  std::string text = findings_text(log, count);
  if (width > 0) text += lumo::message("size          ", width, " x ", height, " px\n");
  if (!log.joints.empty())
    text += lumo::message("joints        ", log.joints.front().position_rad.size(),
        log.joint_names.empty() ? std::string() : " (" + joint_list(log.joint_names) + ")", ", efforts are ",
        log.joints.front().unit == Effort::current_A ? "currents" : "torques", "\n");
  text += lumo::message("unloaded      ", to_string(rest),
      stated ? ", as the session states" : ", assumed: the session states no segment of kind \"unloaded\"", "\n");
  text += lumo::message("segments      ", log.session.segments.size(), "\n");
  for (const std::string& note : log.notes) text += "note          " + note + "\n";
  return text;
}

}  // namespace lumo::program
