#include "catch.hpp"
#include "lumo/mechanics/contact/first_touch.hpp"
#include "lumo/mesh/body_mesh.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/support/tetgen.hpp"
#include "morphology/closed.hpp"

#include <map>
#include <tuple>

using namespace lumo;

namespace {

using Point = std::array<double, 2>;

/// Values that follow from the drawings of the built finger, computed without this library, in mm.
struct Known {
  FingerDesign design;
  double t_min;
  std::vector<Point> silicone;  ///< vertices of the half section up to the flat side's end, then the apex
  std::vector<Point> carrier;   ///< likewise
  double active_mm2, cap_mm2, volume_mm3;
};

std::vector<Known> known() {
  return {{built_baseline(), 6.9602, {{0, 6}, {5.8, 6}, {5.8, 0}, {10, 0}, {10, -8}, {15, -8}, {15, 5}, {0, 14}},
              {{0, -10}, {15, -10}, {15, -8}, {10, -8}, {10, 0}, {3.8, 0}, {3.8, 6}, {0, 6}}, 372.46, 602.06, 23495.5},
      {{14.5, 4, 5, 12.5, 5}, 5.3893,
          {{0, 12.5}, {7.5, 12.5}, {7.5, 0}, {10, 0}, {10, -8}, {15, -8}, {15, 14.5}, {0, 18.5}},
          {{0, -10}, {15, -10}, {15, -8}, {10, -8}, {10, 0}, {2.5, 0}, {2.5, 12.5}, {0, 12.5}}, 421.75, 769.25,
          27042.4},
      {{8, 1.5, 9, 4, 5}, 5.1422, {{0, 4}, {9.5, 4}, {9.5, 0}, {10, 0}, {10, -8}, {15, -8}, {15, 8}, {0, 9.5}},
          {{0, -10}, {15, -10}, {15, -8}, {10, -8}, {10, 0}, {4.5, 0}, {4.5, 4}, {0, 4}}, 279.34, 515.34, 17940.6}};
}

void same(const std::vector<Point>& mm, const std::vector<Point>& m) {
  REQUIRE(mm.size() == m.size());
  for (std::size_t k = 0; k < mm.size(); ++k)
    for (std::size_t i = 0; i < 2; ++i) CHECK(1e3 * m[k][i] == Approx(mm[k][i]).margin(1e-9));
}

const Chords fine{0.5e-3, 0.1, 0.0};

}  // namespace

TEST_CASE("The built section, carrier, thickness and volume are those of the drawings", "[built]") {
  for (const Known& k : known()) {
    CHECK(euclidean_thickness(k.design, built_pad()) == Approx(k.t_min).margin(5e-5));
    const HalfSection s = half_section(k.design, Twin::none, fine, built_pad()),
                      cap = cap_section(k.design, Twin::none, fine, built_pad());
    std::vector<Point> corners;
    for (std::size_t i = 0; i < s.x.size(); ++i)
      if (s.tag[i] != SectionTag::dome || s.tag[i - 1] != SectionTag::dome) corners.push_back({s.x[i], s.z[i]});
    same(k.silicone, corners);
    same(k.carrier, carrier_outline(k.design, built_pad()));
    CHECK(2e6 * s.exact_area_m2() == Approx(k.active_mm2).margin(0.005));
    CHECK(2e6 * cap.exact_area_m2() == Approx(k.cap_mm2).margin(0.005));
    const Body body = finger(k.design, dragon_skin(), built_finger());
    CHECK(1e9 * body.exact_volume_m3 == Approx(k.volume_mm3).margin(0.05));
    for (const Emitter& e : body.emitters) {
      CHECK(1e3 * e.center().z() == Approx(k.design.h_s - 0.19));
      CHECK(e.in_air());
    }
  }
  for (const auto& [d, t] :
      {std::pair(FingerDesign{13.5, 1.5, 7, 9.5, 5.5}, 5.1844), {FingerDesign{5.5, 2, 9, 2, 0.5}, 5.3793},
          {FingerDesign{13, 7, 7.5, 14.5, 0}, 5.2316}, {FingerDesign{2.5, 17.5, 7, 2, 3.5}, 8.0},
          {FingerDesign{2, 9, 9.5, 2.5, 5}, 5.052}, {FingerDesign{2, 5.5, 12, 2, 0}, 4.966}})
    CHECK(euclidean_thickness(d, built_pad()) == Approx(t).margin(1e-3));
  FingerOptions soft = built_finger();
  soft.twin = Twin::held_top;
  CHECK(1e9 * finger(built_baseline(), dragon_skin(), soft).exact_volume_m3 == Approx(39723.5).margin(0.05));
  soft.twin = Twin::bonded_base;
  CHECK_THROWS_WITH(
      finger(built_baseline(), dragon_skin(), soft), Catch::Contains("bonded_base of a pad with a cap of 5"));
}

TEST_CASE("Of the lattice's 4,201,470 designs 2,015,300 can be built", "[built]") {
  // By the thickness alone where bounds and sums hold: they are counted on the way. It depends on three lengths only.
  const DesignSpace plain = finger_space(plain_pad());
  std::map<std::tuple<double, double, double>, bool> thick;
  long all = 0, built = 0, both = 0, as_before = 0;
  for (double fp = 2; fp <= 29; fp += 0.5)
    for (double ep = 1; ep <= 20 && fp + ep <= 20; ep += 0.5)
      for (double ws = 4; ws <= 15; ws += 0.5)
        for (double wv = 0; wv <= 7.5 && ws + 2 * wv <= 19.5; wv += 0.5)
          for (double hs = 2; hs <= 15; hs += 0.5) {
            const FingerDesign d{fp, ep, ws, hs, wv};
            const auto [it, fresh] = thick.try_emplace({hs - fp, ep, 0.5 * ws + wv}, false);
            if (fresh) it->second = euclidean_thickness(d, built_pad()) >= 5.0 - 1e-9;
            const bool before = plain.contains(d.values());
            ++all;
            built += it->second;
            as_before += before;
            both += it->second && before;
          }
  CHECK(all == 4201470);
  CHECK(built == 2015300);
  CHECK(as_before == 2078321);
  CHECK(both == 2009706);
}

TEST_CASE("The built baseline may lie off the lattice, no other design", "[built]") {
  CHECK_NOTHROW(require_feasible(built_baseline(), built_pad()));
  CHECK_THROWS_WITH(
      require_feasible({5, 9, 7.7, 6, 2}, built_pad()), Catch::Contains("w_s = 7.7 mm is off the 0.5 mm"));
  for (const FingerDesign& d : built_references()) CHECK(finger_space(built_pad()).contains(d.values()));
  CHECK_THROWS_WITH(require_feasible({2, 5.5, 12, 2, 0}, built_pad()), Catch::Contains("t_min (distance) = 4.96"));
  // A corner that is not under the dome has no thickness at all.
  CHECK(euclidean_thickness({2, 1, 15, 14, 2}, built_pad()) == 0.0);
}

TEST_CASE(
    "A built finger is closed, bonded at its lips, shoulders and under its cap, and free on its stem", "[built]") {
  for (const FingerDesign& d :
      {built_baseline(), FingerDesign{14.5, 4, 5, 12.5, 5}, FingerDesign{13, 7, 7.5, 14.5, 0}}) {
    const Body body = finger(d, solaris(), built_finger());
    check_closed(body);
    CHECK(body.symmetry.x);
    CHECK_FALSE(body.symmetry.y);
    for (const Patch& p : body.patches) {
      CHECK(p.bonded == (p.name == "base" || p.name.starts_with("shoulder")));
      CHECK(p.meets_carrier == (p.name.starts_with("void") || p.name == "cap_wall"));
      CHECK(p.bonded == std::holds_alternative<Lambertian>(p.optics));
    }
    // The mesh ends where the finger does, and faces of the roof end over the stem's sides.
    const TetMesh mesh = mesh_body(body, TetgenMesher{});
    Vec3d low = mesh.nodes[0], high = low;
    for (const Vec3d& p : mesh.nodes) {
      low = elementwise_min(low, p);
      high = elementwise_max(high, p);
    }
    CHECK(1e3 * low.y() == Approx(-27.5));
    CHECK(1e3 * high.y() == Approx(32.5));
    CHECK(1e3 * low.z() == Approx(-8.0));
    for (const BoundaryFace& f : mesh.faces) {
      if (body.patches[std::size_t(f.patch)].name != "void_roof") continue;
      bool inside = false, outside = false;
      for (std::size_t k = 0; k < 3; ++k) {
        const double beyond = std::abs(mesh.nodes[std::size_t(f.nodes[k])].x()) - 0.5e-3 * d.w_s;
        inside = inside || beyond < -1e-9;
        outside = outside || beyond > 1e-9;
        CHECK(mesh.nodes[std::size_t(f.nodes[k])].z() == Approx(1e-3 * d.h_s).margin(1e-12));
      }
      CHECK_FALSE((inside && outside));
    }
  }
}

TEST_CASE("First touch of tilted spheres: about the base as built, or about the flat sides' top", "[built]") {
  // (x, z) in mm of the point that is touched first.
  const auto touch = [](const FingerDesign& d, double radius_mm, double angle_deg, TiltPivot pivot) {
    FingerOptions o = built_finger();
    o.pivot = pivot;
    const Body body = finger(d, dragon_skin(), o);
    static std::map<std::array<double, 5>, TetMesh> meshes;
    const auto [it, fresh] = meshes.try_emplace(d.values());
    if (fresh) it->second = mesh_body(body, TetgenMesher{});
    return first_touch(body, it->second, Scenario<Sphere>{Sphere{2e-3 * radius_mm}, angle_deg * pi / 180, 0.0}).point;
  };
  struct Row {
    FingerDesign design;
    double radius, angle;
    Point base, flat_top;
  };
  const FingerDesign tall{14.5, 4, 5, 12.5, 5}, flat{8, 1.5, 9, 4, 5};
  for (const Row& r : {Row{built_baseline(), 5, 30, {8.137, 12.561}, {6.202, 13.195}},
           Row{built_baseline(), 10, 30, {8.598, 12.375}, {7.046, 12.945}},
           Row{tall, 5, 30, {11.227, 17.153}, {4.640, 18.304}}, Row{tall, 10, 30, {11.924, 16.927}, {6.527, 18.101}},
           Row{flat, 10, 30, {10.101, 9.109}, {6.113, 9.370}}, Row{flat, 10, 15, {4.859, 9.419}, {2.878, 9.472}}}) {
    const Vec3d base = touch(r.design, r.radius, r.angle, TiltPivot::base),
                top = touch(r.design, r.radius, r.angle, TiltPivot::flat_top);
    CHECK(1e3 * base.x() == Approx(r.base[0]).margin(6e-4));
    CHECK(1e3 * base.z() == Approx(r.base[1]).margin(6e-4));
    CHECK(1e3 * top.x() == Approx(r.flat_top[0]).margin(6e-4));
    CHECK(1e3 * top.z() == Approx(r.flat_top[1]).margin(6e-4));
  }
}
