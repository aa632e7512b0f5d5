// Which localiser finds contacts on which pad, and what it says of responses that are not the pad's.
//   lumo_localizer_study [--seeds N] [--first N] [--contacts N] [--disturb NAME] [--other PAD] LOG_PAD=TEMPLATE_PAD …
// Each pair is two files that `lumo lab … --cache DIR` left in DIR: a virtual rig presses the first pad at places drawn
// at random, and the localiser that knows its pad is given the second, computed with other settings. --other: a pad
// whose responses are tried as another's. --disturb: exposure, assembly, lamps, room, shadow, slide, creep, stiffness
// or all. "recorded": templates from a calibration of the log's own finger. Replicates are pads, seeds and places;
// frames of one hold are averaged over.

#include "lumo/core/stopwatch.hpp"
#include "lumo/lab/pad_file.hpp"
#include "lumo/lab/pad_templates.hpp"
#include "lumo/lab/virtual_rig.hpp"
#include "lumo/sense/decode/segment_responses.hpp"
#include "lumo/sense/estimate.hpp"
#include "lumo/sense/localize/sensibility.hpp"
#include "lumo/sense/localize/template_localizer.hpp"

#include <array>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <map>
#include <string>
#include <vector>

using namespace lumo;
using namespace lumo::sense;

namespace {

constexpr double false_m = 8.0_mm;  ///< a confident place farther off is a false one
constexpr std::array<double, 4> loads_N{2.0, 5.0, 10.0, 15.0};

/// Contacts at places drawn at random within ±24 mm, each with all loads.
LabPlan random_plan(int contacts, std::uint64_t seed) {
  RandomStream draws(seed, 4711);
  LabPlan plan{"random places", 0.0, {}};
  plan.frames_per_s = 10.0;
  for (int k = 0; k < contacts; ++k)
    plan.contacts.push_back({k, 24.0_mm * (2.0 * draws.uniform() - 1.0), 0,
        lab_holds({loads_N.begin(), loads_N.end()}, 0.3, 0.9), 0.0, 1.0});
  return plan;
}

/// What one log shows: profiles, what is known of the finger, and the truth.
struct Seen {
  FingerOptics optics;
  std::vector<Profile> profiles;
  std::vector<TruthSample> truth;
};

Seen seen_in(const VirtualRig& rig) {
  Seen s;
  const UnloadedStretch rest = UnloadedStretch::of(rig.session(), 0);
  VirtualCamera start(rig), camera(rig);
  s.optics.view = view_finger(start, rig.session(), rest, "lab");
  GreenProfile readout = s.optics.readout();
  s.profiles = read_profiles(camera, readout);
  s.optics.unloaded = unloaded_reference(s.profiles, rest, "lab", s.optics.view.repeats(s.optics.bins));
  s.truth = rig.truth();
  return s;
}

/// The log with every response multiplied.
Seen scaled(Seen s, double factor) {
  for (Profile& p : s.profiles) p.value = s.optics.unloaded.mean() + factor * (p.value - s.optics.unloaded.mean());
  return s;
}

/// Of frames at one load (or at and above it).
struct Tally {
  int frames = 0, located = 0, unknown = 0, held = 0, false_places = 0, confident = 0;
  std::vector<double> off_m, error_m;  ///< of each; mean of each hold, signed
  void add(const Tally& o) {
    frames += o.frames;
    located += o.located;
    unknown += o.unknown;
    held += o.held;
    false_places += o.false_places;
    confident += o.confident;
    off_m.insert(off_m.end(), o.off_m.begin(), o.off_m.end());
    error_m.insert(error_m.end(), o.error_m.begin(), o.error_m.end());
  }
};

using Maker = std::function<std::vector<FrameEstimate>(const Seen&)>;

/// By load.
std::map<double, Tally> judge(const Seen& s, const Maker& make) {
  const std::vector<FrameEstimate> found = make(s);
  std::map<double, Tally> by_load;
  std::map<std::pair<int, double>, std::vector<double>> holds;
  for (std::size_t k = 0; k < found.size(); ++k) {
    const TruthSample& t = s.truth[k];
    double load = 0.0;
    if (t.contact >= 0)
      for (const double f : loads_N)
        if (std::abs(t.force_N - f) < 0.03 * f + 0.01) load = f;
    if (t.contact >= 0 && load == 0.0) continue;
    Tally& tally = by_load[load];
    ++tally.frames;
    tally.unknown += found[k].location.unknown;
    const auto at = found[k].contact();
    if (!at) continue;
    ++tally.located;
    if (t.contact < 0) continue;
    const double off = at->y_m - t.y_m, half = sigmas_of_90_percent * std::sqrt(at->variance_m2);
    tally.off_m.push_back(std::abs(off));
    tally.held += std::abs(off) <= half;
    tally.confident += half <= good_half_width_m;
    tally.false_places += std::abs(off) > false_m && half <= good_half_width_m;
    holds[{t.contact, load}].push_back(off);
  }
  for (const auto& [hold, offs] : holds) {
    double sum = 0.0;
    for (const double o : offs) sum += o;
    by_load[hold.second].error_m.push_back(sum / double(offs.size()));
  }
  return by_load;
}

void print(const std::string& pad, const char* way, double load, const Tally& t) {
  double bias = 0.0, spread = 0.0;
  const double n = std::max<double>(1.0, double(t.error_m.size()));
  for (const double e : t.error_m) bias += e / n;
  for (const double e : t.error_m) spread += (e - bias) * (e - bias) / n;
  const double located = std::max(1, t.located);
  std::printf("| %s | %s | %g | %d | %.1f | %.1f | %+.2f | %.2f | %.2f | %.2f | %.1f | %.2f |\n", pad.c_str(), way,
      load, t.frames, 100.0 * t.located / std::max(1, t.frames), 100.0 * t.unknown / std::max(1, t.frames), 1e3 * bias,
      1e3 * std::sqrt(spread), t.off_m.empty() ? 0.0 : 1e3 * quantile(t.off_m, 0.5),
      t.off_m.empty() ? 0.0 : 1e3 * quantile(t.off_m, 0.95), 100.0 * t.held / located,
      100.0 * t.false_places / std::max(1, t.confident));
  std::fflush(stdout);
}

/// The rig of a study: what each disturbance alone, or all, do.
Rig rig_with(const std::string& disturbance) {
  Rig rig;
  const bool all = disturbance == "all";
  rig.camera.exposure_DN = disturbance == "exposure" || all ? 1.4e5 : 0.0;
  if (disturbance == "assembly" || all) rig.assembly = {1.0_mm, 0.5_mm, 0.02, 0.1};
  if (disturbance == "lamps" || all) rig.light.one_lamp_sigma = 0.005;
  if (disturbance == "room" || all) rig.light.ambient_DN *= 2.0;
  if (disturbance == "shadow" || all) rig.light.shadow = 0.3;
  if (disturbance == "slide" || all) rig.contact.slide_m = 2.0_mm;
  if (disturbance == "stiffness" || all) rig.specimen.stiffness = 1.1;
  if (disturbance == "creep" || all)
    for (double& part : rig.silicone.part) part *= 2.0;
  return rig;
}

const std::vector<double> lamp_m{-22.0_mm, -11.0_mm, 0.0, 11.0_mm, 22.0_mm};

/// The localiser that knows its pad.
Maker knowing(const ResponseTemplates& templates, TemplateSource source = TemplateSource::computed) {
  return [templates, source](const Seen& s) {
    return locate(s.profiles, s.optics,
        [&](const FingerOptics& o) { return TemplateLocalizer(template_config(o, templates, lamp_m, source)); });
  };
}

/// Templates that this very finger's calibration records: places 6 mm apart, each load once.
ResponseTemplates recorded(const PadLight& light, std::uint64_t seed, const Rig& rig) {
  LabPlan plan{"calibration", 0.0, {}};
  for (int k = 0; k < 9; ++k)
    plan.contacts.push_back({k, 6.0_mm * (k - 4), 0, lab_holds({loads_N.begin(), loads_N.end()}, 0.3, 0.9), 0.0, 1.0});
  plan.frames_per_s = 10.0;
  Rig careful = rig;
  careful.contact.slide_m = 0.0;
  const VirtualRig made(light, plan, seed, 1.0, careful);
  const Seen seen = seen_in(made);
  std::vector<PressedResponse> pressed;
  for (const HoldResponse& h : hold_responses(seen.profiles, made.session().segments))
    pressed.push_back({1e-3 * h.segment.y_mm, h.load_N, h.response});
  return recorded_templates(seen.optics.readout().positions_m(), pressed);
}

/// Of one response [ms].
double median_ms(const Seen& s, const ResponseTemplates& templates) {
  TemplateLocalizer localizer(template_config(s.optics, templates, lamp_m));
  std::vector<double> times_ms;
  for (Profile p : s.profiles) {
    s.optics.unloaded.subtract(p);
    const Stopwatch watch;
    localizer.update(p);
    times_ms.push_back(1e3 * watch.seconds());
  }
  return median(times_ms);
}

using Tallies = std::map<std::string, std::map<double, Tally>>;

/// All localisers on the log of one seed.
void add_log(Tallies& all, const ResponseTemplates& templates, const Seen& seen) {
  const auto add = [&](const char* name, const Seen& s, const Maker& make) {
    for (const auto& [load, tally] : judge(s, make)) all[name][load].add(tally);
  };
  add("bayes", seen, [](const Seen& s) { return locate(s.profiles, s.optics, bayes_localizer); });
  add("peak", seen, [](const Seen& s) { return locate(s.profiles, s.optics, peak_localizer); });
  add("pad", seen, knowing(templates));
  add("pad, inverted", scaled(seen, -1.0), knowing(templates));
  add("pad, x -0.3", scaled(seen, -0.3), knowing(templates));
}

}  // namespace

int main(int argc, char** argv) {
  int seeds = 3, first = 1, contacts = 12;
  std::vector<std::pair<std::string, std::string>> pairs;
  std::string other, disturbance;
  for (int k = 1; k < argc; ++k) {
    const std::string a = argv[k];
    if (a == "--seeds") seeds = std::atoi(argv[++k]);
    else if (a == "--first") first = std::atoi(argv[++k]);
    else if (a == "--contacts") contacts = std::atoi(argv[++k]);
    else if (a == "--other") other = argv[++k];
    else if (a == "--disturb") disturbance = argv[++k];
    else pairs.emplace_back(a.substr(0, a.find('=')), a.substr(a.find('=') + 1));
  }
  std::printf(
      "| pad | localiser | N | frames | located %% | unknown %% | bias mm | spread mm | median mm | 95 %% mm | 90 %% "
      "holds %% | false %% |\n");
  for (const auto& [log_file, template_file] : pairs) {
    const auto log_pad = read_pad_responses(log_file), template_pad = read_pad_responses(template_file);
    if (!log_pad || !template_pad) return std::fprintf(stderr, "%s: no such pad\n", log_file.c_str()), 5;
    const PadLight light(*log_pad);
    const ResponseTemplates templates = templates_of(*template_pad);
    const Rig rig = rig_with(disturbance);
    Tallies all;
    for (int k = first; k < first + seeds; ++k) {
      const auto seed = std::uint64_t(k);
      const VirtualRig made(light, random_plan(contacts, seed), seed, 1.0, rig);
      const Seen seen = seen_in(made);
      add_log(all, templates, seen);
      for (const auto& [load, tally] : judge(seen, knowing(recorded(light, seed, rig), TemplateSource::recorded)))
        all["recorded"][load].add(tally);
      if (!other.empty())
        for (const auto& [load, tally] : judge(seen, knowing(templates_of(*read_pad_responses(other)))))
          all["other pad's templates"][load].add(tally);
      if (k == first)
        std::printf("%s: of the places %.0f %% within 5 mm at 2 N, %.0f %% at 5 N by the templates alone; %.3f ms\n",
            template_file.c_str(),
            100.0 * sensibility(unseen_localizer(templates, seen.optics.readout().positions_m(), lamp_m), 2.0).share,
            100.0 * sensibility(unseen_localizer(templates, seen.optics.readout().positions_m(), lamp_m), 5.0).share,
            median_ms(seen, templates));
    }
    for (const auto& [name, by_load] : all)
      for (const auto& [load, tally] : by_load)
        print(log_file.substr(log_file.rfind('/') + 1), name.c_str(), load, tally);
  }
}
