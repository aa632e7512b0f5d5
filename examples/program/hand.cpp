#include "program/hand.hpp"

#include "lumo/sense/hand/hand_log.hpp"
#include "program/chart.hpp"
#include "program/hand_overlay.hpp"
#include "program/json.hpp"
#include "program/sensing_log.hpp"
#include "program/text.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace lumo::program {

namespace {

struct Row {
  std::int64_t stamp_ns;
  HandContact contact;
};

struct Seen {
  std::vector<std::int64_t> stamp_ns;
  std::vector<Row> rows;
  std::vector<int> frames_of_link;   ///< in which it was seen
  int references = 0;
};

/// One strip for each link: places along it over time.
std::string draw_places(const HandObserver& hand, const Seen& seen, const std::optional<HandTouches>& truth) {
  constexpr double strip = 96, gap = 14;
  const auto links = hand.links().size();
  std::vector<detail::LegendEntry> entries{{"contact seen", palette[1], true}};
  if (truth) entries.insert(entries.begin(), {"truth", plot::ink, true});
  std::vector<detail::LegendEntry> beside = entries;
  for (const HandLink& link : hand.links()) beside.push_back({link.name, "", true});   // names stand there, too
  plot::Frame f = detail::frame_for(beside, 900, 0);
  f.bottom = f.top + double(links) * (strip + gap) - gap;
  Svg svg(900, f.bottom + 58);
  const auto seconds = [&](std::int64_t stamp) { return 1e-9 * double(stamp - seen.stamp_ns.front()); };
  f.x_ticks = plot::ticks(0.0, std::max(seconds(seen.stamp_ns.back()), 1e-3), 8);
  f.x0 = f.x_ticks.front(), f.x1 = f.x_ticks.back();
  plot::headline(svg, f.left, "Contacts on the hand's links", truth ? "place along each link, against what really pressed" : "place along each link");
  plot::x_axis(svg, f, "time since the references ended [s]");
  for (std::size_t l = 0; l < links; ++l) {
    plot::Frame part = f;
    part.top = f.top + double(l) * (strip + gap), part.bottom = part.top + strip;
    const HandLink& link = hand.links()[l];
    part.y_ticks = {1e3 * link.y_low_m, 0.5e3 * (link.y_low_m + link.y_high_m), 1e3 * link.y_high_m};
    part.y0 = part.y_ticks.front(), part.y1 = part.y_ticks.back();
    plot::y_axis(svg, part, "y [mm]");
    svg.polyline({{part.left, part.top}, {part.left, part.bottom}, {part.right, part.bottom}}, {.stroke = plot::ink, .width = 1.2});
    svg.text({part.right + 14, 0.5 * (part.top + part.bottom) + 16}, link.name, {.size = 12, .bold = true});
    if (truth)
      for (const std::int64_t stamp : seen.stamp_ns)
        for (const auto& t : truth->at(stamp))
          if (t.link == int(l)) svg.circle({part.x(seconds(stamp)), part.y(1e3 * t.y_m)}, 2.6, {.fill = plot::ink});
    for (const Row& r : seen.rows)
      if (r.contact.link == int(l)) svg.circle({part.x(seconds(r.stamp_ns)), part.y(1e3 * r.contact.y_m)}, 1.7, {.fill = palette[1]});
  }
  detail::legend(svg, f, entries);
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
    else if (strength > best_ && kept_ < most) best_ = strength, picture_ = hand_overlay_png(image, hand, e);
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

}  // namespace

OpenLog open_hand_log(const std::string& path, Progress& progress) {
  OpenLog log = open_log(path, progress);
  if (log.session.links.empty()) throw InputError(log.session_place() + ": links is missing, nothing tells of a hand's links (docs/log_format.md)");
  if (log.joints.empty()) throw InputError(path + ": has no joint samples (joint.csv), which tell the unloaded pictures apart");
  return log;
}

std::string hand(const Options& o, Output& files, Progress& progress) {
  const OpenLog log = open_hand_log(o.log, progress);
  const Session& session = log.session;
  HandObserver observer = about(log.session_place(), [&] { return hand_observer(session); });
  const auto links = observer.links().size();
  Seen seen;
  seen.frames_of_link.assign(links, 0);
  const TimeSeries positions = about(o.log, [&] { return joint_positions(log.joints, session); });
  int without_joints = 0;
  about(o.log, [&] {
    LogCamera camera(log);
    Spells spells(files);
    progress.stage("pictures", int(log.frames.size()));
    seen.references = observe_hand(camera, observer, positions, session, [&](const std::optional<HandEstimate>& e, const ImageView& image) {
      progress.step();
      if (!e) return;
      without_joints += !positions.at(e->stamp_ns - std::llround(1e9 * session.frame_delay_s), 0.1);
      seen.stamp_ns.push_back(e->stamp_ns);
      for (std::size_t l = 0; l < links; ++l) seen.frames_of_link[l] += e->seen[l];
      for (const HandContact& c : e->contacts) seen.rows.push_back({e->stamp_ns, c});
      if (files.wanted()) spells.add(observer, *e, image);
    });
    spells.close();
  });
  progress.finish();
  if (without_joints > 0) progress.note(lumo::message(o.log, ": ", without_joints, " of ", seen.stamp_ns.size(), " pictures have no joint sample within 0.1 s, so that nothing is seen in them"));
  if (seen.references == 0) throw InputError(o.log + ": no picture of the unloaded hand, with joint samples, in which a link is found; segments of kind \"free\" or \"unloaded\" must tell some");
  for (std::size_t l = 0; l < links; ++l)
    if (observer.references(int(l)) == 0) progress.note(o.log + ": link '" + one_line(observer.links()[l].name) + "' is found in no picture of the unloaded hand: are holes_px its holes?");
  if (seen.stamp_ns.empty()) throw InputError(o.log + ": has no pictures but of the unloaded hand");

  const auto truth = left_truth<HandTouches>(log);   // opened now that all estimates are made
  HandScore score;
  std::string table = "stamp_ns,link,name,y_mm,z_mm,y_low_mm,y_high_mm,area_mm2,peak_DN,mean_DN,u_px,v_px\n";
  Json contacts = Json::array(), told = Json::array();
  auto row = seen.rows.begin();
  for (const std::int64_t stamp : seen.stamp_ns) {
    HandEstimate e{stamp, {}, {}, {}, {}};
    for (; row != seen.rows.end() && row->stamp_ns == stamp; ++row) {
      const HandContact& c = row->contact;
      const std::string& name = observer.links()[std::size_t(c.link)].name;
      contacts.push_back({{"stamp_ns", stamp}, {"link", c.link}, {"name", name}, {"y_mm", number(1e3 * c.y_m)}, {"z_mm", number(1e3 * c.z_m)}, {"y_low_mm", number(1e3 * c.y_low_m)},
                          {"y_high_mm", number(1e3 * c.y_high_m)}, {"area_mm2", number(1e6 * c.area_m2)}, {"peak_DN", number(c.peak_DN)}, {"mean_DN", number(c.mean_DN)},
                          {"u_px", number(c.pixel.x())}, {"v_px", number(c.pixel.y())}});
      table += std::to_string(stamp) + ',' + std::to_string(c.link) + ',' + csv_text(name);
      for (const double v : {1e3 * c.y_m, 1e3 * c.z_m, 1e3 * c.y_low_m, 1e3 * c.y_high_m, 1e6 * c.area_m2, c.peak_DN, c.mean_DN, c.pixel.x(), c.pixel.y()}) table += ',' + csv_number(v);
      table += '\n';
      e.contacts.push_back(c);
    }
    if (truth) score.add(e, truth->at(stamp));
  }
  files.add("contacts.csv", table);
  files.add("contacts.svg", draw_places(observer, seen, truth));
  const auto frames = seen.stamp_ns.size();
  for (std::size_t l = 0; l < links; ++l) told.push_back({{"name", observer.links()[l].name}, {"seen", seen.frames_of_link[l]}, {"references", observer.references(int(l))}});
  const auto mae = score.found > 0 ? std::optional(1e3 * score.mae_m) : std::nullopt;
  if (o.json)
    return text_of(Json{{"frames", frames}, {"references", seen.references}, {"links", told},
                        {"score", truth ? Json{{"touches", score.touches}, {"found", score.found}, {"mae_mm", maybe(mae)}, {"unfounded", score.unfounded}} : Json(nullptr)},
                        {"contacts", contacts}}, 2) + "\n";
  std::string text = lumo::message(frames, " frames, ", seen.references, " pictures of the unloaded hand; ", seen.rows.size(), " contacts\n");
  for (std::size_t l = 0; l < links; ++l) {
    std::size_t count = 0;
    for (const Row& r : seen.rows) count += r.contact.link == int(l);
    text += lumo::message("  ", one_line(observer.links()[l].name), ": seen in ", seen.frames_of_link[l], " frames, ", count, " contacts\n");
  }
  if (truth)
    text += lumo::message("of ", score.touches, " touches with 5 N and more ", score.found, " found, mean error ", cell(mae.value_or(undefined), 2), " mm; ", score.unfounded, " of ",
                               score.contacts, " contacts where nothing touches\n");
  return text;
}

}  // namespace lumo::program
