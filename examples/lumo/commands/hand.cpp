#include "charts/chart.hpp"
#include "commands/estimating.hpp"
#include "console/text.hpp"
#include "sensing/findings.hpp"

#include "lumo/sense/hand/hand_log.hpp"
#include "lumo/sense/live/live.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace lumo::program {

using namespace sense;

namespace {

struct Hand : EstimatingCommand {
  void declare(CLI::App& app) {
    add_log(app);
    declare_live(app,
        "Number of a live camera instead of a log's pictures. LOG shows the unloaded hand, and describes it", true);
  }
  void check() const { check_torques("hand"); }
  Result on_log(Output& files, Progress& progress) const override;
  void live(LiveLines& lines, Progress& progress) const override;
};

struct Row {
  std::int64_t stamp_ns;
  HandContact contact;
};

struct Seen {
  std::vector<std::int64_t> stamp_ns;
  std::vector<Row> rows;
  std::vector<int> frames_of_link;  ///< in which it was seen
  int references = 0;
  PictureCount pictures = {};
};

/// One strip for each link: places along it over time.
std::string draw_places(const HandObserver& hand, const Seen& seen, const std::optional<HandTouches>& truth) {
  constexpr double strip = 96, gap = 14;
  const auto links = hand.links().size();
  std::vector<drawing::LegendEntry> entries{{"contact seen", palette[1], true}};
  if (truth) entries.insert(entries.begin(), {"truth", plot::ink, true});
  std::vector<drawing::LegendEntry> beside = entries;
  for (const HandLink& link : hand.links()) beside.push_back({link.name, "", true});  // names stand there, too
  plot::Frame f = drawing::frame_for(beside, 900, 0);
  f.bottom = f.top + double(links) * (strip + gap) - gap;
  Svg svg(900, f.bottom + 58);
  const auto seconds = [&](std::int64_t stamp) { return 1e-9 * double(stamp - seen.stamp_ns.front()); };
  f.x_ticks = plot::ticks(0.0, std::max(seconds(seen.stamp_ns.back()), 1e-3), 8);
  f.x0 = f.x_ticks.front();
  f.x1 = f.x_ticks.back();
  plot::headline(svg, f.left, "Contacts on the hand's links",
      truth ? "place along each link, against what really pressed" : "place along each link");
  plot::x_axis(svg, f, "time since the references ended [s]");
  for (std::size_t l = 0; l < links; ++l) {
    plot::Frame part = f;
    part.top = f.top + double(l) * (strip + gap);
    part.bottom = part.top + strip;
    const HandLink& link = hand.links()[l];
    part.y_ticks = {1e3 * link.y_low_m, 0.5e3 * (link.y_low_m + link.y_high_m), 1e3 * link.y_high_m};
    part.y0 = part.y_ticks.front();
    part.y1 = part.y_ticks.back();
    plot::y_axis(svg, part, "y [mm]");
    svg.polyline({{part.left, part.top}, {part.left, part.bottom}, {part.right, part.bottom}},
        {.stroke = plot::ink, .width = 1.2});
    svg.text({part.right + 14, 0.5 * (part.top + part.bottom) + 16}, link.name, {.size = 12, .bold = true});
    if (truth)
      for (const std::int64_t stamp : seen.stamp_ns)
        for (const auto& t : truth->at(stamp))
          if (t.link == int(l)) svg.circle({part.x(seconds(stamp)), part.y(1e3 * t.y_m)}, 2.6, {.fill = plot::ink});
    for (const Row& r : seen.rows)
      if (r.contact.link == int(l))
        svg.circle({part.x(seconds(r.stamp_ns)), part.y(1e3 * r.contact.y_m)}, 1.7, {.fill = palette[1]});
  }
  drawing::legend(svg, f, entries);
  return svg.str();
}

/// Keeps the strongest picture of each spell of contact.
class Spells {
 public:
  static constexpr std::size_t most = 24;

  explicit Spells(Output& files) : files_(files) {}
  void add(const HandObserver& hand, const HandEstimate& e, const ImageView& image) {
    double strength = 0.0;
    for (const HandContact& c : e.contacts) strength += c.mean_DN * c.area_m2;
    if (e.contacts.empty()) close();
    else if (strength > best_ && kept_ < most) {
      best_ = strength;
      picture_ = pictures().hand_overlay(image, hand, e);
    }
  }
  void close() {
    if (best_ > 0.0) files_.add("contact_" + frame_file(kept_++).substr(3), std::move(picture_));
    best_ = 0.0;
  }

 private:
  Output& files_;
  std::size_t kept_ = 0;
  double best_ = 0.0;
  std::string picture_;
};

/// Looks at all pictures of the log. Throws InputError for a log without joints or pictures of the unloaded hand.
Seen look(const OpenLog& log, HandObserver& observer, Output& files, Progress& progress) {
  const Session& session = log.session;
  const auto links = observer.links().size();
  Seen seen;
  seen.frames_of_link.assign(links, 0);
  const TimeSeries positions = about(log.path, [&] { return joint_positions(log.joints, session); });
  int without_joints = 0;
  about(log.path, [&] {
    LogCamera camera(log);
    Spells spells(files);
    progress.stage("pictures", int(log.frames.size()));
    seen.references = observe_hand(
        camera, observer, positions, session, [&](const std::optional<HandEstimate>& e, const ImageView& image) {
          progress.step();
          if (!e) return;
          without_joints += !positions.at(e->stamp_ns - std::llround(1e9 * session.frame_delay_s), 0.1);
          seen.stamp_ns.push_back(e->stamp_ns);
          for (std::size_t l = 0; l < links; ++l) seen.frames_of_link[l] += e->seen[l];
          for (const HandContact& c : e->contacts) seen.rows.push_back({e->stamp_ns, c});
          if (files.wanted()) spells.add(observer, *e, image);
        });
    spells.close();
    seen.pictures = camera.count();
  });
  progress.finish();
  if (without_joints > 0)
    progress.note(lumo::message(log.path, ": ", without_joints, " of ", seen.stamp_ns.size(),
        " pictures have no joint sample within 0.1 s, so that nothing is seen in them"));
  if (seen.references == 0)
    throw InputError(
        log.path +
        ": no picture of the unloaded hand, with joint samples, in which a link is found; segments of kind \"free\" or "
        "\"unloaded\" must mark some");
  for (std::size_t l = 0; l < links; ++l)
    if (observer.references(int(l)) == 0)
      progress.note(log.path + ": link '" + one_line(observer.links()[l].name) +
                    "' is found in no picture of the unloaded hand: are holes_px its holes?");
  if (seen.stamp_ns.empty()) throw InputError(log.path + ": has no pictures but of the unloaded hand");
  return seen;
}

/// All contacts, as JSON and as a table, and their score where the truth is known.
struct Found {
  Json contacts = Json::array();
  std::string table = "stamp_ns,link,name,y_mm,z_mm,y_low_mm,y_high_mm,area_mm2,peak_DN,mean_DN,u_px,v_px\n";
  HandScore score;
};

Found found_in(const HandObserver& observer, const Seen& seen, const std::optional<HandTouches>& truth) {
  constexpr std::array keys = {
      "y_mm", "z_mm", "y_low_mm", "y_high_mm", "area_mm2", "peak_DN", "mean_DN", "u_px", "v_px"};
  Found found;
  auto row = seen.rows.begin();
  for (const std::int64_t stamp : seen.stamp_ns) {
    HandEstimate e{stamp, {}, {}, {}, {}};
    for (; row != seen.rows.end() && row->stamp_ns == stamp; ++row) {
      const HandContact& c = row->contact;
      const std::string& name = observer.links()[std::size_t(c.link)].name;
      const std::array<double, keys.size()> values = {1e3 * c.y_m, 1e3 * c.z_m, 1e3 * c.y_low_m, 1e3 * c.y_high_m,
          1e6 * c.area_m2, c.peak_DN, c.mean_DN, c.pixel.x(), c.pixel.y()};
      Json j = {{"stamp_ns", stamp}, {"link", c.link}, {"name", name}};
      found.table += lumo::message(stamp, ',', c.link, ',', csv_text(name));
      for (std::size_t k = 0; k < keys.size(); ++k) {
        j[keys[k]] = number(values[k]);
        found.table += ',' + csv_number(values[k]);
      }
      found.contacts.push_back(std::move(j));
      found.table += '\n';
      e.contacts.push_back(c);
    }
    if (truth) found.score.add(e, truth->at(stamp));
  }
  return found;
}

std::optional<double> mae_mm(const HandScore& score) {
  return score.found > 0 ? std::optional(1e3 * score.mae_m) : std::nullopt;
}

Json hand_json(const HandObserver& observer, const Seen& seen, const Found& found, bool scored) {
  Json links = Json::array(), score;
  for (std::size_t l = 0; l < observer.links().size(); ++l)
    links.push_back({{"name", observer.links()[l].name}, {"seen", seen.frames_of_link[l]},
        {"references", observer.references(int(l))}});
  const HandScore& s = found.score;
  if (scored)
    score = {{"touches", s.touches}, {"found", s.found}, {"mae_mm", maybe(mae_mm(s))}, {"unfounded", s.unfounded}};
  return {{"frames", seen.stamp_ns.size()}, {"references", seen.references}, {"links", links}, {"score", score},
      {"contacts", found.contacts}};
}

std::string hand_text(const HandObserver& observer, const Seen& seen, const HandScore* score) {
  std::string text = lumo::message(seen.stamp_ns.size(), " frames, ", seen.references,
      " pictures of the unloaded hand; ", seen.rows.size(), " contacts\n");
  for (std::size_t l = 0; l < observer.links().size(); ++l) {
    const auto count =
        std::count_if(seen.rows.begin(), seen.rows.end(), [&](const Row& r) { return r.contact.link == int(l); });
    text += lumo::message("  ", one_line(observer.links()[l].name), ": seen in ", seen.frames_of_link[l], " frames, ",
        count, " contacts\n");
  }
  if (score != nullptr)
    text += lumo::message("of ", score->touches, " touches with 5 N and more ", score->found, " found, mean error ",
        cell(mae_mm(*score).value_or(undefined), 2), " mm; ", score->unfounded, " of ", score->contacts,
        " contacts where nothing touches\n");
  return text;
}

Result Hand::on_log(Output& files, Progress& progress) const {
  const OpenLog opened = open_hand_log(log, progress, topics);
  HandObserver observer = about(opened.session_place(), [&] { return hand_observer(opened.session); });
  const Seen seen = look(opened, observer, files, progress);
  const auto truth = left_truth<HandTouches>(opened);  // opened now that all estimates are made
  const Found found = found_in(observer, seen, truth);
  files.add("contacts.csv", found.table);
  files.add("contacts.svg", draw_places(observer, seen, truth));
  tell_findings(opened, seen.pictures, progress);
  if (json) {
    Json result = hand_json(observer, seen, found, truth.has_value());
    result["log"] = findings_json(opened, seen.pictures, progress.notes());
    return text_of(result, 2) + "\n";
  }
  return hand_text(observer, seen, truth ? &found.score : nullptr) + findings_text(opened, seen.pictures);
}

void Hand::live(LiveLines& lines, Progress& progress) const {
  const OpenLog opened = open_hand_log(log, progress, topics);
  HandObserver observer = about(opened.session_place(), [&] { return hand_observer(opened.session); });
  const TimeSeries positions = about(log, [&] { return joint_positions(opened.joints, opened.session); });
  LogCamera recorded(opened);
  require_motors(camera, int(opened.joints.front().position_rad.size()));
  progress.stage("pictures of the unloaded hand");
  if (add_references(recorded, observer, positions, opened.session) == 0)
    throw InputError(log + ": no picture of the unloaded hand in which a link is found");
  progress.finish();
  const auto source = pictures().live(settings_of(camera));
  MiniCheetahMotors motors = motors_of(camera);
  observe_hand_live(*source, motors, observer, opened.session,
      [&](const HandEstimate& e, const ImageView&) {
        const double seconds = lines.seconds(e.stamp_ns);
        const auto seen = std::count(e.seen.begin(), e.seen.end(), true);
        Json contacts = Json::array();
        std::string text;
        for (const HandContact& c : e.contacts) {
          const std::string& name = observer.links()[std::size_t(c.link)].name;
          contacts.push_back({{"link", c.link}, {"name", name}, {"y_mm", number(1e3 * c.y_m)},
              {"z_mm", number(1e3 * c.z_m)}, {"area_mm2", number(1e6 * c.area_m2)}, {"peak_DN", number(c.peak_DN)}});
          text += "  " + one_line(name) + " y " + cell(1e3 * c.y_m, 1) + " mm";
        }
        if (json)
          return lines(e.stamp_ns, seen > 0,
              text_of(Json{{"stamp_ns", e.stamp_ns}, {"seen", seen}, {"contacts", contacts}}, -1));
        return lines(e.stamp_ns, seen > 0,
            cell(seconds, 3) + " s  " + lumo::message(seen, " links seen") + (text.empty() ? "  no contact" : text));
      },
      {.name = camera.device()});
}

}  // namespace

void add_hand(CommandLine& line) { line.add<Hand>("hand", "Contacts on all links of a hand at once"); }

}  // namespace lumo::program
