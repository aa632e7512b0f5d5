#include "catch.hpp"

#include "lumo/core/chi_squared.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/localize/template_localizer.hpp"
#include "lumo/sense/profile/strip.hpp"
#include "sense/synthetic.hpp"

#include <Eigen/LU>

#include <functional>

using namespace lumo;
using namespace lumo::sense;

namespace {

const Eigen::VectorXd pad_positions = LongitudinalBins::uniform(-27.5e-3, 27.5e-3, 55).centres_m();
const std::vector<double> pad_lamps{-22e-3, -11e-3, 0.0, 11e-3, 22e-3};

/// Response of a made-up pad at x to a contact at y: a bump of the contact, and a change at the lamps beside it.
struct MadePad {
  double contact_DN_per_N, lamp_DN_per_N, width_m;
  double operator()(double x, double y, double load_N) const {
    double v = contact_DN_per_N * std::exp(-0.5 * std::pow((x - y) / width_m, 2));
    for (const double lamp : pad_lamps)
      v += lamp_DN_per_N * std::exp(-0.5 * std::pow((y - lamp) / 7e-3, 2)) *
           std::exp(-0.5 * std::pow((x - lamp) / 3e-3, 2));
    return v * load_N;
  }
};

constexpr MadePad brightens{0.6, 0.3, 4e-3}, dims{-0.5, 0.35, 4e-3};

ResponseTemplates templates_of_pad(const MadePad& pad, double spacing_m = 2e-3) {
  ResponseTemplates t;
  t.position_m = pad_positions;
  t.place_m = Eigen::VectorXd::LinSpaced(Eigen::Index(std::lround(56e-3 / spacing_m)) + 1, -28e-3, 28e-3);
  t.load_N = Eigen::Vector4d(2.0, 5.0, 10.0, 15.0);
  for (const double y : t.place_m) {
    Eigen::MatrixXd m(t.position_m.size(), 4);
    for (Eigen::Index i = 0; i < m.rows(); ++i)
      for (Eigen::Index l = 0; l < 4; ++l) m(i, l) = pad(t.position_m[i], y, t.load_N[l]);
    t.value.push_back(m);
  }
  return t;
}

TemplateLocalizer::Config knowing(const MadePad& pad) {
  TemplateLocalizer::Config c;
  c.position_m = pad_positions;
  c.noise = Eigen::VectorXd::Constant(pad_positions.size(), 0.2);
  c.unloaded = Eigen::VectorXd::Constant(pad_positions.size(), 70.0);
  c.templates = templates_of_pad(pad);
  c.lamp_m = pad_lamps;
  return c;
}

/// A log's errors, drawn as a builder would make them, not by the localiser's algebra.
struct Assembly {
  double size, glued_m, seen_m, lamps, room;
  Eigen::VectorXd lamp, shape;

  Assembly(synthetic::Normal& normal, const TemplateLocalizer::Config& c)
      : size(1.0 + c.size_sigma * normal()),
        glued_m(c.pad_sigma_m * normal()),
        seen_m(c.map_sigma_m * normal()),
        lamps(c.lamp_sigma * normal()),
        room(c.ambient_sigma * normal()),
        lamp(5),
        shape(Eigen::VectorXd::Zero(pad_positions.size())) {
    for (double& l : lamp) l = c.one_lamp_sigma * normal();
    // A smooth field by random waves, of the length that a Gaussian's spectrum has.
    constexpr int waves = 40;
    for (int k = 0; k < waves; ++k) {
      const double number = normal() / c.shape_length_m, phase = 2.0 * pi * 0.5 * std::erfc(-normal() / std::sqrt(2.0));
      shape.array() += std::sqrt(2.0 / waves) * (number * pad_positions.array() + phase).cos();
    }
  }
  Profile response(const MadePad& pad, double y, double load_N, const TemplateLocalizer::Config& c,
      synthetic::Normal& normal, std::int64_t stamp_ns) const {
    Profile p{stamp_ns, Eigen::VectorXd(pad_positions.size()), 0.0};
    for (Eigen::Index i = 0; i < p.value.size(); ++i)
      p.value[i] = size * pad(pad_positions[i] + seen_m - glued_m, y - glued_m, load_N);
    if (load_N > 0.0) p.value += c.shape_sigma * p.value.cwiseAbs().maxCoeff() * shape;
    for (Eigen::Index i = 0; i < p.value.size(); ++i) {
      double lamp_change = lamps;
      for (Eigen::Index k = 0; k < 5; ++k)
        lamp_change += lamp[k] * std::max(0.0, 1.0 - std::abs(pad_positions[i] - pad_lamps[std::size_t(k)]) / 11e-3);
      p.value[i] += 70.0 * lamp_change + room + c.noise[i] * normal();
    }
    return p;
  }
};

struct PadCount {
  int all = 0, located = 0, unknown = 0, held = 0, false_places = 0;
  double off_m = 0.0;
};

/// Over pads built anew for each contact; `altered` changes the response before it is judged.
PadCount count_contacts(
    const MadePad& pad, const MadePad& known, double load_N, int contacts,
    const std::function<void(Eigen::VectorXd&)>& altered = [](Eigen::VectorXd&) {}) {
  const TemplateLocalizer::Config c = knowing(known);
  TemplateLocalizer localizer(c);
  synthetic::Normal normal(17);
  PadCount n;
  for (int k = 0; k < contacts; ++k) {
    const Assembly built(normal, c);
    const double y = 24e-3 * (2.0 * (k + 0.5) / contacts - 1.0), origin = c.origin_sigma_m * normal();
    Profile p = built.response(pad, y + origin, load_N, c, normal, (k + 1) * 33'000'000ll);
    altered(p.value);
    const LocationEstimate e = localizer.update(p);
    ++n.all;
    n.unknown += e.unknown;
    if (e.contacts != 1) continue;
    ++n.located;
    const double off = std::abs(e.contact[0].y_m - y), half = 1.645 * std::sqrt(e.contact[0].variance_m2);
    n.off_m += off;
    n.held += off <= half;
    n.false_places += off > 8e-3 && half <= 5e-3;
  }
  return n;
}

}  // namespace

TEST_CASE("chi squared is below its tabulated quantiles as often as it should be", "[localizer]") {
  // Abramowitz & Stegun, table 26.8
  CHECK(chi_squared_quantile(1.0, 0.95) == Approx(3.84146).epsilon(1e-5));
  CHECK(chi_squared_quantile(5.0, 0.99) == Approx(15.0863).epsilon(1e-5));
  CHECK(chi_squared_quantile(24.0, 0.99) == Approx(42.9798).epsilon(1e-5));
  CHECK(chi_squared_below(2.0 * std::log(2.0), 2.0) == Approx(0.5));  // exponential
  CHECK(chi_squared_below(1e5, 24.0) == 1.0);
  CHECK_THROWS_AS(chi_squared_below(-1.0, 2.0), InvalidArgument);
  CHECK_THROWS_AS(chi_squared_quantile(2.0, 1.0), InvalidArgument);
}

TEST_CASE("the template localiser's chi squared is that of the whole covariance", "[localizer]") {
  // 20 positions: no component is left out
  TemplateLocalizer::Config c = knowing(dims);
  c.position_m = Eigen::VectorXd::LinSpaced(20, -27e-3, 27e-3);
  c.noise = Eigen::VectorXd::LinSpaced(20, 0.2, 0.4);
  c.unloaded = Eigen::VectorXd::LinSpaced(20, 60.0, 80.0);
  c.lamp_m = {};
  c.shadow_sigma = 0.7;
  c.from_m = -6e-3;
  c.to_m = 6e-3;
  c.spacing_m = 3e-3;
  TemplateLocalizer localizer(c);
  synthetic::Normal normal(4);
  Profile p{1, Eigen::VectorXd(20), 0.0};
  for (double& v : p.value) v = normal();
  p.value += 1.1 * localizer.expected(1e-3, 6.0);
  localizer.update(p);

  Eigen::MatrixXd rest = c.noise.cwiseAbs2().asDiagonal();
  rest.array() += c.ambient_sigma * c.ambient_sigma;
  rest += c.lamp_sigma * c.lamp_sigma * c.unloaded * c.unloaded.transpose();
  CHECK(localizer.chi2_free() == Approx(p.value.dot(rest.inverse() * p.value)).epsilon(1e-9));
  const TemplateField field(c.templates);
  double most = -1e300, chi2 = 0.0;
  for (const double y : localizer.grid_m())
    for (const double load : localizer.loads_N()) {
      const TemplateResponse t = field.at(c.position_m, y, load);
      const Eigen::VectorXd shadow =
          c.shadow_sigma * (-0.5 * ((c.position_m.array() - y) / c.shadow_width_m).square()).exp();
      const auto along = [&](double shift, double place) {
        return field.at(c.position_m.array() + shift, y + place, load).value;
      };
      constexpr double h = 0.25e-3;
      const Eigen::VectorXd by_place = (along(0, h) - along(0, -h)) / (2 * h),
                            by_x = (along(h, 0) - along(-h, 0)) / (2 * h), glued = c.pad_sigma_m * (by_place + by_x),
                            seen = c.map_sigma_m * by_x, size = c.size_sigma * t.value;
      Eigen::MatrixXd whole = rest + glued * glued.transpose() + seen * seen.transpose() + size * size.transpose() +
                              t.doubt * t.doubt.transpose() + shadow * shadow.transpose();
      const double error = c.shape_sigma * t.value.cwiseAbs().maxCoeff();
      for (int i = 0; i < 20; ++i)
        for (int j = 0; j < 20; ++j)
          whole(i, j) +=
              error * error * std::exp(-0.5 * std::pow((c.position_m[i] - c.position_m[j]) / c.shape_length_m, 2));
      const Eigen::VectorXd off = p.value - t.value;
      const double here = off.dot(whole.inverse() * off),
                   log_likelihood = -0.5 * (here + std::log(whole.determinant()));
      if (log_likelihood > most) chi2 = here;
      most = std::max(most, log_likelihood);
    }
  CHECK(localizer.chi2_contact() == Approx(chi2).epsilon(1e-6));
}

TEST_CASE("a localiser that knows its pad finds contacts that darken it, and its intervals hold them", "[localizer]") {
  for (const MadePad& pad : {brightens, dims}) {
    for (const double load : {2.0, 5.0, 12.0}) {
      const PadCount n = count_contacts(pad, pad, load, 600);
      INFO("contact " << pad.contact_DN_per_N << " DN/N at " << load << " N: located " << n.located << ", unknown "
                      << n.unknown << ", held " << n.held << ", false " << n.false_places << ", mean off "
                      << 1e3 * n.off_m / n.located << " mm");
      CHECK(n.unknown <= (load < 5.0 ? 24 : 15));  // χ² alone: 6 ± 2.4; 2 N are hardly more than lamps and room
      CHECK(n.held >= 0.85 * n.located);
      CHECK(n.held <= 0.97 * n.located);
      CHECK(n.false_places <= 0.01 * n.all);
      if (load >= 5.0) {
        CHECK(n.located >= (load < 10.0 ? 0.88 : 0.95) * n.all);  // 5 N change the dark pad by 2.5 DN, lamps by 0.5 DN
        CHECK(n.off_m < 1.5e-3 * n.located);
      }
    }
  }
}

TEST_CASE("without a contact none is reported, lamps that drift included", "[localizer]") {
  const PadCount n = count_contacts(dims, dims, 0.0, 2000);
  INFO("reported " << n.located << ", unknown " << n.unknown);
  CHECK(n.located <= 20);
  CHECK(n.unknown >= 4);  // 1 % asked for: 20 ± 4.4
  CHECK(n.unknown <= 40);
}

TEST_CASE("responses that are not the pad's get no place", "[localizer]") {
  const double load = 10.0;
  for (const double factor : {-1.0, -0.3}) {
    const PadCount n = count_contacts(dims, dims, load, 300, [&](Eigen::VectorXd& v) { v *= factor; });
    INFO("times " << factor << ": located " << n.located << ", unknown " << n.unknown);
    CHECK(n.located <= 0.05 * n.all);
  }
  const PadCount other = count_contacts(brightens, dims, load, 300), back = count_contacts(dims, brightens, load, 300);
  INFO("other pads': located " << other.located << " and " << back.located);
  CHECK(other.located <= 0.05 * other.all);
  CHECK(back.located <= 0.05 * back.all);
}

TEST_CASE("a recorded contact log gives templates: means by place and load, in between by both ways", "[localizer]") {
  std::vector<PressedResponse> pressed;
  const auto add = [&](double y, double load, double factor) {
    Eigen::VectorXd v(pad_positions.size());
    for (Eigen::Index i = 0; i < v.size(); ++i) v[i] = factor * dims(pad_positions[i], y, load);
    pressed.push_back({y, load, v});
  };
  for (const double y : {-20e-3, -10e-3, 0.0, 10e-3, 20e-3})
    for (const double load : {2.0, 10.0}) {
      add(y, load, 0.9);
      add(y, load, 1.1);
    }
  add(0.0, 15.0, 1.0);  // a load that other places lack
  const ResponseTemplates t = recorded_templates(pad_positions, pressed);
  CHECK(t.load_N == Eigen::Vector2d(2.0, 10.0));
  REQUIRE(t.value.size() == 5);
  CHECK(t.value[1](20, 1) == Approx(dims(pad_positions[20], -10e-3, 10.0)));
  const TemplateField field(t);
  // half way the contact's own bump lies between the two ways' answers, which differ
  const TemplateResponse half = field.at(pad_positions, 5e-3, 10.0);
  CHECK(half.doubt.cwiseAbs().maxCoeff() > 0.5);
  CHECK(field.at(pad_positions, 10e-3, 10.0).doubt.cwiseAbs().maxCoeff() < 1e-12);
  CHECK(field.at(pad_positions, 10e-3, 1.0).value[3] == Approx(0.5 * t.value[3](3, 0)));
  CHECK(field.at(pad_positions, 10e-3, 18.0).value[3] ==
        Approx(t.value[3](3, 1) + (t.value[3](3, 1) - t.value[3](3, 0))));
  CHECK_THROWS_AS(recorded_templates(pad_positions, {}), InvalidArgument);
  pressed.resize(4);  // one place
  CHECK_THROWS_AS(recorded_templates(pad_positions, pressed), InvalidArgument);
}

TEST_CASE("templates take the size that the unloaded picture shows, past LEDs and room light", "[localizer]") {
  ResponseTemplates t = templates_of_pad(dims);
  t.unloaded = 1e-4 * (5.0 + 20.0 * pad_positions.array()).matrix();
  for (auto& m : t.value) m *= 1e-5;
  const double scale = 1.4e5;
  Eigen::VectorXd seen = scale * t.unloaded;
  seen.array() += 7.0;
  for (Eigen::Index i = 0; i < seen.size(); ++i)
    for (const double lamp : pad_lamps)
      seen[i] += 60.0 * std::exp(-0.5 * std::pow((pad_positions[i] - lamp) / 0.7e-3, 2));
  const ResponseTemplates s = scaled_to(t, pad_positions, seen, pad_lamps);
  CHECK(s.value[3](10, 2) == Approx(scale * t.value[3](10, 2)).epsilon(0.05));
  CHECK_THROWS_AS(scaled_to(t, pad_positions, Eigen::VectorXd::Zero(55), pad_lamps), InvalidArgument);
}

TEST_CASE("the template localiser refuses numbers out of range", "[localizer]") {
  const auto refused = [](auto change) {
    TemplateLocalizer::Config c = knowing(brightens);
    change(c);
    CHECK_THROWS_AS(TemplateLocalizer(c), InvalidArgument);
  };
  using C = TemplateLocalizer::Config;
  refused([](C& c) { c.noise[3] = 0.0; });
  refused([](C& c) { c.unloaded.resize(2); });
  refused([](C& c) { c.templates.value.pop_back(); });
  refused([](C& c) { c.templates.value[2](0, 0) = std::nan(""); });
  refused([](C& c) { c.templates.load_N[1] = 1.0; });
  refused([](C& c) { c.lamp_m = {0.0, 0.0}; });
  refused([](C& c) { c.false_alarm = 0.0; });
  refused([](C& c) { c.size_sigma = -1.0; });
  refused([](C& c) { c.spacing_m = 1e-6; });
}
