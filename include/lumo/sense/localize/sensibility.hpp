#pragma once

#include "lumo/core/statistics.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/localize/template_localizer.hpp"

#include <cmath>
#include <cstdint>
#include <vector>

namespace lumo::sense {

/// How well contacts at one load can be located, by what the localiser says of its own templates.
struct Sensibility {
  double load_N = 0.0;
  double share = 0.0;         ///< of the places, at which a contact is located within `good_half_width_m`
  double half_width_m = 0.0;  ///< of the 90 % interval, median over the places with a location; 0: none has one
};

inline constexpr double good_half_width_m = 5.0_mm;  ///< of a 90 % interval: the width of the paper's regions
inline constexpr double least_sensible_share = 0.5;  ///< of the places; below, a pad is called insensible
inline constexpr double sensible_reach_m = 24.0_mm;  ///< places to both sides of the middle
inline constexpr double sensible_load_N = 5.0;       ///< at which a pad is judged

/// No picture is needed: templates and covariance alone decide which places can be distinguished.
inline Sensibility sensibility(TemplateLocalizer localizer, double load_N) {
  constexpr double half_of_90_percent = 1.6448536269514722;
  Sensibility s{load_N};
  std::vector<double> half_widths;
  int places = 0, good = 0;
  std::int64_t stamp_ns = 0;
  const Eigen::VectorXd grid = localizer.grid_m();
  localizer.reset();
  for (const double y : grid) {
    if (std::abs(y) > sensible_reach_m) continue;
    ++places;
    localizer.reset();
    const LocationEstimate e = localizer.update({++stamp_ns, localizer.expected(y, load_N), 0.0});
    if (e.contacts != 1) continue;
    half_widths.push_back(half_of_90_percent * std::sqrt(e.contact[0].variance_m2));
    good += half_widths.back() <= good_half_width_m;
  }
  if (places > 0) s.share = double(good) / places;
  if (!half_widths.empty()) s.half_width_m = median(half_widths);
  return s;
}

/// Can contacts on the pad be located at all?
inline bool is_sensible(const Sensibility& s) { return s.share >= least_sensible_share; }

/// The localiser of computed templates before any picture is seen: its light at rest has the mean `level_DN`, and a
/// value scatters by `noise_DN`, as in pictures of 640 × 480 (assumed). Throws InvalidArgument for templates without
/// light at rest.
inline TemplateLocalizer unseen_localizer(const ResponseTemplates& templates, const Eigen::VectorXd& position_m,
    const std::vector<double>& lamp_m, double level_DN = 70.0, double noise_DN = 0.2) {
  TemplateLocalizer::Config c;
  c.position_m = position_m;
  c.noise = Eigen::VectorXd::Constant(position_m.size(), noise_DN);
  c.templates = templates;
  c.unloaded = TemplateField(templates).unloaded_at(position_m);
  if (c.unloaded.size() == 0)
    throw InvalidArgument("templates have no light at rest, which gives responses their size");
  const double scale = level_DN / c.unloaded.mean();
  c.unloaded *= scale;
  for (auto* list : {&c.templates.value, &c.templates.sideways})
    for (Eigen::MatrixXd& m : *list) m *= scale;
  c.lamp_m = lamp_m;
  return TemplateLocalizer(c);
}

}  // namespace lumo::sense
