// What the sensing library makes of logs of the virtual lab, over many seeds; the tables of results.md.
//   lumo_lab_study PAD_FILE FOLDER [seeds] [first seed] [bias_mm] [end_bias_mm]
// FOLDER gets curves against noise. bias_mm, and end_bias_mm near the pad's ends: the offset that the localisers assume
// of themselves, for choosing it (on other seeds than those of the tables). PAD_FILE: responses that `lumo lab …
// --cache DIR` left in DIR. One thread. Frames are painted and read in memory; they are those that `lumo lab` writes.

#include "charts/chart.hpp"
#include "lumo/lab/pad_file.hpp"
#include "lumo/lab/virtual_rig.hpp"
#include "lumo/sense/decode/bayes_decoder.hpp"
#include "lumo/sense/decode/decoder.hpp"
#include "lumo/sense/decode/gaussian_process_decoder.hpp"
#include "lumo/sense/decode/linear_decoder.hpp"
#include "lumo/sense/decode/nearest_template.hpp"
#include "lumo/sense/decode/segment_responses.hpp"
#include "lumo/sense/estimate.hpp"

#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <sstream>

using namespace lumo;
using namespace lumo::sense;

namespace {

/// The rig's pictures, painted once.
struct PaintedCamera {
  const VirtualRig* rig;
  const std::vector<Image>* images;
  std::size_t at = 0;

  std::optional<Frame> next() {
    if (at == images->size()) return std::nullopt;
    const FrameRecord& f = rig->frames()[at];
    const Frame frame{(*images)[at].view(), f.stamp_ns, f.exposure_s, f.gain, std::int64_t(at)};
    ++at;
    return frame;
  }
  StreamState state() const { return at == images->size() ? StreamState::ended : StreamState::open; }
};

struct Painted {
  explicit Painted(const VirtualRig& r) : rig(&r) {
    for (std::size_t k = 0; k < r.frames().size(); ++k) images.push_back(r.image(k));
  }
  PaintedCamera camera() const { return {rig, &images}; }

  const VirtualRig* rig;
  std::vector<Image> images;
};

LogTruth truth_of(const VirtualRig& rig) {
  std::istringstream table(truth_text(rig.truth()));
  return LogTruth::from_table(table, "truth");
}

/// Sums over the frames of one sequence.
struct Sequence {
  ForceScore score;
  int place = 0;
};

struct Totals {
  int samples = 0, located = 0, force_samples = 0;
  double location = 0.0, location_held = 0.0, force_held = 0.0;
  std::map<int, double> at_place;  ///< location error [m]
  std::map<int, double> held_at_place;
  std::map<int, int> at_place_count;
  std::vector<Sequence> sequences;

  double mae(ForceErrors::Error ForceErrors::*way) const {
    double sum = 0.0, count = 0.0;
    for (const Sequence& s : sequences) {
      sum += (s.score.errors.*way).mae_N * (s.score.errors.*way).samples;
      count += (s.score.errors.*way).samples;
    }
    return count > 0.0 ? sum / count : 0.0;
  }
  static double recovery(const std::vector<Sequence>& list, const std::vector<std::size_t>& chosen) {
    double gap = 0.0, won = 0.0;
    for (const std::size_t i : chosen) {
      const ForceErrors& e = list[i].score.errors;
      gap += (e.fixed_arm.mae_N - e.known_location.mae_N) * e.fixed_arm.samples;
      won += (e.fixed_arm.mae_N - e.optical.mae_N) * e.fixed_arm.samples;
    }
    return won / gap;
  }
  Interval recovery() const {
    std::vector<std::size_t> all(sequences.size());
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = i;
    Interval r{recovery(sequences, all)};
    std::mt19937 random(1);
    std::vector<double> drawn;
    for (int k = 0; k < 2000; ++k) {
      std::vector<std::size_t> some(all.size());
      for (auto& i : some) i = random() % all.size();
      drawn.push_back(recovery(sequences, some));
    }
    r.low = quantile(drawn, 0.025);
    r.high = quantile(drawn, 0.975);
    return r;
  }
};

template <class Make> void run_force(const Painted& log, Totals& totals, Make make, const FingerOptics& assumed) {
  const VirtualRig& rig = *log.rig;
  const Recording recording{"lab", rig.session(), rig.frames(), rig.joints(), {}, {}, {}};
  const auto camera = [&] { return log.camera(); };
  const FingerModel<> finger = known_finger(recording, camera, assumed);
  const auto estimates = estimate(recording, camera, finger, make);
  const PadRange tested{finger.link, -25.0_mm, 25.0_mm};
  const LogTruth truth = truth_of(rig);
  const LocationScore where = location_score(estimates, truth, 5.0);
  totals.samples += where.samples;
  totals.located += where.located;
  totals.location += where.mae_m * where.located;
  totals.location_held += where.coverage_90 * where.located;
  for (int c = 0; c < int(rig.plan().contacts.size()); ++c) {
    std::vector<FrameEstimate> part;
    for (std::size_t k = 0; k < estimates.size(); ++k)
      if (rig.truth()[k].contact == c) part.push_back(estimates[k]);
    const LocationScore there = location_score(part, truth, 5.0);
    const int place = rig.plan().contacts[std::size_t(c)].place;
    totals.held_at_place[place] += there.coverage_90 * there.located;
    totals.at_place[place] += there.mae_m * there.located;
    totals.at_place_count[place] += there.located;
    totals.sequences.push_back(
        {force_score(part, truth, finger.jacobian, tested, finger.joints.torque[0].noise_Nm), place});
    totals.force_samples += totals.sequences.back().score.samples;
    totals.force_held += totals.sequences.back().score.coverage_90 * totals.sequences.back().score.samples;
  }
}

void print(const char* name, double noise, const Totals& t) {
  const Interval r = t.recovery();
  std::printf("| %s | %g | %d | %.1f | %.2f | %.1f | %d | %.2f | %.2f | %.2f | %.2f | %.1f | %.1f (%.1f … %.1f) |\n",
      name, noise, t.samples, 100.0 * t.located / std::max(1, t.samples), 1e3 * t.location / std::max(1, t.located),
      100.0 * t.location_held / std::max(1, t.located), t.force_samples, t.mae(&ForceErrors::known_location),
      t.mae(&ForceErrors::optical), t.mae(&ForceErrors::fixed_arm), t.mae(&ForceErrors::fused),
      100.0 * t.force_held / std::max(1, t.force_samples), 100.0 * r.value, 100.0 * r.low, 100.0 * r.high);
  std::printf("    mean location error by place [mm]:");
  for (const auto& [place, sum] : t.at_place) std::printf(" %.2f", 1e3 * sum / std::max(1, t.at_place_count.at(place)));
  std::printf("; 90 %% holds [%%]:");
  for (const auto& [place, sum] : t.held_at_place)
    std::printf(" %.0f", 100.0 * sum / std::max(1, t.at_place_count.at(place)));
  std::printf("\n");
  std::fflush(stdout);
}

/// What decoders say of the same folds.
struct Tally {
  int right = 0, all = 0;
  void add(const DecodingReport& r) {
    right += int(std::lround(r.accuracy.value * double(r.predictions.size())));
    all += int(r.predictions.size());
  }
  double percent() const { return 100.0 * right / std::max(1, all); }
};

void draw_curves(const std::string& file, const char* title, const char* of, const char* quantity,
    std::vector<program::Curve> curves) {
  program::LineChart chart{title, of, "noise of the virtual rig, times the assumed one", quantity, {}};
  chart.curves = std::move(curves);
  if (!(std::ofstream(file) << program::draw(chart)).flush())
    std::fprintf(stderr, "%s: cannot be written\n", file.c_str());
}

constexpr std::array<double, 4> noises = {0.5, 1.0, 2.0, 4.0};  // times the assumed one

/// A computed pad, and the seeds of its logs.
struct Study {
  const PadLight& light;
  int first, seeds;
  FingerOptics assumed = {};  ///< what the localisers assume of their bias
};

void study_location_and_force(const Study& study, const std::string& folder) {
  std::vector<program::Curve> errors{{"probabilistic", std::string(program::palette[0]), {}, 2.0, true},
      {"peak", std::string(program::palette[1]), {}, 2.0, true}},
      gaps = errors;
  std::printf(
      "| localiser | noise | frames ≥ 5 N | located %% | error mm | 90 %% holds %% | frames | known N | optical N | "
      "fixed arm N | fused N | fused 90 %% holds %% | gap recovered %% |\n");
  for (const double noise : noises) {
    Totals a, b;
    for (int s = study.first; s < study.first + study.seeds; ++s) {
      const VirtualRig rig(study.light, force_plan(), std::uint64_t(s), noise);
      const Painted log(rig);
      run_force(log, a, bayes_localizer, study.assumed);
      run_force(log, b, peak_localizer, study.assumed);
    }
    print("probabilistic", noise, a);
    print("peak", noise, b);
    for (std::size_t k = 0; k < 2; ++k) {
      const Totals& t = k == 0 ? a : b;
      errors[k].points.push_back({noise, 1e3 * t.location / std::max(1, t.located)});
      gaps[k].points.push_back({noise, 100.0 * t.recovery().value});
    }
  }
  draw_curves(folder + "/location_against_noise.svg", "Error of location",
      "baseline design, Solaris, 10 mm sphere, at 5 N and more", "mean error [mm]", errors);
  draw_curves(folder + "/gap_against_noise.svg", "Way from a fixed arm to the known place, recovered by the place seen",
      "baseline design, Solaris, 10 mm sphere, all frames in contact", "gap recovered [%]", gaps);
}

/// Means over wide bins from those over fine ones.
Eigen::MatrixXd shares(const LongitudinalBins& wide, const LongitudinalBins& fine) {
  Eigen::MatrixXd share(wide.size(), fine.size());
  for (Eigen::Index i = 0; i < wide.size(); ++i)
    for (Eigen::Index j = 0; j < fine.size(); ++j)
      share(i, j) = std::max(0.0, std::min(wide.edges_m[i + 1], fine.edges_m[j + 1]) -
                                      std::max(wide.edges_m[i], fine.edges_m[j])) /
                    (wide.edges_m[i + 1] - wide.edges_m[i]);
  return share;
}

/// What all decoders and metrics say of re-contacts at one noise.
struct Decoding {
  Tally nearest, linear, process, filter;
  std::vector<double> D, W, Q;

  void add(const VirtualRig& rig) {
    VirtualCamera start(rig), camera(rig);
    const FingerView view = view_finger(start, rig.session(), UnloadedStretch::of(rig.session(), 0), "lab");
    const LongitudinalBins bins = LongitudinalBins::uniform(-27.5_mm, 27.5_mm, 55);
    GreenProfile fine = view.readout(bins);
    const std::vector<Profile> profiles = read_profiles(camera, fine);
    const RecontactMetrics m = recontact_metrics(slope_profiles(hold_responses(profiles, rig.session().segments)));
    D.push_back(m.D_neighbor);
    W.push_back(m.W_recontact);
    Q.push_back(m.Q.value_or(0.0));
    const Eigen::MatrixXd share = shares(LongitudinalBins::parts(), bins);
    std::vector<Profile> parts;
    for (const Profile& p : profiles) parts.push_back({p.stamp_ns, share * p.value});
    const auto holds = hold_responses(parts, rig.session().segments);
    const DecodingTask task = decoding_task(holds, {2.0, 5.0});
    const std::vector<double> loads = common_loads(holds, 2.0);
    const DecodingTask whole = decoding_task(holds, loads);
    nearest.add(cross_validate(NearestTemplate{}, task.data, task.fold));
    linear.add(cross_validate(LinearDecoder{}, task.data, task.fold));
    process.add(cross_validate(GaussianProcessDecoder{}, task.data, task.fold));
    filter.add(cross_validate(BayesDecoder{int(loads.size()) - 1}, whole.data, whole.fold));
  }
};

void study_decoding(const Study& study) {
  std::printf(
      "\n| noise | predictions | right %%: nearest | Wilson 95 %% | linear | Gaussian process | Bayes filter | "
      "D_neighbor DN/N | W_recontact DN/N | Q |\n");
  for (const double noise : noises) {
    Decoding d;
    for (int s = study.first; s < study.first + study.seeds; ++s)
      d.add(VirtualRig(study.light, recontact_plan(), std::uint64_t(s), noise));
    const Interval w = wilson_interval(d.nearest.right, d.nearest.all);
    std::printf("| %g | %d | %.2f | %.2f … %.2f | %.2f | %.2f | %.2f | %.3f | %.3f | %.1f |\n", noise, d.nearest.all,
        100.0 * w.value, 100.0 * w.low, 100.0 * w.high, d.linear.percent(), d.process.percent(), d.filter.percent(),
        median(d.D), median(d.W), median(d.Q));
    std::fflush(stdout);
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3)
    return std::fprintf(stderr, "usage: lumo_lab_study PAD_FILE FOLDER [seeds] [first seed] [bias_mm] [end_bias_mm]\n"),
           2;
  const std::string folder = argv[2];
  if (!std::filesystem::is_directory(folder)) return std::fprintf(stderr, "%s: no such folder\n", argv[2]), 5;
  const int seeds = argc > 3 ? std::atoi(argv[3]) : 50, first = argc > 4 ? std::atoi(argv[4]) : 1;
  FingerOptics assumed;
  if (argc > 5) assumed.bias_sigma_m = 1e-3 * std::atof(argv[5]);
  if (argc > 6) assumed.end_bias_sigma_m = 1e-3 * std::atof(argv[6]);
  const auto kept = read_pad_responses(argv[1]);
  if (!kept) return std::fprintf(stderr, "%s: no such file\n", argv[1]), 5;
  const PadLight light(*kept);
  const Study study{light, first, seeds, assumed};
  study_location_and_force(study, folder);
  study_decoding(study);
}
