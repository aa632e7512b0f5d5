#include "computing/section.hpp"

#include "console/text.hpp"

#include "lumo/morphology/finger.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace lumo::program {

namespace {

using Fill = SectionDrawing::Fill;
using Along = SectionDrawing::Dimension::Along;

std::vector<Point> box(double x0, double x1, double z0, double z1) { return {{x0, z0}, {x1, z0}, {x1, z1}, {x0, z1}}; }

/// A half of an outline, from the middle to the middle, and its mirror image.
std::vector<Point> with_image(std::vector<Point> half) {
  for (std::size_t i = half.size(); i-- > 0;)
    if (half[i][0] > 0.0) half.push_back({-half[i][0], half[i][1]});
  return half;
}

/// The silicone's envelope: what lies in it is painted over it.
std::vector<Point> envelope(const FingerDesign& d, const PadDimensions& pad) {
  const HalfSection half = half_section(d, Twin::none, {0.3e-3, 0.05}, pad);
  std::vector<Point> outline = {{0.5 * pad.width, -pad.shoulder_height}};
  for (std::size_t i = 0; i < half.x.size(); ++i)
    if (half.tag[i] == SectionTag::dome) outline.push_back({1e3 * half.x[i], 1e3 * half.z[i]});
  outline.push_back({0.0, d.h_fp + d.h_ep});
  outline = with_image(std::move(outline));
  std::rotate(outline.begin(), outline.end() - 1, outline.end());  // the base first
  return outline;
}

std::string label(const char* what, double mm) { return std::string(what) + " = " + short_number(mm) + " mm"; }

/// The smallest thickness, drawn where it is found.
SectionDrawing::Dimension thinnest(const FingerDesign& d, const PadDimensions& pad) {
  const double outer = 0.5 * d.w_s + d.w_v;
  if (pad.thickness == Thickness::euclidean) {
    const double thin = euclidean_thickness(d, pad), a = 0.5 * pad.width;
    Point nearest{a, d.h_fp};  // of the ellipse to the cavity's corner
    const auto away = [&](const Point& p) { return std::hypot(p[0] - outer, p[1] - d.h_s); };
    for (int k = 1; k <= 2000; ++k) {
      const double t = 0.5 * pi * k / 2000;
      if (const Point p{a * std::cos(t), d.h_fp + d.h_ep * std::sin(t)}; away(p) < away(nearest)) nearest = p;
    }
    if (thin < a - outer) return {Along::straight, {outer, d.h_s}, nearest, 0.0, label("t_min", thin)};
    return {Along::x, {outer, d.h_s}, {a, d.h_s}, 0.0, label("t_min", thin)};
  }
  // above the outer edge of the voids, or beside them at the height of the stem
  const double vertical = vertical_thickness(d, pad), horizontal = horizontal_thickness(d, pad);
  if (vertical <= horizontal)
    return {Along::z, {outer, d.h_s}, {outer, d.h_s + vertical}, 0.0, label("t_min", vertical)};
  return {Along::x, {outer, d.h_s}, {outer + horizontal, d.h_s}, 0.0, label("t_min", horizontal)};
}

std::vector<SectionDrawing::Area> areas_of(const FingerDesign& d, const FingerOptions& o, double plate) {
  const PadDimensions& pad = o.pad;
  const double w = 0.5 * pad.width, stem = 0.5 * d.w_s, outer = stem + d.w_v;
  const double floor = d.h_s - 1e3 * o.recess.depth, led = 0.5e3 * o.leds.width_x;
  std::vector<SectionDrawing::Area> areas = {{Fill::silicone, envelope(d, pad)}};
  if (d.w_v > 0.0)
    for (const double side : {-1.0, 1.0}) areas.push_back({Fill::air, box(side * stem, side * outer, 0.0, d.h_s)});
  if (pad.shoulder_height > 0.0) {
    std::vector<Point> stair;
    for (const auto& p : carrier_outline(d, pad)) stair.push_back({1e3 * p[0], 1e3 * p[1]});
    areas.push_back({Fill::carrier, with_image(std::move(stair))});
  } else {
    areas.push_back({Fill::carrier, box(-w, w, -plate, 0.0)});
    areas.push_back({Fill::carrier, box(-stem, stem, 0.0, d.h_s)});
  }
  if (o.recess.depth > 0.0) areas.push_back({Fill::air, box(-stem, stem, floor, d.h_s)});
  areas.push_back({Fill::led, box(-led, led, floor - 0.5, floor)});
  return areas;
}

}  // namespace

SectionDrawing make_section(const Pad& design) {
  const FingerDesign d = design.design();
  const PadDimensions& pad = design.finger.pad;
  const double w = 0.5 * pad.width, stem = 0.5 * d.w_s, outer = stem + d.w_v, top = d.h_fp + d.h_ep;
  const double plate = pad.shoulder_height > 0.0 ? pad.carrier_height : 3.0;
  SectionDrawing s;
  s.title = "Finger cross-section";
  s.subtitle = "θ = [h_fp, h_ep, w_s, h_s, w_v] = [";
  for (std::size_t i = 0; i < 5; ++i) s.subtitle += (i > 0 ? ", " : "") + short_number(design.theta_mm[i]);
  s.subtitle += "] mm, " + design.material();
  s.areas = areas_of(d, design.finger, plate);
  s.dimensions.push_back(thinnest(d, pad));
  s.dimensions.push_back({Along::z, {w, 0.0}, {w, d.h_fp}, 2.5, label("h_fp", d.h_fp)});
  s.dimensions.push_back({Along::z, {w, d.h_fp}, {0.0, top}, 2.5, label("h_ep", d.h_ep)});
  s.dimensions.push_back({Along::z, {-stem, 0.0}, {-stem, d.h_s}, -(w - stem) - 2.5, label("h_s", d.h_s)});
  s.dimensions.push_back({Along::x, {-stem, -plate}, {stem, -plate}, -2.2, label("w_s", d.w_s)});
  if (d.w_v > 0.0) s.dimensions.push_back({Along::x, {stem, -plate}, {outer, -plate}, -4.4, label("w_v", d.w_v)});
  s.dimensions.push_back({Along::x, {-w, -plate}, {w, -plate}, d.w_v > 0.0 ? -6.6 : -4.4, label("W", pad.width)});
  return s;
}

}  // namespace lumo::program
