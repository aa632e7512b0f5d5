#include "sensing/known_pad.hpp"

#include "console/text.hpp"
#include "sensing/checks.hpp"

#include "lumo/lab/pad_file.hpp"
#include "lumo/lab/pad_templates.hpp"
#include "lumo/sense/decode/segment_responses.hpp"

#include <cmath>
#include <utility>

namespace lumo::program {

namespace {

/// Where the session has its LEDs.
std::vector<double> lamps_of(const Session& s) {
  std::vector<double> y_m;
  for (int k = 0; k < s.led_count; ++k) y_m.push_back(s.led_first_y_m + k * s.led_pitch_m);
  return y_m;
}

}  // namespace

TemplateLocalizer KnownPad::localizer(const FingerOptics& finger, const Session& session) const {
  return about(path, [&] { return TemplateLocalizer(template_config(finger, templates, lamps_of(session), source)); });
}

KnownPad computed_pad(const std::string& file) {
  const auto kept = read_pad_responses(file);
  if (!kept) throw InputError(file + ": no such file; lumo lab … --cache DIR keeps a pad's responses in DIR");
  return {file, TemplateSource::computed, templates_of(*kept), kept->material, kept->theta_mm};
}

KnownPad recorded_pad(const std::string& path, Progress& progress, const McapTopics& topics) {
  progress.stage("reading the calibration");
  const SensedLog s = read_sensed_log(path, SensedLog{}.bins, progress, topics);
  std::vector<PressedResponse> pressed;
  for (const HoldResponse& h : measured_holds(s, progress))
    if (const double nominal_N = h.segment.load_N; std::isfinite(h.segment.y_mm) && nominal_N > 0.0)
      pressed.push_back({1e-3 * h.segment.y_mm, nominal_N, h.response * (nominal_N / h.load_N)});
  if (pressed.empty())
    throw InputError(path +
                     ": has no holds at known places, which lumo lab recontact shows and docs/log_format.md "
                     "describes (segments of kind hold with y_mm and load_N)");
  ResponseTemplates templates = about(path, [&] { return recorded_templates(s.bins.centres_m(), pressed); });
  return {path, TemplateSource::recorded, std::move(templates), s.log.session.material, s.log.session.theta_mm};
}

std::optional<std::array<Sensibility, 2>> sensibility_of(const KnownPad& pad) {
  if (pad.source == TemplateSource::recorded) return std::nullopt;
  const TemplateLocalizer localizer =
      about(pad.path, [&] { return unseen_localizer(pad.templates, SensedLog{}.bins.centres_m(), lamps_of({})); });
  return std::array{sensibility(localizer, 2.0), sensibility(localizer, sensible_load_N)};
}

std::string sensibility_text(const KnownPad& pad) {
  const auto both = sensibility_of(pad);
  if (!both) return "";
  std::string text = "pad " + pad.path + " (" + joined(pad.theta_mm) + " mm, " + pad.material + "): ";
  for (const Sensibility& s : *both)
    text += lumo::message("at ", s.load_N, " N ", cell(100.0 * s.share, 0), " % of the places within ±",
        1e3 * sensible_reach_m, " mm can be located to ±", 1e3 * good_half_width_m, " mm (90 %)",
        s.load_N < sensible_load_N ? ", " : "");
  return text + (is_sensible((*both)[1]) ? "\n" : ": this pad is insensible\n");
}

Json sensibility_json(const KnownPad& pad) {
  Json j = {{"responses", pad.path}, {"recorded", pad.source == TemplateSource::recorded}, {"insensible", nullptr}};
  const auto both = sensibility_of(pad);
  if (!both) return j;
  j["insensible"] = !is_sensible((*both)[1]);
  for (const Sensibility& s : *both)
    j["at"].push_back({{"load_N", s.load_N}, {"located_share", number(s.share)},
        {"half_width_mm", s.half_width_m > 0.0 ? number(1e3 * s.half_width_m) : Json(nullptr)}});
  return j;
}

void tell_other_pad(const KnownPad& pad, const Session& session, const std::string& log, Progress& progress) {
  const bool other_theta = !session.theta_mm.empty() && !pad.theta_mm.empty() && session.theta_mm != pad.theta_mm,
             other_silicone = !session.material.empty() && !pad.material.empty() && session.material != pad.material;
  if (!other_theta && !other_silicone) return;
  progress.note(log + " is of a pad " + joined(session.theta_mm) + " mm, " + session.material + "; " + pad.path +
                " of " + joined(pad.theta_mm) + " mm, " + pad.material);
}

}  // namespace lumo::program
