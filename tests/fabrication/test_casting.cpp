#include "lumo/fabrication/casting_kit.hpp"

#include "catch.hpp"
#include "fabrication/designs.hpp"

#include <cmath>
#include <random>
#include <string>

using namespace lumo;

namespace {

const CastingPart& part(const std::vector<CastingPart>& kit, const std::string& name) {
  for (const CastingPart& p : kit)
    if (p.name == name) return p;
  throw std::runtime_error("no part " + name);
}

double volume_mm3(const std::vector<CastingPart>& kit, const std::string& name) {
  return 1e9 * part(kit, name).volume_m3;
}

std::vector<FingerDesign> all_designs() {
  auto designs = extreme_designs();
  for (const FingerDesign& d : random_designs(20, 11, plain_pad())) designs.push_back(d);
  return designs;
}

}  // namespace

TEST_CASE("the section for casting is the paper's", "[fabrication]") {
  for (const FingerDesign& d : all_designs()) {
    const HalfSection s = casting_section(d, plain_pad());
    CHECK(s.half_width_m() == Approx(14.75e-3));
    CHECK(s.height_m() == Approx(1e-3 * (d.h_fp + d.h_ep)));
    const double exact = 29.5 * d.h_fp + 0.25 * pi * 29.5 * d.h_ep - (d.w_s + 2.0 * d.w_v) * d.h_s;
    CHECK(1e9 * cast_volume(s, plain_casting()).pad == Approx(60.0 * exact).epsilon(1e-12));
    CHECK(section_area_mm2(s) == Approx(exact).epsilon(2e-4));
    CHECK(section_area_mm2(s) <= exact);
    const auto outline = pad_outline(s);
    // Chords leave the ellipse by less than 5 µm.
    for (std::size_t i = 1; i + 1 < outline.size(); ++i) {
      const EllipticCylinder dome{{0, 0, 1e-3 * d.h_fp}, s.half_width_m(), 1e-3 * d.h_ep};
      const Vec3d middle(0.5 * (outline[i][0] + outline[i + 1][0]), 0.0, 0.5 * (outline[i][1] + outline[i + 1][1]));
      CHECK((dome.closest_point(middle) - middle).norm() < 5e-6);
    }
  }
}

// Every number in mm and counted afresh from the drawing, not from the code's own layout.
TEST_CASE("volumes of all parts are those of their closed forms, over the whole space", "[fabrication]") {
  for (const FingerDesign& d : all_designs()) {
    INFO(d.h_fp << "," << d.h_ep << "," << d.w_s << "," << d.h_s << "," << d.w_v);
    const HalfSection s = casting_section(d, plain_pad());
    const auto kit = casting_kit(s, plain_casting());
    const double c = 0.2, plate = 35.5 * 74.0, duct = 2.0 * 3.0, pocket = 2.4 * 52.4;
    CHECK(volume_mm3(kit, "carrier") == Approx(4.0 * (plate - 4.0 * ring_area(1.7) - duct) +
                                               d.w_s * d.h_s * (60.0 - c) - pocket * 0.9 - duct * (d.h_s - 0.9))
                                            .epsilon(1e-10));

    // Half a mould: 22.75 mm to each side, 8 mm over the dome; its end 7.2 mm to the rim, and 4.8 mm of rim, 3 mm high.
    const double X = 22.75, Z = d.h_fp + d.h_ep + 8.0, end = 12.0, rim = 4.8;
    const double outline = 0.5 * (section_area_mm2(s) + (d.w_s + 2.0 * d.w_v) * d.h_s);  // half of it, filled
    const double body = 60.0 * (X * Z - outline + rim * 3.0),
                 wall = 2.0 * X * Z * end + 2.0 * X * 3.0 * rim + rim * 3.0 * (end - rim);
    const double tip = 2.5 - 3.0 * std::tan(20.0_deg),
                 keys = frustum(tip, 2.5, 3.0) - frustum(tip + c, 2.5 + c, 3.0 + c);
    CHECK(volume_mm3(kit, "mould_b") == Approx(body + wall + keys).epsilon(1e-10));

    const double notch = d.w_v > 0.0 ? (d.w_v + 2.0 * c) * ((d.h_s + c) * end + c * rim) : 0.0;
    const double vent = frustum(1.0, 1.0 + end * std::tan(3.0_deg), end),
                 gate = frustum(2.0, 2.0 + end * std::tan(15.0_deg), end);
    CHECK(volume_mm3(kit, "mould_a") == Approx(body + wall + keys - 2.0 * notch - 2.0 * vent - gate).epsilon(1e-10));

    const CastVolume v = cast_volume(s, plain_casting());
    CHECK(1e9 * v.openings == Approx(gate + 2.0 * vent).epsilon(1e-10));
    CHECK(1e9 * v.fits == Approx((pocket - 2.0 * 52.0) * 0.9 + d.w_s * d.h_s * c).epsilon(1e-10));

    CHECK(kit.size() == (d.w_v > 0.0 ? 4u : 3u));
    if (d.w_v > 0.0) {
      CHECK(volume_mm3(kit, "core") == Approx(d.w_v * (d.h_s * (60.0 + end + 10.0) + 3.0 * 10.0)).epsilon(1e-10));
      CHECK(part(kit, "core").copies == 2);
    }
  }
}

TEST_CASE("printed parts are the assembled ones, on the bed with their corner at the origin", "[fabrication]") {
  for (const CastingPart& p : casting_kit(casting_section({5, 10, 10, 6, 3}, plain_pad()), plain_casting())) {
    const SurfaceReport report = validate_surface(p.printed);
    CHECK(report.low.norm() < 1e-15);
    CHECK((report.high - p.box).norm() < 1e-15);
    CHECK(report.volume == Approx(validate_surface(p.assembled).volume).epsilon(1e-12));
    if (p.name == "carrier") CHECK((1e3 * p.box - Vec3d(35.5, 74.0, 10.0)).norm() < 1e-9);
    if (p.name == "mould_a" || p.name == "mould_b") CHECK((1e3 * p.box - Vec3d(45.5, 26.0, 72.0)).norm() < 1e-9);
    if (p.name == "core") CHECK((1e3 * p.box - Vec3d(82.0, 9.0, 3.0)).norm() < 1e-9);
  }
}

// The cavity is the pad, voids and all: any point of the closed mould is in exactly one of silicone and parts. The pad
// is known here by its formula alone.
TEST_CASE("the closed mould's cavity is the pad with its voids", "[fabrication]") {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> u(-1.0, 1.0);
  for (const FingerDesign& d :
      {FingerDesign{5, 10, 10, 6, 3}, {6, 6, 8, 5, 0}, {10, 8, 4.5, 4, 7.5}, {19, 1, 15, 14, 2}, {8, 1, 4, 2, 0.5}}) {
    const auto kit = casting_kit(casting_section(d, plain_pad()), plain_casting());
    int in_pad = 0, in_void = 0, elsewhere = 0;
    for (int k = 0; k < 400; ++k) {
      const double z_top = d.h_fp + d.h_ep + 8.0;
      Vec3d p(22.0 * u(random), 34.0 * u(random), 0.5 * z_top * (1.0 + u(random)));  // mm
      if (k % 4 == 0)
        p = {p.x() > 0 ? 0.5 * (d.w_s + d.w_v * (1.0 + u(random))) : p.x() * 0.6, p.y(),
            0.5 * d.h_s * (1.0 + u(random))};
      const double x = std::abs(p.x()), up = std::max(0.0, p.z() - d.h_fp) / d.h_ep,
                   side = up < 1.0 ? 14.75 * std::sqrt(1.0 - up * up) : -1.0;
      const double stem = 0.5 * d.w_s, outer = stem + d.w_v;
      // At a surface chords and fits decide; the pocket, the openings and the keys are cut out of the parts.
      const bool near = std::abs(x - side) < 0.05 || std::abs(p.z() - d.h_fp - d.h_ep) < 0.05 ||
                        std::abs(std::abs(p.y()) - 30.0) < 0.15 || x < 0.05 || p.z() < 0.01 ||
                        std::abs(p.z() - d.h_s) < 0.02 || std::abs(x - stem) < 0.02 || std::abs(x - outer) < 0.02;
      const bool pocket = x < 1.3 && p.z()<d.h_s, keys = p.z()> d.h_fp + d.h_ep && x<3.5, end = p.y()> 30.0;
      if (near || pocket || keys || end) continue;
      const bool inside = std::abs(p.y()) < 30.0 && x < side && p.z() < d.h_fp + d.h_ep;
      const bool in_stem = inside && x < stem && p.z() < d.h_s,
                 hollow = inside && !in_stem && x < outer && p.z() < d.h_s, pad = inside && !in_stem && !hollow;
      double parts = 0.0;
      for (const CastingPart& part : kit) {
        parts += winding_number(part.assembled, 1e-3 * p);
        if (part.name != "core") continue;
        parts += winding_number(part.assembled, 1e-3 * (p + Vec3d(d.w_s + d.w_v, 0, 0)));  // the other core
        if (hollow) CHECK(winding_number(part.assembled, 1e-3 * Vec3d(x, p.y(), p.z())) == Approx(1.0).margin(1e-9));
      }
      INFO(p.transpose());
      CHECK(parts == Approx(pad ? 0.0 : 1.0).margin(1e-9));
      in_pad += pad;
      in_void += hollow;
      elsewhere += !pad && !hollow;
    }
    CHECK(in_pad > 60);
    CHECK(elsewhere > 60);
    CHECK((in_void > 5) == (d.w_v > 0.0));
  }
}

TEST_CASE("the mould opens without an undercut, and no other straight way is as good", "[fabrication]") {
  for (const FingerDesign& d : all_designs()) {
    const HalfSection s = casting_section(d, plain_pad());
    const TriangleSurface a = mould_half_a(s, plain_casting()), b = mould_half_b(s, plain_casting());
    const Vec3d way = opening_direction();
    // The crown's last chord is the steepest place; its slope is the draft.
    const auto outline = pad_outline(s);
    const auto &p = outline[outline.size() - 2], &q = outline.back();
    const double crown = std::asin((q[1] - p[1]) / std::hypot(q[0] - p[0], q[1] - p[1]) * std::cos(10.0_deg));
    CHECK(least_draft(a, s, way) == Approx(std::min(crown, 10.0_deg)).epsilon(1e-9));
    CHECK(least_draft(b, s, Vec3d(-way)) == Approx(least_draft(a, s, way)).epsilon(1e-9));
    CHECK(crown > 0.0);
    CHECK(least_draft(a, s, Vec3d::UnitX()) == Approx(0.0).margin(1e-12));  // the ends would rub
    CHECK(least_draft(a, s, Vec3d(-Vec3d::UnitZ())) < -1.0);                // the dome is in the way
    CHECK(least_draft(a, s, Vec3d(-way)) < -1.0);
  }
}

TEST_CASE("options that cannot be made are refused by name", "[fabrication]") {
  const HalfSection s = casting_section({5, 10, 10, 6, 3}, plain_pad());
  const auto refused = [&](CastingOptions o, const HalfSection& section, const std::string& word) {
    o.leds.width_x = plain_casting().leds.width_x;
    o.recess = plain_casting().recess;
    try {
      casting_kit(section, o);
      FAIL(word + " must be refused");
    } catch (const InvalidArgument& e) {
      CHECK_THAT(e.what(), Catch::Matchers::Contains(word));
    }
  };
  refused({.clearance = 1e-3}, s, "clearance of printed parts is 1 mm");
  refused({.clearance = std::nan("")}, s, "clearance");
  refused({.plate = 1e-3}, s, "plate thickness");
  refused({.flange = 7e-3}, s, "beyond the pad's sides");
  refused({.tab = 5e-3}, s, "beyond the pad's ends");
  refused({.wall = 5e-3}, s, "mould wall");
  refused({.rim = 5e-3}, s, "mould rim");
  refused({.strip_width = 9e-3}, s, "LED strip width is 9 mm, must be at most 8.4 mm");
  refused({.strip_width = 2.5e-3}, casting_section({6, 6, 4, 5, 0}, plain_pad()), "0.6 mm of wall");
  refused({.strip_height = 1.6e-3}, s, "LED strip height");
  refused({.gate_diameter = 5e-3}, s, "gate diameter");
  refused({.vent_diameter = 0.1e-3}, s, "vent diameter");
  refused({.leds = {.count = 6}}, s, "LED strip is 63 mm long");
  HalfSection soft = s;
  soft.twin = Twin::bonded_base;
  refused({}, soft, "cannot be cast");
  CHECK_THROWS_AS(core_solid(casting_section({6, 6, 8, 5, 0}, plain_pad()), plain_casting()), InvalidArgument);
  CHECK_THROWS_AS(casting_section({6, 6, 8, 12, 0}, plain_pad()), InfeasibleDesign);
}

TEST_CASE("every option at its ends makes solids", "[fabrication]") {
  namespace limits = casting_limits;
  for (const FingerDesign& d :
      {FingerDesign{2, 5.5, 4, 2, 0}, {19, 1, 4, 14.5, 7.5}, {5, 10, 10, 6, 3}, {8, 1, 4, 2, 0.5}})
    for (const bool low : {true, false}) {
      const auto end = [low](const Limits& mm) { return 1e-3 * (low ? mm.low : mm.high); };
      CastingOptions o = plain_casting();
      o.clearance = end(limits::clearance_mm);
      o.plate = end(limits::plate_mm);
      o.wall = end(limits::wall_mm);
      o.strip_height = end(limits::strip_height_mm);
      o.gate_diameter = end(limits::gate_mm);
      o.vent_diameter = end(limits::vent_mm);
      o.rim = std::min(o.rim, o.plate);
      o.strip_width = low ? 0.8e-3 : 1e-3 * (d.w_s - 1.2) - 2.0 * o.clearance;
      CHECK_NOTHROW(casting_kit(casting_section(d, plain_pad()), o));
    }
}
