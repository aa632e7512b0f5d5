#include "catch.hpp"

#include "lumo/core/sobol.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/emitter.hpp"
#include "lumo/optics/beer_lambert.hpp"
#include "lumo/optics/surface_optics.hpp"

#include <cmath>

using namespace lumo;

TEST_CASE("Fresnel: normal incidence, grazing incidence, equal media", "[fresnel]") {
  for (double n : {1.0, 1.41, 1.4348, 2.0}) {
    const double r = std::pow((n - 1.0) / (n + 1.0), 2);
    CHECK(fresnel(1.0, n).reflectance == Approx(r).margin(1e-15));
    CHECK(fresnel(1.0, 1.0 / n).reflectance == Approx(r).margin(1e-15));
    if (n > 1.0) CHECK(fresnel(1e-9, 1.0 / n).reflectance == Approx(1.0).margin(1e-7));
  }
  for (double c = 0.05; c < 1.0; c += 0.05) CHECK(fresnel(c, 1.0).reflectance == Approx(0.0).margin(1e-15));
}

TEST_CASE("Fresnel: at Brewster's angle half of the s-reflectance is left", "[fresnel]") {
  const double n = 1.4348, t = std::atan(n), c = std::cos(t);  // from air
  const double s = std::pow((c - n * std::sin(t)) / (c + n * std::sin(t)), 2);
  CHECK(fresnel(c, 1.0 / n).reflectance == Approx(0.5 * s));
}

TEST_CASE("Fresnel: total reflection begins at the critical angle, without a jump", "[fresnel]") {
  const double n = 1.41, critical = std::sqrt(1.0 - 1.0 / (n * n));
  CHECK(fresnel(critical * (1.0 - 1e-9), n).reflectance == 1.0);
  CHECK(fresnel(critical * (1.0 + 1e-9), n).reflectance < 1.0);
  CHECK(fresnel(critical * (1.0 + 1e-9), n).reflectance > 0.999);
  CHECK(fresnel(0.0, n).reflectance == 1.0);
}

TEST_CASE("Fresnel: reciprocity, bounds, Snell's law", "[fresnel]") {
  const double n = 1.4348;
  const Vec3d up = Vec3d::UnitZ();
  for (double c = 0.02; c <= 1.0; c += 0.02) {
    const FresnelSplit<double> in = fresnel(c, 1.0 / n);
    CHECK((in.reflectance >= 0.0 && in.reflectance <= 1.0));
    const FresnelSplit<double> back = fresnel(in.cosine_behind, n);
    CHECK(back.reflectance == Approx(in.reflectance).epsilon(1e-9));
    CHECK(back.cosine_behind == Approx(c).epsilon(1e-9));
    const Vec3d d(std::sqrt(1.0 - c * c), 0.0, -c);
    const Vec3d t = refract(d, up, 1.0 / n, in.cosine_behind);
    CHECK(t.norm() == Approx(1.0));
    CHECK(n * t.x() == Approx(d.x()).margin(1e-12));
    CHECK(t.z() < 0.0);
    const Vec3d r = reflect(d, up);
    CHECK((r - Vec3d(d.x(), 0.0, -d.z())).norm() < 1e-12);
  }
}

namespace {

/// A number with its derivative, as far as the laws of this file need one.
struct Sloped {
  double value, slope;
  Sloped(double v, double s = 0.0) : value(v), slope(s) {}
  friend Sloped operator+(Sloped a, Sloped b) { return {a.value + b.value, a.slope + b.slope}; }
  friend Sloped operator-(Sloped a, Sloped b) { return {a.value - b.value, a.slope - b.slope}; }
  friend Sloped operator*(Sloped a, Sloped b) { return {a.value * b.value, a.slope * b.value + a.value * b.slope}; }
  friend Sloped operator/(Sloped a, Sloped b) {
    return {a.value / b.value, (a.slope * b.value - a.value * b.slope) / (b.value * b.value)};
  }
  friend bool operator<(Sloped a, Sloped b) { return a.value < b.value; }
  friend Sloped sqrt(Sloped a) { return {std::sqrt(a.value), 0.5 * a.slope / std::sqrt(a.value)}; }
  friend Sloped exp(Sloped a) { return {std::exp(a.value), a.slope * std::exp(a.value)}; }
};

}  // namespace

TEST_CASE("Fresnel and Beer–Lambert take dual numbers: their derivatives are those of differences", "[fresnel]") {
  const double n = 1.4348, h = 1e-6;
  for (double c = 0.1; c < 0.95; c += 0.1) {
    const FresnelSplit<Sloped> split = fresnel(Sloped(c, 1.0), 1.0 / n);
    const FresnelSplit<double> up = fresnel(c + h, 1.0 / n), down = fresnel(c - h, 1.0 / n);
    CHECK(split.reflectance.value == fresnel(c, 1.0 / n).reflectance);
    CHECK(split.reflectance.slope == Approx((up.reflectance - down.reflectance) / (2 * h)).margin(1e-8));
    CHECK(split.cosine_behind.slope == Approx((up.cosine_behind - down.cosine_behind) / (2 * h)).margin(1e-8));
  }
  const BeerLambert medium{Medium{n, 100.0}};
  CHECK(medium.transmittance(Sloped(0.01, 1.0)).slope == Approx(-100.0 * medium.transmittance(0.01)));
}

TEST_CASE("Beer–Lambert: T(0) = 1, T(a+b) = T(a)T(b), units", "[beer-lambert]") {
  const BeerLambert m{Medium{1.4348, 3.1_dB_per_cm}};
  CHECK(m.transmittance(0.0) == 1.0);
  CHECK(m.transmittance(0.007) * m.transmittance(0.005) == Approx(m.transmittance(0.012)));
  CHECK(-10.0 * std::log10(m.transmittance(0.01)) == Approx(3.1));
  CHECK_THROWS_AS(BeerLambert(Medium{0.5, 1.0}), InvalidArgument);
  CHECK_THROWS_AS(BeerLambert(Medium{1.4, -1.0}), InvalidArgument);
  CHECK_THROWS_AS(BeerLambert(Medium{1.4, std::nan("")}), InvalidArgument);
}

TEST_CASE(
    "Opaque surfaces: directions stay on the lit side, the cosine law holds, mirror images are images", "[surface]") {
  const OwenSobol s{3};
  const Vec3d n = Vec3d(0.3, -0.8, -0.5).normalized(), in = Vec3d(-0.1, 0.9, 0.2).normalized();
  double first = 0.0, second = 0.0;
  Vec3d mean = Vec3d::Zero();
  const std::uint32_t count = 4096;
  for (std::uint32_t i = 0; i < count; ++i) {
    const Vec3d d = reflected(Lambertian{}, in, n, s(i, 0), s(i, 1), Vec3d::Ones());
    CHECK(d.norm() == Approx(1.0));
    CHECK(d.dot(n) > 0.0);
    first += d.dot(n) / count;
    second += std::pow(d.dot(n), 2) / count;
    mean += d / count;
    const Vec3d m(-1.0, 1.0, 1.0);
    const Vec3d image = reflected(Lambertian{}, m.cwiseProduct(in), m.cwiseProduct(n), s(i, 0), s(i, 1), m);
    CHECK((m.cwiseProduct(image) - d).norm() < 1e-14);
  }
  CHECK(first == Approx(2.0 / 3.0).margin(1e-3));
  CHECK(second == Approx(0.5).margin(1e-3));
  CHECK((mean - mean.dot(n) * n).norm() < 1e-3);
  CHECK((reflected(Mirror{}, in, n, 0.5, 0.5, Vec3d::Ones()) - reflect(in, n)).norm() < 1e-15);
  CHECK(reflectance(Absorber{}) == 0.0);
  CHECK_THROWS_AS(validate(SurfaceOptics(Lambertian{1.1})), InvalidArgument);
  CHECK_THROWS_AS(validate(SurfaceOptics(Mirror{std::nan("")})), InvalidArgument);
}

TEST_CASE("Emitters: broken ones are refused", "[emitter]") {
  CHECK_THROWS_AS(validate(std::vector<Emitter>{}), InvalidArgument);
  CHECK_THROWS_AS(
      validate(std::vector<Emitter>{RectangleEmitter{Vec3d::Zero(), Vec3d::UnitX(), Vec3d::UnitX(), 1.0, 0}}),
      InvalidArgument);
  CHECK_THROWS_AS(
      validate(std::vector<Emitter>{RectangleEmitter{Vec3d::Zero(), Vec3d::UnitX(), Vec3d::UnitY(), 0.0, 0}}),
      InvalidArgument);
  CHECK_THROWS_AS(validate(std::vector<Emitter>{
                      RectangleEmitter{Vec3d(0, std::nan(""), 0), Vec3d::UnitX(), Vec3d::UnitY(), 1.0, 0}}),
      InvalidArgument);
}
