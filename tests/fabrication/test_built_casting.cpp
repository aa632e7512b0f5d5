#include "lumo/fabrication/casting_drawings.hpp"
#include "lumo/fabrication/casting_kit.hpp"

#include "catch.hpp"
#include "fabrication/designs.hpp"

#include <array>
#include <cmath>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

using namespace lumo;

namespace {

/// The authors' hand-designed finger and two more, with what their public code says of the silicone.
struct Known {
  FingerDesign design;
  double active_mm2, cap_mm2, volume_mm3;
};
const std::vector<Known> known{{{5, 9, 7.6, 6, 2}, 372.46, 602.06, 23495.5},
    {{14.5, 4, 5, 12.5, 5}, 421.75, 769.25, 27042.4}, {{8, 1.5, 9, 4, 5}, 279.34, 515.34, 17940.6}};

std::vector<FingerDesign> built_designs() {
  std::vector<FingerDesign> designs = built_references();
  for (const Known& k : known) designs.push_back(k.design);
  for (const FingerDesign& d : random_designs(6, 17, built_pad())) designs.push_back(d);
  return designs;
}

CastingOptions built_options() { return CastingOptions{}.made_for(built_finger()); }

struct Kit {
  FingerDesign design;
  HalfSection section;
  std::vector<CastingPart> parts;

  explicit Kit(const FingerDesign& d)
      : design(d), section(casting_section(d, built_pad())), parts(casting_kit(section, built_options())) {}

  const CastingPart& part(const std::string& name) const {
    for (const CastingPart& p : parts)
      if (p.name == name) return p;
    throw std::runtime_error("no part " + name);
  }
  double volume_mm3(const std::string& name) const { return 1e9 * part(name).volume_m3; }
  /// Is the point [mm] in the part? The cores are two.
  double inside(const CastingPart& p, const Vec3d& point_mm) const {
    double n = winding_number(p.assembled, 1e-3 * point_mm);
    if (p.name == "core") n += winding_number(p.assembled, 1e-3 * (point_mm + Vec3d(design.w_s + design.w_v, 0, 0)));
    return n;
  }
  double inside(const std::string& name, const Vec3d& point_mm) const { return inside(part(name), point_mm); }
};

/// Where the point [mm] of the closed mould lies, by the formulas of the finger alone.
enum class Place { silicone, core, film, carrier, outside, near_a_face };

Place place(const FingerDesign& d, const Vec3d& p) {
  const double x = std::abs(p.x()), y = p.y(), z = p.z(), up = std::max(0.0, z - d.h_fp) / d.h_ep,
               side = up < 1.0 ? 15.0 * std::sqrt(1.0 - up * up) : -1.0, stem = 0.5 * d.w_s, outer = stem + d.w_v;
  const auto near = [](double a, double b, double by = 0.02) { return std::abs(a - b) < by; };
  const double led = std::abs(y - 11.0 * std::round(y / 11.0));  // from the nearest LED
  if (near(x, side, 0.05) || near(z, d.h_fp + d.h_ep, 0.05) || near(z, d.h_s) || near(z, d.h_s - 0.19) ||
      near(z, 0.0) || near(z, -8.0) || near(x, stem) || near(x, outer) || near(x, 10.0) || near(y, -27.5, 0.15) ||
      near(y, 27.5) || near(y, 32.5, 0.05) || near(led, 2.55))
    return Place::near_a_face;
  const bool in_pad = y > -27.5 && y < 32.5 && x < side && z > -8.0;
  if (!in_pad) return z < -8.0 ? Place::carrier : Place::outside;
  if (y > 27.5) return Place::silicone;
  if (z < 0.0) return x < 10.0 ? Place::carrier : Place::silicone;
  if (z > d.h_s || x > outer) return Place::silicone;
  if (x > stem) return Place::core;
  return led < 2.55 && std::abs(y) < 25.0 && z > d.h_s - 0.19 ? Place::film : Place::carrier;
}

}  // namespace

TEST_CASE("the silicone of a built finger is what its formulas say", "[fabrication]") {
  for (const Known& k : known) {
    const HalfSection s = casting_section(k.design, built_pad());
    CHECK(1e9 * cast_volume(s, built_options()).pad == Approx(k.volume_mm3).epsilon(3e-6));
    CHECK(2e6 * s.exact_area_m2() == Approx(k.active_mm2).epsilon(2e-5));
    CHECK(2e6 * casting_cap_section(s).exact_area_m2() == Approx(k.cap_mm2).epsilon(2e-5));
  }
  for (const FingerDesign& d : built_designs()) {
    const double dome = 15.0 * d.h_fp + 0.25 * pi * 15.0 * d.h_ep, c = 0.5 * d.w_s + d.w_v;
    const double active = 2.0 * (dome + 40.0 - c * d.h_s), cap = 2.0 * (dome + 15.0 * 8.0);
    const HalfSection s = casting_section(d, built_pad());
    const CastVolume v = cast_volume(s, built_options());
    CHECK(1e9 * v.pad == Approx(55.0 * active + 5.0 * cap).epsilon(1e-12));
    CHECK(1e9 * v.fits == Approx(0.1 * (d.w_s * d.h_s + 20.0 * 8.0)).epsilon(1e-9));
    CHECK(section_area_mm2(s) == Approx(active).epsilon(2e-4));
  }
}

// Counted afresh in mm. The mould's cavity less the block, the stem and the voids is the silicone.
TEST_CASE("volumes of a built finger's parts are those of their closed forms", "[fabrication]") {
  for (const FingerDesign& d : built_designs()) {
    INFO(d.h_fp << "," << d.h_ep << "," << d.w_s << "," << d.h_s << "," << d.w_v);
    const Kit kit(d);
    const double c = 0.2, plate = 36.0 * 74.0 - 4.0 * ring_area(1.7), rail = 55.0 - 0.5 * c, floor = d.h_s - 0.19;
    const double slot = 2.4 * 52.4 * (10.0 + floor - 0.6), windows = 5.0 * 2.2 * 2.0 * 0.6,
                 recesses = 5.0 * 5.1 * d.w_s * 0.19;
    CHECK(kit.volume_mm3("carrier") ==
          Approx(2.0 * plate + rail * (20.0 * 8.0 + d.w_s * d.h_s) - slot - windows - recesses).epsilon(1e-10));
    CHECK(kit.volume_mm3("led_bar") == Approx(2.0 * 49.0 * (10.0 + floor - 0.9)).epsilon(1e-10));

    // 23 mm to each side, from z = −8 to 8 mm over the dome; ends of 12 mm; a rim 4.8 mm wide and 1.5 mm high.
    const double X = 23.0, Z = d.h_fp + d.h_ep + 16.0, end = 12.0, rim = 4.8;
    const double outline = 0.5 * section_area_mm2(casting_cap_section(kit.section));
    const double tip = 2.5 - 3.0 * std::tan(20.0_deg),
                 keys = frustum(tip, 2.5, 3.0) - frustum(tip + c, 2.5 + c, 3.0 + c);
    const double half =
        60.0 * (X * Z - outline + rim * 1.5) + 2.0 * X * Z * end + 2.0 * X * 1.5 * rim + rim * 1.5 * (end - rim) + keys;
    CHECK(kit.volume_mm3("mould_a") == Approx(half).epsilon(1e-10));
    const double openings =
        2.0 * frustum(1.0, 1.0 + end * std::tan(3.0_deg), end) + frustum(2.0, 2.0 + end * std::tan(15.0_deg), end);
    const double tunnels = d.w_v > 0.0 ? 2.0 * (d.w_v + 2.0 * c) * (d.h_s + 2.0 * c) * end : 0.0;
    CHECK(kit.volume_mm3("mould_b") == Approx(half - openings - tunnels).epsilon(1e-10));

    const double cavity = 60.0 * 2.0 * outline, voids = 55.0 * 2.0 * d.w_v * d.h_s,
                 silicone = cavity - rail * (160.0 + d.w_s * d.h_s) - voids;
    const CastVolume v = cast_volume(kit.section, built_options());
    CHECK(silicone == Approx(1e9 * (v.pad + v.fits)).epsilon(2e-4));
    CHECK(silicone < 1e9 * (v.pad + v.fits));
    CHECK(kit.parts.size() == (d.w_v > 0.0 ? 5u : 4u));
    if (d.w_v > 0.0)
      CHECK(kit.volume_mm3("core") == Approx(d.w_v * (d.h_s * (55.0 + end + 10.0) + 1.5 * 10.0)).epsilon(1e-10));
  }
}

TEST_CASE("a built finger's closed mould holds each point once, in the part that it belongs to", "[fabrication]") {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> u(-1.0, 1.0);
  std::vector<FingerDesign> designs{{13, 7, 7.5, 14.5, 0}, {5.5, 2, 9, 2, 0.5}};
  for (const Known& k : known) designs.push_back(k.design);
  for (const FingerDesign& d : designs) {
    const Kit kit(d);
    const double top = d.h_fp + d.h_ep;
    std::array<int, 6> count{};
    for (int k = 0; k < 500; ++k) {
      Vec3d p(22.0 * u(random), 2.5 + 36.0 * u(random), 0.5 * (top - 2.0) + 0.5 * (top + 15.0) * u(random));
      if (k % 4 == 1) p.z() = d.h_s - 0.095 + 0.06 * u(random);                        // films
      if (k % 4 == 2) p = {10.0 * u(random), p.y(), d.h_s * 0.5 * (1.0 + u(random))};  // cavity
      if (k % 4 == 3) p = {p.x(), 30.0 + 2.4 * u(random), p.z()};                      // cap
      const bool keys = p.z() > top && std::abs(p.x()) < 3.5, slot = std::abs(p.x()) < 1.3 && p.z() < d.h_s,
                 ends = p.y() < -27.5 || std::abs(p.x()) > 17.9 || p.z() < -9.9;
      const Place at = place(d, p);
      if (at == Place::near_a_face || keys || slot || ends || (p.z() < -8.0 && p.y() > 34.0)) continue;
      ++count[std::size_t(at)];
      double all = 0.0;
      for (const CastingPart& part : kit.parts) all += kit.inside(part, p);
      INFO(p.transpose() << " in " << int(at));
      const bool filled = at != Place::silicone && at != Place::film;
      CHECK(all == Approx(filled ? 1.0 : 0.0).margin(1e-9));
      if (at == Place::carrier) CHECK(kit.inside("carrier", p) == Approx(1.0).margin(1e-9));
      if (at == Place::core) CHECK(kit.inside("core", p) == Approx(1.0).margin(1e-9));
      if (at == Place::outside) CHECK(kit.inside("mould_a", p) + kit.inside("mould_b", p) == Approx(1.0).margin(1e-9));
    }
    CHECK(count[std::size_t(Place::silicone)] > 40);
    CHECK(count[std::size_t(Place::carrier)] > 20);
    CHECK(count[std::size_t(Place::film)] > 3);
    CHECK(count[std::size_t(Place::outside)] > 40);
    CHECK((count[std::size_t(Place::core)] > 2) == (d.w_v > 0.0));
  }
}

TEST_CASE("LEDs end in the floors of the recesses, and what is put together has its clearance", "[fabrication]") {
  for (const Known& k : known) {
    const Kit kit(k.design);
    const double h = k.design.h_s, floor = h - 0.19, stem = 0.5 * k.design.w_s, outer = stem + k.design.w_v;
    const auto carrier = [&](double x, double y, double z) { return kit.inside("carrier", {x, y, z}) > 0.5; };
    const auto bar = [&](double x, double y, double z) { return kit.inside("led_bar", {x, y, z}) > 0.5; };
    const auto mould_b = [&](double x, double y, double z) { return kit.inside("mould_b", {x, y, z}) > 0.5; };
    for (const double y : {-22.0, -11.0, 0.0, 11.0, 22.0}) {
      for (const double x : {1.5, stem - 0.01})
        for (const double end : {-2.54, 2.54}) {
          CHECK(carrier(x, y + end, floor - 0.01));
          CHECK_FALSE(carrier(x, y + end, floor + 0.01));
          CHECK(carrier(x, y + 1.01 * end, h - 0.01));
        }
      // The LED's box and its clearance are free down to the strip; beside them the floor is left, over the slot.
      for (const double x : {0.0, 1.09}) CHECK_FALSE(carrier(x, y + 0.99, floor - 0.3));
      CHECK(carrier(1.11, y, floor - 0.3));
      CHECK(carrier(0.0, y + 1.01, floor - 0.3));
      CHECK(carrier(0.0, y + 4.0, h - 0.1));  // the ridge is whole
      CHECK_FALSE(carrier(1.19, y, floor - 0.61));
      CHECK(carrier(1.21, y, floor - 0.61));
      CHECK(bar(0.99, y, floor - 0.91));
      CHECK_FALSE(bar(0.0, y, floor - 0.89));
      CHECK_FALSE(bar(1.01, y, 0.0));
    }
    CHECK_FALSE(carrier(9.9, 27.51, -4.0));  // the cap's silicone begins here, over the plate
    CHECK(carrier(9.9, 27.49, -4.0));
    CHECK(carrier(0.0, 32.4, -8.01));
    CHECK_FALSE(carrier(9.9, -27.45, -4.0));
    CHECK(carrier(9.9, -27.39, -4.0));
    // Round the plate and each core 0.2 mm.
    CHECK(carrier(17.99, 0.0, -8.5));
    CHECK_FALSE(carrier(18.01, 0.0, -8.5));
    CHECK_FALSE(mould_b(-18.19, 0.0, -8.5));
    CHECK(mould_b(-18.21, 0.0, -8.5));
    for (const double x : {stem - 0.19, outer + 0.19}) CHECK_FALSE(mould_b(-x, -33.0, 0.5 * h));
    for (const double x : {stem - 0.21, outer + 0.21}) CHECK(mould_b(-x, -33.0, 0.5 * h));
    for (const double z : {-0.21, h + 0.21}) CHECK(mould_b(0.5 * (stem + outer), -33.0, z));
    for (const double z : {-0.19, h + 0.19}) CHECK_FALSE(mould_b(0.5 * (stem + outer), -33.0, z));
  }
}

TEST_CASE("a built finger's mould opens without an undercut", "[fabrication]") {
  for (const FingerDesign& d : built_designs()) {
    const Kit kit(d);
    const Vec3d way = opening_direction();
    const double a = least_draft(kit.part("mould_a").assembled, kit.section, way),
                 b = least_draft(kit.part("mould_b").assembled, kit.section, Vec3d(-way));
    CHECK(a > 0.0);
    CHECK(a <= 10.0_deg + 1e-12);
    CHECK(b == Approx(a).epsilon(1e-9));
    CHECK(least_draft(kit.part("mould_a").assembled, kit.section, Vec3d::UnitX()) == Approx(0.0).margin(1e-12));
    CHECK(least_draft(kit.part("mould_b").assembled, kit.section, way) < -1.0);
  }
}

TEST_CASE("notes say what must not bond", "[fabrication]") {
  const auto notes = [](const FingerDesign& d, const FingerOptions& finger) {
    std::string all;
    for (const std::string& n : casting_notes(casting_section(d, finger.pad), CastingOptions{}.made_for(finger)))
      all += n + "\n";
    return all;
  };
  using Catch::Matchers::Contains;
  CHECK_THAT(
      notes(built_baseline(), built_finger()), Contains("coat the stem's top and the carrier's end under the cap"));
  CHECK_THAT(notes(built_baseline(), built_finger()), Contains("recesses must stay full of air"));
  CHECK_THAT(notes(built_references()[3], built_finger()), Contains("coat the stem's top and sides"));
  FingerOptions bonded = built_finger();
  bonded.pad.stem = Stem::bonded;
  CHECK_THAT(notes(built_baseline(), bonded), !Contains("release agent") && !Contains("recesses"));
  CHECK(notes({5, 10, 10, 6, 3}, plain_finger()).empty());
}

TEST_CASE("fingers between the plain and the built one are solids, too", "[fabrication]") {
  const auto solids = [](const FingerOptions& finger, const CastingOptions& o = {}) {
    for (const FingerDesign& d : {FingerDesign{14.5, 4, 5, 12.5, 5}, {13, 7, 7.5, 14.5, 0}})
      CHECK_NOTHROW(casting_kit(casting_section(d, finger.pad), o.made_for(finger)));
  };
  FingerOptions finger = built_finger();
  solids(finger,
      {.clearance = 0.05e-3, .strip_height = 0.7e-3, .wall = 7e-3, .gate_diameter = 2e-3, .vent_diameter = 0.8e-3});
  solids(finger, {.clearance = 0.4e-3, .strip_height = 1.5e-3, .wall = 30e-3});
  finger.pad.stem = Stem::bonded;  // a pocket in a stair
  solids(finger);
  finger.pad.cap_length = 0.0;
  solids(finger);
  finger = plain_finger();  // recesses on a flat carrier
  finger.pad.stem = Stem::free;
  finger.recess.depth = 0.2e-3;
  solids(finger);
  finger.pad.cap_length = 4.0;
  solids(finger);
}

TEST_CASE("the section of a built finger is drawn at 1:1", "[fabrication]") {
  for (const Known& k : known) {
    const HalfSection s = casting_section(k.design, built_pad());
    const Drawing d = section_drawing(s, built_options());
    const auto area_mm2 = [&](const std::string& layer) {
      double sum = 0.0;
      for (const Drawing::Line& line : d.lines) {
        if (d.layers[std::size_t(line.layer)].name != layer || !line.closed) continue;
        double twice = 0.0;
        for (std::size_t i = 0; i < line.points.size(); ++i) {
          const auto &p = line.points[i], &q = line.points[(i + 1) % line.points.size()];
          twice += p[0] * q[1] - p[1] * q[0];
        }
        sum += 0.5e6 * std::abs(twice);
      }
      return sum;
    };
    const double h = k.design.h_s - 0.19, w = k.design.w_s;
    CHECK(area_mm2("SILICONE") == Approx(section_area_mm2(s)).epsilon(1e-9));
    CHECK(area_mm2("CARRIER") == Approx(72.0 + 160.0 + w * h - 2.4 * (h + 9.4) - 2.2 * 0.6).epsilon(1e-9));
    CHECK(area_mm2("LED_STRIP") == Approx(2.0 * 0.3 + 1.8 * 0.6).epsilon(1e-9));
    CHECK(area_mm2("LED_BAR") == Approx(2.0 * (h + 9.1)).epsilon(1e-9));
    CHECK(area_mm2("CORES") == Approx(2.0 * k.design.w_v * k.design.h_s).epsilon(1e-9));
  }
}

TEST_CASE("built fingers that cannot be made are refused by name", "[fabrication]") {
  const auto refused = [](FingerOptions finger, CastingOptions o, const std::string& words) {
    INFO(words);
    try {
      casting_kit(casting_section(built_references()[0], finger.pad), o.made_for(finger));
      FAIL("must be refused");
    } catch (const InvalidArgument& e) {
      CHECK_THAT(e.what(), Catch::Matchers::Contains(words));
    }
  };
  const auto with = [](const auto& change) {
    FingerOptions finger = built_finger();
    change(finger);
    return finger;
  };
  const FingerOptions built = built_finger();
  refused(built, {.strip_width = 1.5e-3}, "LED width is 1.8 mm, must lie in [0.1, 1.5] mm");
  refused(built, {.strip_height = 0.6e-3}, "circuit of the LED strip is 0.3 mm");
  refused(built, {.strip_width = 3.5e-3}, "0.6 mm of wall on each side");
  refused(with([](auto& f) { f.leds.count = 6; }), {}, "LED strip is 63 mm long, must be at most 52.6 mm");
  refused(with([](auto& f) { f.leds.count = 0; }), {}, "number of LEDs on the strip is 0");
  refused(with([](auto& f) { f.leds.place = FingerOptions::Leds::Place::sides; }), {}, "must be on its top");
  refused(with([](auto& f) { f.recess.length_y = 2.5e-3; }), {}, "length of the LEDs' recesses is 2.5 mm");
  refused(with([](auto& f) { f.pad.carrier_height = 9.0; }), {}, "thickness of the carrier's plate is 1 mm");
  refused(with([](auto& f) { f.pad.shoulder_height = 1.0; }), {}, "height of the shoulders is 1 mm");
  refused(with([](auto& f) { f.pad.shoulder_width = 3.0; }), {}, "width of the shoulders is 3 mm");
  refused(with([](auto& f) { f.pad.shoulder_width = 8.0; }), {}, "stem and voids are 15 mm wide");
  HalfSection held = casting_section(built_baseline(), built_pad());
  held.twin = Twin::held_top;
  CHECK_THROWS_AS(casting_kit(held, built_options()), InvalidArgument);
  CHECK_THROWS_AS(led_bar_solid(casting_section({6, 6, 8, 5, 0}, plain_pad()), plain_casting()), InvalidArgument);
}
