#include "computing/section.hpp"

#include "console/text.hpp"

#include "lumo/morphology/finger.hpp"

namespace lumo::program {

SectionDrawing make_section(const Pad& design) {
  using Fill = SectionDrawing::Fill;
  using Along = SectionDrawing::Dimension::Along;
  const FingerDesign d = FingerDesign::from(design.theta_mm);
  const PadDimensions pad;
  const FingerOptions::Leds leds;
  const double w = 0.5 * pad.width, stem = 0.5 * d.w_s, outer = stem + d.w_v, top = d.h_fp + d.h_ep, plate = 3.0;

  const HalfSection half = half_section(d, Twin::none, {0.3e-3, 0.05}, pad);
  std::vector<Point> outline = {{-w, 0.0}, {w, 0.0}};
  for (std::size_t i = 0; i < half.x.size(); ++i)
    if (half.tag[i] == SectionTag::dome) outline.push_back({1e3 * half.x[i], 1e3 * half.z[i]});
  for (std::size_t i = outline.size(); i-- > 2;) outline.push_back({-outline[i][0], outline[i][1]});
  const auto insert_apex = outline.begin() + std::ptrdiff_t(2 + (outline.size() - 2) / 2);
  outline.insert(insert_apex, {0.0, top});

  const auto box = [](double x0, double x1, double z0, double z1) {
    return std::vector<Point>{{x0, z0}, {x1, z0}, {x1, z1}, {x0, z1}};
  };
  SectionDrawing s;
  s.title = "Finger cross-section";
  s.subtitle = "θ = [h_fp, h_ep, w_s, h_s, w_v] = [";
  for (std::size_t i = 0; i < 5; ++i) s.subtitle += (i > 0 ? ", " : "") + short_number(design.theta_mm[i]);
  s.subtitle += "] mm, " + design.material;
  s.areas.push_back({Fill::silicone, outline});
  if (d.w_v > 0.0)
    for (const double side : {-1.0, 1.0}) s.areas.push_back({Fill::air, box(side * stem, side * outer, 0.0, d.h_s)});
  s.areas.push_back({Fill::carrier, box(-w, w, -plate, 0.0)});
  s.areas.push_back({Fill::carrier, box(-stem, stem, 0.0, d.h_s)});
  s.areas.push_back({Fill::led, box(-0.5e3 * leds.width_x, 0.5e3 * leds.width_x, d.h_s - 0.5, d.h_s)});

  const auto label = [](const char* what, double mm) { return std::string(what) + " = " + short_number(mm) + " mm"; };
  // Smallest thickness, drawn where it is found: above the outer edge of the voids, or beside them at the height of the
  // stem.
  const double vertical = vertical_thickness(d, pad), horizontal = horizontal_thickness(d, pad);
  if (vertical <= horizontal)
    s.dimensions.push_back({Along::z, {outer, d.h_s}, {outer, d.h_s + vertical}, 0.0, label("t_min", vertical)});
  else s.dimensions.push_back({Along::x, {outer, d.h_s}, {outer + horizontal, d.h_s}, 0.0, label("t_min", horizontal)});
  s.dimensions.push_back({Along::z, {w, 0.0}, {w, d.h_fp}, 2.5, label("h_fp", d.h_fp)});
  s.dimensions.push_back({Along::z, {w, d.h_fp}, {0.0, top}, 2.5, label("h_ep", d.h_ep)});
  s.dimensions.push_back({Along::z, {-stem, 0.0}, {-stem, d.h_s}, -(w - stem) - 2.5, label("h_s", d.h_s)});
  s.dimensions.push_back({Along::x, {-stem, -plate}, {stem, -plate}, -2.2, label("w_s", d.w_s)});
  if (d.w_v > 0.0) s.dimensions.push_back({Along::x, {stem, -plate}, {outer, -plate}, -4.4, label("w_v", d.w_v)});
  s.dimensions.push_back({Along::x, {-w, -plate}, {w, -plate}, d.w_v > 0.0 ? -6.6 : -4.4, label("W", pad.width)});
  return s;
}

}  // namespace lumo::program
