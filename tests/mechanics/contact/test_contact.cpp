#include "catch.hpp"
#include "lumo/mechanics/contact/carrier.hpp"
#include "lumo/mechanics/contact/contact_handler.hpp"
#include "lumo/mechanics/contact/contact_set.hpp"
#include "lumo/mechanics/contact/first_touch.hpp"
#include "lumo/morphology/finger.hpp"
#include "mechanics/bodies.hpp"
#include "mechanics/contact/contact_laws.hpp"
#include "mechanics/indenters/indenter_laws.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <utility>

using namespace lumo;

static_assert(!Indenter<int>);
static_assert(!ContactHandler<double>);

TEST_CASE("distance fields obey the laws of an indenter") {
  test::check_distance_laws(Sphere{10e-3}, 20e-3);
  test::check_distance_laws(Carrier{{{{0, 0, -5e-3}, {15e-3, 30e-3, 5e-3}}, {{0, 0, 0}, {4e-3, 30e-3, 5e-3}}}}, 30e-3);
  test::check_distance_laws(Carrier{{{{0, 0, 0}, {4e-3, 30e-3, 5e-3}, 0.4e-3}}}, 30e-3);
}

TEST_CASE("contact laws push, harder the deeper, as the derivatives of their energy, and nothing acts across a gap") {
  test::check_contact_laws(SDFContact{1e10});
  test::check_contact_laws(SDFContact{1e11, 0.5});
  test::check_contact_laws(VertexContact{1e9});
  const SDFContact soft{1e10};
  CHECK(ScaledContact<SDFContact>{&soft, 0.5}.respond(-1e-6).pressure == 0.5 * soft.respond(-1e-6).pressure);
  CHECK_THROWS_AS(validate(ScaledContact<SDFContact>{&soft, 0.0}), InvalidArgument);
}

namespace {

/// Central differences of the energy and of the forces of what is pushed by s0 into the wavy top of a block, by nodes
/// and by the advance.
template <class Tool>
void check_contact_derivatives(const Tool& tool, const Vec3d& start, const Vec3d& direction, double s0) {
  const Vec3d size(8e-3, 8e-3, 4e-3);
  const Body body = test::block_body(size);
  const TetMesh mesh = test::block_mesh(size, test::even(3), test::even(3), test::even(1), 2, false);
  const ContactSurface surface(mesh, body, [](const Patch& p) { return p.contactable; });
  double area = 0.0;
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (const auto& p : surface.points(f)) area += p.area_m2;
  CHECK(area == Approx(64e-6));

  const SDFContact contact{1e9};
  const auto at = [&](double s) { return Moving<Tool>{&tool, start + s * direction, direction}; };
  Positions x = positions_of(mesh);
  for (Eigen::Index k = 0; k < x.cols(); ++k) x.col(k) += 0.1 * test::wavy(x.col(k), 8e-3);
  const Sector sector = sector_of(mesh, {});
  const Equations eq(sector, body, {});
  const auto evaluate = [&](const Positions& y, double s, Positions* f) {
    return add_contact_forces(surface, contact, at(s), y, f);
  };
  Positions f = Positions::Zero(3, x.cols());
  const ContactSums sums = evaluate(x, s0, &f);
  REQUIRE(sums.energy > 0.0);
  CHECK(-f.rowwise().sum().dot(direction) ==
        Approx(sums.push_N));  // the pad is pushed along the advance, the indenter back
  SparseLower tangent = eq.pattern;
  std::fill_n(tangent.valuePtr(), tangent.nonZeros(), 0.0);
  Eigen::VectorXd coupling = Eigen::VectorXd::Zero(eq.count);
  const ContactSums stiff = add_contact_tangent(surface, contact, at(s0), x, {eq, tangent.valuePtr(), &coupling});
  Eigen::MatrixXd K = tangent;
  K.triangularView<Eigen::StrictlyUpper>() = K.transpose();

  const double h = 2e-8;
  CHECK((evaluate(x, s0 + h, nullptr).energy - evaluate(x, s0 - h, nullptr).energy) / (2 * h) ==
        Approx(sums.push_N).epsilon(1e-4));
  CHECK((evaluate(x, s0 + h, nullptr).push_N - evaluate(x, s0 - h, nullptr).push_N) / (2 * h) ==
        Approx(stiff.push_stiffness).epsilon(2e-3));
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    Positions up = x, down = x;
    up.data()[i] += h;
    down.data()[i] -= h;
    CHECK((evaluate(up, s0, nullptr).energy - evaluate(down, s0, nullptr).energy) / (2 * h) ==
          Approx(f.data()[i]).margin(1e-4 * f.norm()));
    const int column = eq.of[std::size_t(i)];
    if (column < 0) continue;
    CHECK((evaluate(up, s0, nullptr).push_N - evaluate(down, s0, nullptr).push_N) / (2 * h) ==
          Approx(coupling[column]).margin(2e-3 * coupling.norm()));
    Positions fu = Positions::Zero(3, x.cols()), fd = fu;
    evaluate(up, s0, &fu);
    evaluate(down, s0, &fd);
    double worst = 0.0;
    for (std::size_t j = 0; j < eq.of.size(); ++j)
      if (const int row = eq.of[j]; row >= 0)
        worst = std::max(worst, std::abs((fu.data()[j] - fd.data()[j]) / (2 * h) - K(row, column)));
    CHECK(worst < 2e-3 * K.norm());
  }
}

}  // namespace

TEST_CASE("contact forces and stiffness are the derivatives of the contact energy, by nodes and by the advance") {
  const Vec3d direction = Vec3d(-0.3, 0, -1).normalized();
  check_contact_derivatives(Sphere{10e-3}, Vec3d(3.7e-3, 4.2e-3, 4e-3) - 5e-3 * direction, direction, 0.6e-3);
  // The carrier from above: a plate, and a rib below it that goes deeper.
  check_contact_derivatives(Carrier{{{{0, 0, 5e-3}, {20e-3, 20e-3, 5e-3}}, {{0, 0, 5e-3}, {1.1e-3, 20e-3, 5.3e-3}}}},
      Vec3d(4e-3, 4e-3, 4.2e-3), Vec3d(0, 0, -1), 0.3e-3);
}

TEST_CASE("contact area and overlap of known fields are exact up to the facets") {
  const Vec3d size(10e-3, 10e-3, 2e-3);
  const Body body = test::block_body(size);
  const TetMesh mesh = test::block_mesh(size, test::even(10), test::even(10), test::even(1), 2, false);
  const ContactSurface surface(mesh, body, [](const Patch& p) { return p.contactable; });
  const Positions x = positions_of(mesh);
  const auto disc = [&](double cx, double cy, double r) {
    std::vector<double> f;
    for (const Vec3d& p : mesh.nodes) f.push_back(r - std::hypot(p.x() - cx, p.y() - cy));
    return f;
  };
  const auto a = disc(5e-3, 5e-3, 3e-3);
  CHECK(contact_area(surface, a, x) == Approx(pi * 9e-6).epsilon(0.01));
  const auto half_plane = [&](double at) {
    std::vector<double> f;
    for (const Vec3d& p : mesh.nodes) f.push_back(at - p.x());
    return f;
  };
  CHECK(contact_area(surface, half_plane(3.3e-3), x) ==
        Approx(33e-6).epsilon(1e-9));  // linear fields are clipped exactly
  std::vector<test::Dual> receding;    // its derivative by the edge's place is the edge's length
  for (const Vec3d& p : mesh.nodes) receding.emplace_back(3.3e-3 - p.x(), 1.0);
  CHECK(contact_area(surface, receding, x).slope == Approx(10e-3).epsilon(1e-6));
  const SetOverlap o = contact_overlap(surface, half_plane(3.3e-3), half_plane(6.6e-3), x);
  CHECK(o.both == Approx(33e-6).epsilon(1e-9));
  CHECK(o.either == Approx(66e-6).epsilon(1e-9));
  const SetOverlap far = contact_overlap(surface, disc(2e-3, 2e-3, 1e-3), disc(8e-3, 8e-3, 1e-3), x);
  CHECK(far.both == 0.0);
  CHECK(far.ratio() == 0.0);
  CHECK(contact_overlap(surface, half_plane(-1.0), half_plane(-1.0), x).ratio() == 1.0);
  // Smooth growth: a boundary that moves a little changes the area a little, never by whole facets.
  double last = contact_area(surface, disc(5e-3, 5e-3, 2.0e-3), x);
  for (double r = 2.01e-3; r < 3e-3; r += 1e-5) {
    const double now = contact_area(surface, disc(5e-3, 5e-3, r), x);
    CHECK(now > last);
    CHECK(now - last < 3.0 * 2 * pi * r * 1e-5);
    last = now;
  }
}

TEST_CASE("contact by records: every triangle with a point within the margin, and with touch 0 a disc of sqrt(2 R m)") {
  const Sphere ball{10e-3};
  const double radius = 5e-3, margin = 0.1e-3;
  const auto nearest = [](const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {  // exact: plane, or an edge
    const Vec3d n = (b - a).cross(c - a);
    const Vec3d q = p - n * n.dot(p - a) / n.squaredNorm();
    if (n.dot((b - a).cross(q - a)) >= 0.0 && n.dot((c - b).cross(q - b)) >= 0.0 && n.dot((a - c).cross(q - c)) >= 0.0)
      return (p - q).norm();
    double least = 1.0;
    for (const auto& [from, to] : {std::pair(a, b), {b, c}, {c, a}}) {
      const double t = std::clamp((p - from).dot(to - from) / (to - from).squaredNorm(), 0.0, 1.0);
      least = std::min(least, (p - from - t * (to - from)).norm());
    }
    return least;
  };
  for (const int order : {1, 2})
    for (const double bumps : {0.0, 0.05}) {
      const int n = order == 1 ? 31 : 15;
      const Vec3d size(9e-3, 9e-3, 2e-3);
      const Body body = test::block_body(size);
      const TetMesh mesh = test::block_mesh(size, test::even(n), test::even(n), test::even(1), order, false);
      const ContactSurface surface(mesh, body, [](const Patch& p) { return p.contactable; });
      Positions x = positions_of(mesh);
      for (Eigen::Index k = 0; k < x.cols(); ++k) x.col(k) += bumps * test::wavy(x.col(k), 9e-3);
      const Vec3d centre(4.4e-3, 4.7e-3, 2e-3 + radius);
      const Moving<Sphere> rigid{&ball, centre, -Vec3d::UnitZ()};
      const std::vector<char> recorded = recorded_triangles(surface, rigid, x, margin);
      std::size_t k = 0, inside = 0;
      double expected = 0.0;
      for (std::size_t f = 0; f < surface.size(); ++f)
        for (std::size_t part = 0; part < (order == 2 ? 4u : 1u); ++part) {
          std::array<Vec3d, 3> corner;
          for (std::size_t c = 0; c < 3; ++c)
            corner[c] = x.col(surface.face(f).nodes[order == 2 ? std::size_t(face_parts()[part][c]) : c]);
          const double gap = nearest(centre, corner[0], corner[1], corner[2]) - radius;
          if (std::abs(gap - margin) > 1e-6) CHECK(bool(recorded[k]) == (gap < margin));
          if (recorded[k]) {
            expected += 0.5 * (corner[1] - corner[0]).cross(corner[2] - corner[0]).norm();
            ++inside;
          }
          ++k;
        }
      REQUIRE(k == recorded.size());
      CHECK(inside > 20);
      CHECK(recorded_area(surface, recorded, x) == Approx(expected));
      if (bumps == 0.0) {  // a disc, and about it what else its triangles have
        const double disc = std::sqrt(2.0 * radius * margin + margin * margin), edge = std::sqrt(2.0) * size.x() / 30.0;
        CHECK(expected > pi * disc * disc);
        CHECK(expected < pi * std::pow(disc + edge, 2));
      }
      const std::vector<char> wider = recorded_triangles(surface, rigid, x, 2.0 * margin);
      CHECK(
          recorded_overlap(surface, recorded, wider, x).ratio() == Approx(expected / recorded_area(surface, wider, x)));
    }
}

TEST_CASE("first touch is on the exact profile, not on the mesh") {
  const FingerDesign design = plain_baseline();
  const Body body = finger(design, dragon_skin(), plain_finger());
  const double w = 14.75e-3, fp = 6e-3, ep = 6e-3;
  // A coarse stand-in mesh: only the extent of the patches matters.
  TetMesh mesh;
  mesh.order = 1;
  for (const Vec3d& v : body.vertices) mesh.nodes.push_back(v);
  for (const Facet& f : body.facets)
    if (f.patch >= 0)
      for (std::size_t k = 1; k + 1 < f.loop.size(); ++k)
        mesh.faces.push_back({{f.loop[0], f.loop[k], f.loop[k + 1], -1, -1, -1}, f.patch});
  mesh = mirrored(mirrored(mesh, 0), 1);
  for (double d : {10e-3, 30e-3})
    for (double angle : {-30.0, -15.0, 0.0, 15.0, 30.0})
      for (double y : {0.0, 5.5e-3, -22e-3}) {
        Scenario<Sphere> s{Sphere{d}, angle * pi / 180, y};
        const Touch t = first_touch(body, mesh, s);
        // Independent: the smallest advance over a dense sample of the ellipse and the sides in the plane of the
        // sphere's centre.
        const Vec3d dir = s.direction(), far = body.pivot + Vec3d(0, y, 0) - 0.1 * dir;
        double least = 1e9;
        const auto reach = [&](double px, double pz) {
          const Vec3d e = Vec3d(px, y, pz) - far;
          const double along = e.dot(dir), off2 = e.squaredNorm() - along * along, r = 0.5 * d;
          if (off2 <= r * r) least = std::min(least, along - std::sqrt(r * r - off2));
        };
        for (int k = 0; k <= 400000; ++k) reach(w * std::cos(pi * k / 400000), fp + ep * std::sin(pi * k / 400000));
        for (int k = 0; k <= 1000; ++k) reach(w, fp * k / 1000.0), reach(-w, fp * k / 1000.0);
        CHECK((t.origin - far).dot(dir) == Approx(least).margin(1e-9));
        CHECK((t.point - t.origin).norm() == Approx(0.5 * d).margin(1e-9));
      }
  Scenario<Sphere> beside{Sphere{10e-3}, 0.0, 60e-3};
  CHECK_THROWS_AS(first_touch(body, mesh, beside), InvalidArgument);
}

TEST_CASE("a tilt along the finger is the tilt across it, seen from the side") {
  const auto [body, mesh] =
      test::symmetric_block(Vec3d(20e-3, 20e-3, 10e-3), test::even(4), test::even(4), test::even(2));
  const Scenario<Sphere> across{Sphere{10e-3}, 0.4, 0.0}, along{Sphere{10e-3}, 0.4, 0.0, across.loads_N, TiltPlane::yz};
  const Touch a = first_touch(body, mesh, across), b = first_touch(body, mesh, along);
  CHECK((Vec3d(a.point.y(), a.point.x(), a.point.z()) - b.point).norm() < 1e-9);
  CHECK((Vec3d(a.origin.y(), a.origin.x(), a.origin.z()) - b.origin).norm() < 1e-9);
  CHECK(b.origin.z() == Approx(15e-3).margin(1e-9));
  CHECK(symmetry_of(across) == Symmetry{false, true});
  CHECK(symmetry_of(along) == Symmetry{true, false});
}
