#include "configuration/settings.hpp"

#include "lumo/mechanics/contact/scenario.hpp"
#include "options/options.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

namespace lumo::program {

namespace {

constexpr Limits positive_whole{1.0, 1e5}, any_seed{0.0, double(std::numeric_limits<int>::max())};
const char* const in_any_words = "be text without control characters, 1 to 40 bytes";

/// `value` times 10 to the power `shift`, as its shortest decimal says it: 0.19 mm are 0.00019 m in every bit.
double shifted(double value, int shift) {
  char text[40];
  char* end = std::to_chars(text, text + 30, value, std::chars_format::scientific).ptr;
  char* const e = std::find(text, end, 'e');
  if (e == end) return value;  // not finite
  int exponent = 0;
  std::from_chars(e[1] == '+' ? e + 2 : e + 1, end, exponent);
  end = std::to_chars(e + 1, text + 40, exponent + shift).ptr;
  double moved = 0.0;
  std::from_chars(text, end, moved);
  return moved;
}
double metres(double mm) { return shifted(mm, -3); }
double millimetres(double m) { return shifted(m, 3); }

/// What a number may be.
struct Range {
  Limits limits;
  const char* unit = "";
};

// `at` gives the member, of a configuration that may be constant.
template <class At> Setting number(std::string path, Mark mark, Range range, std::string help, At at) {
  return {std::move(path), Kind::number, mark, std::move(help), [at](const Configuration& c) { return Json(at(c)); },
      [at](Configuration& c, const Json& v) { at(c) = v.get<double>(); }, range.limits, range.unit};
}
/// Kept in m, typed in mm.
template <class At> Setting length(std::string path, Mark mark, Limits limits_mm, std::string help, At at) {
  return {std::move(path), Kind::number, mark, std::move(help),
      [at](const Configuration& c) { return Json(millimetres(at(c))); },
      [at](Configuration& c, const Json& v) { at(c) = metres(v.get<double>()); }, limits_mm, "mm"};
}
template <class At> Setting whole(std::string path, Mark mark, Limits limits, std::string help, At at) {
  return {std::move(path), Kind::whole, mark, std::move(help), [at](const Configuration& c) { return Json(at(c)); },
      [at](Configuration& c, const Json& v) { at(c) = v.get<int>(); }, limits};
}
template <class At> Setting flag(std::string path, Mark mark, std::string help, At at) {
  return {std::move(path), Kind::flag, mark, std::move(help), [at](const Configuration& c) { return Json(at(c)); },
      [at](Configuration& c, const Json& v) { at(c) = v.get<bool>(); }};
}

/// Words, and what they stand for.
template <class T> using Names = std::vector<std::pair<std::string, T>>;

template <class At, class T>
Setting choice(std::string path, Mark mark, const Names<T>& names, std::string help, At at) {
  Setting s{std::move(path), Kind::word, mark, std::move(help)};
  for (const auto& known : names) s.words.push_back(known.first);
  s.get = [at, names](const Configuration& c) {
    for (const auto& [word, value] : names)
      if (value == at(c)) return Json(word);
    return Json(nullptr);
  };
  s.put = [at, names](Configuration& c, const Json& v) {
    for (const auto& [word, value] : names)
      if (word == v) at(c) = value;
  };
  return s;
}

/// A list that is kept in another unit.
template <class At, class In, class Out>
Setting list(std::string path, Range range, std::string help, At at, std::pair<In, Out> convert) {
  Setting s{std::move(path), Kind::numbers, Mark::paper, std::move(help)};
  s.limits = range.limits;
  s.unit = range.unit;
  s.get = [at, convert](const Configuration& c) {
    Json values = Json::array();
    for (const double v : at(c)) values.push_back(convert.second(v));
    return values;
  };
  s.put = [at, convert](Configuration& c, const Json& v) {
    at(c).clear();
    for (const Json& typed : v) at(c).push_back(convert.first(typed.get<double>()));
  };
  return s;
}
double same(double v) { return v; }
double radians(double deg) { return deg * pi / 180.0; }

using Settings = std::vector<Setting>;

void add(Settings& all, Settings more) { std::move(more.begin(), more.end(), std::back_inserter(all)); }

Settings design_and_silicone() {
  Setting theta{"theta_mm", Kind::numbers, Mark::code, "Design h_fp, h_ep, w_s, h_s, w_v",
      [](const Configuration& c) { return numbers(c.pad.theta_mm); },
      [](Configuration& c, const Json& v) {
        std::array<double, 5> given{};
        for (std::size_t i = 0; i < 5; ++i) given[i] = v[i].get<double>() + 0.0;  // no −0
        c.pad.theta_mm = FingerDesign::from(given).values();  // on the lattice in every bit, but for rounding
      }};
  theta.limits = {-std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  theta.unit = "mm";
  theta.count = 5;
  Setting name{"silicone.name", Kind::word, Mark::paper,
      "DS (Dragon Skin) or Sol (Solaris), which have all their numbers; any other name needs them all",
      [](const Configuration& c) { return Json(c.pad.silicone.name); },
      [](Configuration& c, const Json& v) {
        const std::string word = v.get<std::string>();
        if (const std::optional<Silicone> card = find_silicone(word)) c.pad.silicone = *card;
        else c.pad.silicone.name = word;
      }};
  using enum Mark;
  return {theta, name,
      number(
          "silicone.density_kg_per_m3", paper, {densities_kg_per_m3, "kg/m3"}, "Density",
          [](auto& c) -> auto& { return c.pad.silicone.density_kg_per_m3; }),
      number(
          "silicone.shear_modulus_Pa", paper, {shear_moduli_Pa, "Pa"}, "Shear modulus",
          [](auto& c) -> auto& { return c.pad.silicone.mu_Pa; }),
      number(
          "silicone.first_lame_parameter_Pa", paper, {lame_parameters_Pa, "Pa"}, "Lamé's first parameter",
          [](auto& c) -> auto& { return c.pad.silicone.lambda_Pa; }),
      number(
          "silicone.refractive_index", paper, {refractive_indices}, "Refractive index",
          [](auto& c) -> auto& { return c.pad.silicone.refractive_index; }),
      number(
          "silicone.absorption_per_m", paper, {extinctions_per_m, "1/m"},
          "Absorption; by default all of the paper's extinction",
          [](auto& c) -> auto& { return c.pad.silicone.absorption_per_m; }),
      number(
          "silicone.scattering_per_m", paper, {extinctions_per_m, "1/m"}, "Scattering",
          [](auto& c) -> auto& { return c.pad.silicone.scattering_per_m; }),
      number(
          "silicone.scattering_anisotropy", lumo, {anisotropies}, "Mean cosine of the angle of scattering",
          [](auto& c) -> auto& { return c.pad.silicone.anisotropy; })};
}

Settings finger_shape() {
  using enum Mark;
  const auto pad_length = [](const char* path, Mark mark, Limits limits, const char* help, auto member) {
    return number(
        path, mark, {limits, "mm"}, help, [member](auto& c) -> auto& { return c.pad.finger.pad.*member; });
  };
  using P = PadDimensions;
  return {pad_length("finger.width_mm", code, {1, 200}, "Width of the pad", &P::width),
      pad_length("finger.length_mm", code, {1, 1000}, "Length of the part that has a cavity", &P::length),
      pad_length("finger.cap_length_mm", code, {0, 1000}, "Length of the solid distal cap beyond it", &P::cap_length),
      pad_length("finger.shoulder_width_mm", code, {0, 100}, "Silicone beside the carrier's block", &P::shoulder_width),
      pad_length("finger.shoulder_height_mm", code, {0, 100}, "How far it hangs down there", &P::shoulder_height),
      pad_length("finger.carrier_height_mm", code, {0.001, 200}, "Of the carrier below the base", &P::carrier_height),
      choice(
          "finger.stem", code, Names<Stem>{{"bonded", Stem::bonded}, {"free", Stem::free}},
          "Does the silicone hold to the stem (bonded), or lie on it, which only pushes (free)?",
          [](auto& c) -> auto& { return c.pad.finger.pad.stem; }),
      length(
          "finger.stem_edge_radius_mm", lumo, {0, 1}, "Of the edges of a free stem and its ridges; 0: sharp",
          [](auto& c) -> auto& { return c.pad.finger.stem_edge_radius; }),
      pad_length("finger.t_min_mm", paper, {0, 100}, "Smallest thickness of silicone", &P::t_min),
      choice(
          "finger.t_min_rule", code,
          Names<Thickness>{
              {"euclidean", Thickness::euclidean}, {"along_axes", Thickness::along_axes}, {"above", Thickness::above}},
          "How that is measured", [](auto& c) -> auto& { return c.pad.finger.pad.thickness; }),
      flag(
          "finger.held_ends", lumo, "Are the end faces held, by something clear?",
          [](auto& c) -> auto& { return c.pad.finger.bonded_ends; }),
      choice(
          "finger.tilt_about", code, Names<TiltPivot>{{"base", TiltPivot::base}, {"flat_top", TiltPivot::flat_top}},
          "Height about which an approach is tilted: z = 0 or z = h_fp",
          [](auto& c) -> auto& { return c.pad.finger.pivot; })};
}

/// How a tool that touches meets light: a word and, for some, a reflectance.
Settings touched_surface() {
  Setting word{"finger.touched", Kind::word, Mark::lumo,
      "The surface under a tool: air (a film is left), or wetted by a black, white or mirror tool"};
  word.words = {"air", "black", "white", "mirror"};
  word.get = [words = word.words](const Configuration& c) {
    const std::array<std::size_t, 4> place = {0, 2, 3, 1};  // of the variant's alternatives
    return Json(words[place[c.pad.finger.touched.index()]]);
  };
  word.put = [](Configuration& c, const Json& v) {
    SurfaceOptics& touched = c.pad.finger.touched;
    if (v == "air") touched = Dielectric{};
    else if (v == "black") touched = Absorber{};
    else if (v == "white") touched = Lambertian{};
    else touched = Mirror{};
  };
  Setting part{"finger.touched_reflectance", Kind::number_or_null, Mark::lumo, "Of a white or mirror tool; else null"};
  part.limits = {0.0, 1.0};
  part.get = [](const Configuration& c) {
    if (const auto* white = std::get_if<Lambertian>(&c.pad.finger.touched)) return Json(white->albedo);
    if (const auto* mirror = std::get_if<Mirror>(&c.pad.finger.touched)) return Json(mirror->reflectance);
    return Json(nullptr);
  };
  part.put = [](Configuration& c, const Json& v) {
    auto* white = std::get_if<Lambertian>(&c.pad.finger.touched);
    auto* mirror = std::get_if<Mirror>(&c.pad.finger.touched);
    if ((white != nullptr || mirror != nullptr) == v.is_null())
      throw Misfit{"", v.is_null() ? "be a number in [0, 1]: the tool is white or a mirror"
                                   : "be null: the tool is neither white nor a mirror"};
    if (white != nullptr) white->albedo = v.get<double>();
    if (mirror != nullptr) mirror->reflectance = v.get<double>();
  };
  return {word, part};
}

Settings finger_light() {
  using enum Mark;
  using Place = FingerOptions::Leds::Place;
  Setting film{"leds.film_closes_mm", Kind::number_or_null, lumo,
      "Height of the film of air over an LED at which it begins to close under load; 0: on touch; null: never",
      [](const Configuration& c) {
        const auto& closes = c.pad.finger.recess.film_closes;
        return closes ? Json(millimetres(*closes)) : Json(nullptr);
      },
      [](Configuration& c, const Json& v) {
        auto& closes = c.pad.finger.recess.film_closes;
        if (v.is_null()) closes.reset();
        else closes = metres(v.get<double>());
      }};
  film.limits = {0.0, 1.0};
  film.unit = "mm";
  return {number(
              "finger.carrier_albedo", code, {{0, 1}}, "Of the white carrier",
              [](auto& c) -> auto& { return c.pad.finger.carrier_albedo; }),
      choice(
          "leds.place", paper, Names<Place>{{"top", Place::top}, {"sides", Place::sides}}, "On the stem",
          [](auto& c) -> auto& { return c.pad.finger.leds.place; }),
      whole(
          "leds.count", paper, {0, 1000}, "Along the finger", [](auto& c) -> auto& { return c.pad.finger.leds.count; }),
      length(
          "leds.pitch_mm", paper, {0, 1000}, "From one to the next",
          [](auto& c) -> auto& { return c.pad.finger.leds.pitch; }),
      length(
          "leds.length_mm", code, {0.001, 100}, "Along the finger",
          [](auto& c) -> auto& { return c.pad.finger.leds.length_y; }),
      length(
          "leds.width_mm", code, {0.001, 100}, "Across it", [](auto& c) -> auto& { return c.pad.finger.leds.width_x; }),
      number(
          "leds.power_W", lumo, {{1e-9, 1e9}, "W"}, "Of all together",
          [](auto& c) -> auto& { return c.pad.finger.leds.power_W; }),
      length(
          "leds.recess_depth_mm", code, {0, 1}, "Of the hollow in the stem's top that each lies in; 0: none",
          [](auto& c) -> auto& { return c.pad.finger.recess.depth; }),
      length(
          "leds.recess_length_mm", code, {0.001, 100}, "Along the finger",
          [](auto& c) -> auto& { return c.pad.finger.recess.length_y; }),
      film};
}

Settings readout() {
  using enum Mark;
  return {whole(
              "readout.bins", paper, {0, 10000}, "Regions along the finger",
              [](auto& c) -> auto& { return c.pad.finger.readout.bins; }),
      length(
          "readout.half_range_mm", code, {0.001, 1000}, "Half of the length that is seen, about y = 0",
          [](auto& c) -> auto& { return c.pad.finger.readout.half_range; }),
      number(
          "readout.min_abs_nx", inferred, {{0, 1}}, "How far sideways the normal of a surface that is seen points",
          [](auto& c) -> auto& { return c.pad.finger.readout.min_abs_nx; }),
      choice(
          "readout.side", code, Names<bool>{{"one", true}, {"both", false}}, "Which is seen: +x alone, or both",
          [](auto& c) -> auto& { return c.pad.finger.readout.one_side; }),
      flag(
          "readout.by_direction", inferred,
          "Is light seen that leaves towards +x, from wherever? Otherwise by the normal of the surface it leaves",
          [](auto& c) -> auto& { return c.pad.finger.readout.by_direction; }),
      flag(
          "readout.in_space", inferred, "Do regions stay where they are? Otherwise they move with the material",
          [](auto& c) -> auto& { return c.pad.finger.readout.in_space; })};
}

Settings cameras() {
  using enum Mark;
  const auto part = [](const char* path, Range range, const char* help, auto member) {
    return number(
        path, lumo, range, help, [member](auto& c) -> auto& { return c.camera.*member; });
  };
  const auto count = [](const char* path, Limits limits, const char* help, auto member) {
    return whole(
        path, lumo, limits, help, [member](auto& c) -> auto& { return c.camera.*member; });
  };
  const Limits sizes{1, 4096};
  using C = CameraSettings;
  using By = Observation::By;
  return {part("camera.distance_mm", {{10, 10000}, "mm"}, "From the side x > 0, at whose middle it is aimed",
              &C::distance_mm),
      part("camera.yaw_deg", {{-80, 80}, "deg"}, "Where it stands: towards +y", &C::yaw_deg),
      part("camera.pitch_deg", {{-10, 89}, "deg"}, "Likewise: above the base plane, it looks down by so much",
          &C::pitch_deg),
      part("camera.roll_deg", {{-180, 180}, "deg"}, "About its line of sight", &C::roll_deg),
      part("camera.along_mm", {{-200, 200}, "mm"}, "Of what it is aimed at: beside the side's middle, along y",
          &C::along_mm),
      part("camera.height_mm", {{-200, 200}, "mm"}, "Likewise: above it", &C::height_mm),
      part("camera.focal_px", {{1, 100000}, "px"}, "Focal length", &C::focal_px),
      count("camera.columns", sizes, "Pixels of the picture", &C::columns),
      count("camera.rows", sizes, "Likewise", &C::rows),
      part("camera.aperture_mm", {{0.001, 100}, "mm"}, "Radius of its lens' opening; what it is aimed at is sharp",
          &C::aperture_mm),
      part("camera.exposure_ms", {{0.001, 10000}, "ms"}, "Exposure of the picture", &C::exposure_ms),
      part("camera.gain", {{0.01, 10000}}, "Gain of the picture", &C::gain),
      count("camera.samples", {1, 65536}, "Lines of sight a pixel: 1, 2, 4 or a multiple of 8", &C::samples),
      choice(
          "observation.by", paper,
          Names<By>{{"side", By::side}, {"camera", By::camera}, {"photodiodes", By::photodiodes}},
          "Light that evaluate has J_obs of: all that leaves the regions of the side, in whatever direction; of them, "
          "what the camera's lens takes in; or what falls on photodiodes, one before each region",
          [](auto& c) -> auto& { return c.observation.by; }),
      number(
          "observation.diode_gap_mm", lumo, {{0.1, 100}, "mm"}, "From the side x > 0 to the photodiodes",
          [](auto& c) -> auto& { return c.observation.diode_gap_mm; }),
      number(
          "observation.diode_mm", lumo, {{0.1, 20}, "mm"}, "Edge of a photodiode",
          [](auto& c) -> auto& { return c.observation.diode_mm; })};
}

Settings meshes() {
  using enum Mark;
  using M = FingerOptions::Mesh;
  const auto edge = [](const char* path, Limits limits, const char* help, auto member) {
    return length(
        path, lumo, limits, help, [member](auto& c) -> auto& { return c.pad.finger.mesh.*member; });
  };
  const auto plain = [](const char* path, Limits limits, const char* help, auto member) {
    return number(
        path, lumo, {limits}, help, [member](auto& c) -> auto& { return c.pad.finger.mesh.*member; });
  };
  return {edge("mesh.contact_edge_mm", {0.2, 10}, "Where a tool can touch, away from where it does", &M::contact_edge),
      edge("mesh.coarsest_edge_mm", {0.2, 30}, "At depth", &M::coarsest_edge),
      plain("mesh.growth", {0, 100}, "Edge length gained per length of depth", &M::growth),
      plain("mesh.stretch_along", {0.5, 4}, "Edges along the finger are this much longer", &M::stretch_y),
      plain("mesh.largest_turn_rad", {0.01, 1.6}, "Of the profile along one edge", &M::max_turn_rad),
      edge("mesh.shortest_chord_mm", {0, 10}, "Of the profile", &M::shortest_chord),
      edge("mesh.support_edge_mm", {0.1, 30}, "Where silicone lies free on the carrier", &M::support_edge),
      edge("mesh.seam_edge_mm", {0.05, 30}, "At a bonded stem's edges below a tool", &M::seam_edge),
      edge("mesh.stem_edge_mm", {0.05, 30}, "At a free stem's rounded edges below a tool", &M::stem_edge),
      length(
          "mesh.finest_edge_mm", lumo, {0.02, 30}, "Where a tool touches first",
          [](auto& c) -> auto& { return c.focus.finest; }),
      number(
          "mesh.growth_from_touch", lumo, {{0.01, 10}}, "Edge length gained per distance from there",
          [](auto& c) -> auto& { return c.focus.growth; }),
      number(
          "mesh.growth_below_touch", lumo, {{0, 10}}, "And per depth below it",
          [](auto& c) -> auto& { return c.focus.depth_growth; }),
      number(
          "mesh.finest_of_tool", lumo, {{0.001, 1000}},
          "Edges where a tool touches are at most this part of its contact radius",
          [](auto& c) -> auto& { return c.focus.of_tool; })};
}

/// What --mode paper decides may be said once more, not otherwise.
template <class T> Setting decided(std::string path, const Names<T>& names, std::string help, T Mechanics::*which) {
  Setting s = choice(
      std::move(path), Mark::lumo, names, std::move(help), [which](auto& c) -> auto& { return c.mechanics.*which; });
  s.put = [free = s.put, which](Configuration& c, const Json& v) {
    Configuration asked = c;
    free(asked, v);
    if (c.mechanics.paper && asked.mechanics.*which != c.mechanics.*which)
      throw Misfit{"contradicts mode paper, which is " + std::string(name(c.mechanics.*which)),
          "be " + std::string(name(c.mechanics.*which))};
    c = std::move(asked);
  };
  return s;
}

Setting friction_on_carrier() {
  Setting s{"mechanics.carrier_friction", Kind::number_or_null, Mark::lumo,
      "Of the pad and the carrier that it lies on; null: that of tool and pad",
      [](const Configuration& c) {
        const auto& own = c.mechanics.carrier_friction;
        return own ? Json(*own) : Json(nullptr);
      },
      [](Configuration& c, const Json& v) {
        c.mechanics.carrier_friction = v.is_null() ? std::nullopt : std::optional(v.get<double>());
      }};
  s.limits = {0.0, 10.0};
  return s;
}

Settings mechanics_settings() {
  using enum Mark;
  Setting mode{"mechanics.mode", Kind::word, lumo,
      "default, or paper: 1 mm linear tetrahedra, vertex block descent in time, Newton's law, friction; held states "
      "are "
      "scored",
      [](const Configuration& c) { return Json(c.mechanics.paper ? "paper" : "default"); },
      [](Configuration& c, const Json& v) {
        const Mechanics before = std::exchange(c.mechanics, v == "paper" ? paper_mechanics() : Mechanics{});
        c.mechanics.hold_s = before.hold_s;  // what is recorded of a press is chosen beside how it is computed
        c.mechanics.record_margin_mm = before.record_margin_mm;
        c.mechanics.time_limit_s = before.time_limit_s;
      }};
  mode.words = {"default", "paper"};
  Setting size{"mechanics.edge_mm", Kind::number_or_null, lumo, "Of all edges; null: graded, fine at the contact",
      [](const Configuration& c) { return c.mechanics.size_mm > 0.0 ? Json(c.mechanics.size_mm) : Json(nullptr); },
      [](Configuration& c, const Json& v) { c.mechanics.size_mm = v.is_null() ? 0.0 : v.get<double>(); }};
  size.limits = {0.2, 10.0};
  size.unit = "mm";
  using M = Mechanics;
  return {mode,
      decided("mechanics.solver", Names<M::Solver>{{"quasi_static", M::Solver::quasi_static}, {"vbd", M::Solver::vbd}},
          "Equilibria, or vertex block descent in time: 5 mm/s to each load, and a hold", &M::solver),
      decided("mechanics.element",
          Names<M::Element>{{"linear", M::Element::linear}, {"quadratic", M::Element::quadratic}},
          "Tetrahedra; linear ones lock", &M::element),
      size,
      whole(
          "mechanics.sweeps", paper, {1, 1e6}, "Of vbd, per 0.01 s step",
          [](auto& c) -> auto& { return c.mechanics.sweeps; }),
      decided("mechanics.law", Names<M::Law>{{"neo_hookean", M::Law::neo_hookean}, {"newton", M::Law::newton}},
          "Neo-Hookean law: with a logarithm, or Newton's without one", &M::law),
      number(
          "mechanics.contact_stiffness_N_per_m3", lumo, {{1e6, 1e15}, "N/m3"}, "Of the contact penalty",
          [](auto& c) -> auto& { return c.mechanics.contact_stiffness_N_per_m3; }),
      choice(
          "mechanics.contact_points", lumo,
          Names<M::Points>{{"surface", M::Points::surface}, {"vertex", M::Points::vertex}},
          "Contact all over the surface, or at each vertex", [](auto& c) -> auto& { return c.mechanics.points; }),
      number(
          "mechanics.friction", lumo, {{0, 10}}, "Coulomb's coefficient of tool and pad",
          [](auto& c) -> auto& { return c.mechanics.friction; }),
      friction_on_carrier(),
      number(
          "mechanics.hold_s", paper, {{0, 1000}, "s"},
          "Of vbd, at each load; 0: the state is that of the first step at which the load is met",
          [](auto& c) -> auto& { return c.mechanics.hold_s; }),
      number(
          "mechanics.record_margin_mm", lumo, {{0, 10}, "mm"},
          "0: the contact set is where the pad touches; else all triangles that come so near to the tool, which "
          "depends "
          "on the mesh",
          [](auto& c) -> auto& { return c.mechanics.record_margin_mm; })};
}

const Names<TiltPlane> tilt_planes = {{"across", TiltPlane::xz}, {"along", TiltPlane::yz}};

Settings contacts_settings() {
  using enum Mark;
  const Range diameters{sphere_diameters_mm, "mm"}, angles{approach_angles_deg, "deg"}, places{contact_places_mm, "mm"},
      loads{loads_admitted_N, "N"};
  Setting name_of{"ensemble.name", Kind::word, paper,
      "flat or curved: the paper's; flat-authors or curved-authors: its authors' code's; own: as the lists below say",
      [](const Configuration& c) { return Json(name(c.ensemble)); },
      [](Configuration& c, const Json& v) {
        for (const NamedEnsemble& known : named_ensembles())
          if (known.name == v.get<std::string>()) c.ensemble = known.ensemble;
      }};
  for (const NamedEnsemble& known : named_ensembles()) name_of.words.emplace_back(known.name);
  name_of.words.emplace_back("own");
  const std::pair none(&same, &same), lengths(&metres, &millimetres), turns(&radians, &degrees);
  Settings all = {number(
                      "contact.diameter_mm", paper, diameters, "Of the one sphere of press and trace",
                      [](auto& c) -> auto& { return c.touch.diameter_mm; }),
      number(
          "contact.angle_deg", paper, angles, "Of its approach from the pad's normal",
          [](auto& c) -> auto& { return c.touch.angle_deg; }),
      number(
          "contact.x_mm", lumo, places, "Its place across the finger", [](auto& c) -> auto& { return c.touch.x_mm; }),
      number(
          "contact.y_mm", paper, places, "Its place along the finger", [](auto& c) -> auto& { return c.touch.y_mm; }),
      list(
          "contact.loads_N", loads, "Its loads", [](auto& c) -> auto& { return c.touch.loads_N; }, none),
      choice(
          "contact.tilt", code, tilt_planes, "Plane of the tilt: across the finger, or along it",
          [](auto& c) -> auto& { return c.touch.tilt; }),
      name_of,
      list(
          "ensemble.diameters_mm", diameters, "Spheres of evaluate and campaign",
          [](auto& c) -> auto& { return c.ensemble.diameters_m; }, lengths),
      list(
          "ensemble.angles_deg", angles, "Each at each angle", [](auto& c) -> auto& { return c.ensemble.angles_rad; },
          turns),
      list(
          "ensemble.places_mm", places, "And at each place", [](auto& c) -> auto& { return c.ensemble.places_m; },
          lengths),
      list(
          "ensemble.loads_N", loads, "Under these loads", [](auto& c) -> auto& { return c.ensemble.loads_N; }, none),
      choice(
          "ensemble.tilt", code, tilt_planes, "Plane of the tilt", [](auto& c) -> auto& { return c.ensemble.tilt; })};
  for (Setting& s : all) s.increasing = s.path.ends_with("loads_N");
  return all;
}

Settings efforts() {
  using enum Mark;
  const Limits rays{64, 1 << 28};
  return {number(
              "light.ray_error_percent", lumo, {{0.1, 100}, "%"}, "Standard error of J_obs up to which rays are added",
              [](auto& c) -> auto& { return c.light.ray_error_percent; }),
      whole(
          "light.rounds", lumo, {0, 40}, "At most, in which they are", [](auto& c) -> auto& { return c.light.rounds; }),
      whole(
          "light.rays_per_emitter", lumo, rays,
          "Of a trace, a quarter of it in a pilot; a power of two, as the next two",
          [](auto& c) -> auto& { return c.light.rays_per_emitter; }),
      whole(
          "light.carrier_rays", lumo, rays, "From the carrier's faces",
          [](auto& c) -> auto& { return c.light.carrier_rays; }),
      whole(
          "light.exit_rays", lumo, rays, "From the faces that are seen",
          [](auto& c) -> auto& { return c.light.exit_rays; }),
      whole(
          "search.evaluations", paper, positive_whole, "Successful ones to reach",
          [](auto& c) -> auto& { return c.search.evaluations; }),
      whole(
          "search.seed", lumo, any_seed, "Of the optimiser", [](auto& c) -> auto& { return c.search.seed; }),
      whole(
          "search.pending", lumo, {1, 1000},
          "Designs under way at once: part of the problem, so that results do not depend on the number of workers",
          [](auto& c) -> auto& { return c.search.pending; }),
      choice(
          "search.source", lumo, Names<std::string>{{"default", "default"}, {"paper", "paper"}},
          "Candidates: default (with neighbours of the front) or paper (256 fresh ones)",
          [](auto& c) -> auto& { return c.search.source; }),
      choice(
          "search.references", code, Names<References>{{"built", References::built}, {"plain", References::plain}},
          "Designs that it starts with", [](auto& c) -> auto& { return c.search.references; }),
      choice(
          "search.noise", lumo,
          Names<Noise>{{"estimated", Noise::estimated}, {"none", Noise::none}, {"present", Noise::present}},
          "Do the models know the objectives' errors? none: they take every value for exact",
          [](auto& c) -> auto& { return c.search.noise; }),
      whole(
          "lab.seed", lumo, any_seed, "Of everything random", [](auto& c) -> auto& { return c.lab.seed; }),
      whole(
          "lab.joints", lumo, {1, 2}, "Of the finger of lab force", [](auto& c) -> auto& { return c.lab.joints; }),
      number(
          "lab.noise", lumo, {{0, 100}}, "Times the rig's noises", [](auto& c) -> auto& { return c.lab.noise; }),
      number(
          "lab.stiffness", lumo, {{0.8, 2}}, "Of the specimen's silicone, times the nominal one",
          [](auto& c) -> auto& { return c.lab.stiffness; }),
      number(
          "lab.lamps", lumo, {{0.1, 3}}, "Power of the specimen's LEDs, times the nominal one",
          [](auto& c) -> auto& { return c.lab.lamps; })};
}

/// What a virtual rig may be besides; off unless asked for, but the exposure.
Settings lab_disturbances() {
  using enum Mark;
  return {choice(
              "lab.exposure", paper, Names<std::string>{{"one", "one"}, {"pad", "pad"}},
              "Of the camera: one for all pads of a kind of finger, or for each pad its own",
              [](auto& c) -> auto& { return c.lab.exposure; }),
      number(
          "lab.diameter_mm", paper, {{2, 100}, "mm"}, "Of the sphere",
          [](auto& c) -> auto& { return c.lab.diameter_mm; }),
      number(
          "lab.angle_deg", lumo, {{-10, 10}, "°"}, "Of approach from the side",
          [](auto& c) -> auto& { return c.lab.angle_deg; }),
      number(
          "lab.slide_mm", lumo, {{-20, 20}, "mm"}, "Way of each contact along the finger, from touch to leaving",
          [](auto& c) -> auto& { return c.lab.slide_mm; }),
      number(
          "lab.creep", lumo, {{0, 5}}, "Times the parts of the silicone's stiffness that relax",
          [](auto& c) -> auto& { return c.lab.creep; }),
      number(
          "lab.room", lumo, {{0, 20}}, "Times the room's light", [](auto& c) -> auto& { return c.lab.room; }),
      number(
          "lab.shadow", lumo, {{0, 1}}, "Share of the room's light that the tool takes away before it",
          [](auto& c) -> auto& { return c.lab.shadow; }),
      number(
          "lab.assembly", lumo, {{0, 5}},
          "Times an assembly's errors: pad 1 mm, LED strip 0.5 mm, camera's distance 2 %, distortion 0.1",
          [](auto& c) -> auto& { return c.lab.assembly; }),
      number(
          "lab.one_lamp_percent", lumo, {{0, 30}, "%"}, "Change of each LED by itself, standard deviation",
          [](auto& c) -> auto& { return c.lab.one_lamp_percent; }),
      number(
          "lab.cogging_mNm", lumo, {{0, 1000}, "mN·m"}, "Amplitude of the motor's cogging",
          [](auto& c) -> auto& { return c.lab.cogging_mNm; }),
      number(
          "lab.backlash_deg", lumo, {{0, 10}, "°"}, "Of the joint's gear",
          [](auto& c) -> auto& { return c.lab.backlash_deg; }),
      number(
          "lab.clock_offset_ms", lumo, {{-1000, 1000}, "ms"}, "Of the joints' stamps, which the session does not state",
          [](auto& c) -> auto& { return c.lab.clock_offset_ms; })};
}

/// Apart from the mechanics, which decide results: a store goes on under another limit.
Settings time_limits() {
  Setting s{"limits.scenario_time_s", Kind::number_or_null, Mark::lumo,
      "Time that the press of one scenario may take, by the clock; null: any. campaign run: 3600 unless it is set",
      [](const Configuration& c) { return maybe(c.mechanics.time_limit_s); },
      [](Configuration& c, const Json& v) {
        c.mechanics.time_limit_s = v.is_null() ? std::nullopt : std::optional(v.get<double>());
      }};
  s.limits = {0.001, 1e9};
  s.unit = "s";
  return {s};
}

Settings casting() {
  namespace limits = casting_limits;
  const auto part = [](const char* path, Limits limits_mm, const char* help, auto member) {
    return length(
        path, Mark::lumo, limits_mm, help, [member](auto& c) -> auto& { return c.casting.*member; });
  };
  using C = CastingOptions;
  return {part("casting.clearance_mm", limits::clearance_mm, "On each side between printed parts", &C::clearance),
      part("casting.plate_mm", limits::plate_mm, "Thickness of a flat carrier's plate; a stair's is the finger's own",
          &C::plate),
      part("casting.wall_mm", limits::wall_mm, "Of the mould about the pad", &C::wall),
      part("casting.strip_width_mm", limits::strip_width_mm, "Width of the LED strip", &C::strip_width),
      part("casting.strip_height_mm", limits::strip_height_mm, "Height of the LED strip with its LEDs",
          &C::strip_height),
      part("casting.gate_mm", limits::gate_mm, "Diameter of the gate at the pad", &C::gate_diameter),
      part("casting.vent_mm", limits::vent_mm, "Diameter of the vents at the pad", &C::vent_diameter)};
}

Settings make_settings() {
  Settings all = design_and_silicone();
  for (auto* group : {&finger_shape, &touched_surface, &finger_light, &readout, &meshes, &mechanics_settings,
           &contacts_settings, &efforts, &lab_disturbances, &time_limits, &cameras, &casting})
    add(all, group());
  return all;
}

std::string in_limits(const Setting& s) {
  return lumo::message("lie in [", s.limits.low, ", ", s.limits.high, "]", s.unit.empty() ? "" : " ", s.unit);
}

void check_number(const Setting& s, const Json& v) {
  const std::string unit = s.unit.empty() ? "" : " [" + s.unit + "]";
  const std::string or_null = s.kind == Kind::number_or_null ? " or null" : "";
  if (!v.is_number()) throw Misfit{"", "be a number" + or_null + unit};
  if (!std::isfinite(v.get<double>())) throw Misfit{"", "be a finite number" + or_null + unit};
  if (!(v.get<double>() >= s.limits.low && v.get<double>() <= s.limits.high)) throw Misfit{"", in_limits(s)};
}

void check_whole(const Setting& s, const Json& v) {
  const bool fits = v.is_number_integer() && v.get<double>() >= s.limits.low && v.get<double>() <= s.limits.high;
  if (!fits)
    throw Misfit{
        "", lumo::message("be a whole number from ", (long long)(s.limits.low), " to ", (long long)(s.limits.high))};
}

void check_theta(const Json& v) {
  const std::string wanted = "be five numbers h_fp,h_ep,w_s,h_s,w_v [mm]";
  if (!v.is_array()) throw Misfit{"", wanted};
  if (v.size() != 5) throw Misfit{lumo::message(v.size(), v.size() == 1 ? " field" : " fields"), wanted};
  for (int i = 0; i < 5; ++i)
    if (!v[std::size_t(i)].is_number()) throw Misfit{"is not a number", wanted, i};
}

void check_list(const Setting& s, const Json& v) {
  const std::string wanted =
      lumo::message("be ", s.increasing ? "increasing loads" : "a list of numbers", " [", s.unit, "]");
  if (!v.is_array() || v.empty()) throw Misfit{"", wanted};
  if (v.size() > 1000) throw Misfit{lumo::message(v.size(), " of them"), "be at most 1000 numbers"};
  for (std::size_t i = 0; i < v.size(); ++i) {
    const int at = int(i);
    if (!v[i].is_number()) throw Misfit{"is not a number", wanted, at};
    const double value = v[i].get<double>();
    if (!(value >= s.limits.low && value <= s.limits.high))
      throw Misfit{
          "is out of range", lumo::message(wanted, ", each in [", s.limits.low, ", ", s.limits.high, "] ", s.unit), at};
    if (s.increasing && i > 0 && value <= v[i - 1].get<double>())
      throw Misfit{"follows " + exact(v[i - 1].get<double>()) + " " + s.unit, wanted, at};
    if (std::find(v.begin(), v.begin() + std::ptrdiff_t(i), v[i]) != v.begin() + std::ptrdiff_t(i))
      throw Misfit{"is there twice", wanted, at};
  }
}

void check_word(const Setting& s, const Json& v) {
  std::string list;
  for (const std::string& word : s.words) {
    if (word == v) return;
    list += (list.empty() ? "" : " or ") + word;
  }
  if (!s.words.empty()) throw Misfit{"", "be " + list};
  const std::string* const text = v.get_ptr<const std::string*>();
  const auto control = [](char c) { return static_cast<unsigned char>(c) < 32 || c == 127; };
  if (text == nullptr || text->empty() || text->size() > 40 || std::any_of(text->begin(), text->end(), control))
    throw Misfit{"", in_any_words};
}

}  // namespace

std::string short_form(const Json& v) {
  return v.is_string() ? in_quotes(v.get<std::string>()) : shortened(text_of(v, -1));
}

std::string_view name(Mark mark) {
  switch (mark) {
    case Mark::paper: return "paper";
    case Mark::code: return "code";
    case Mark::inferred: return "inferred";
    default: return "lumo";
  }
}

Mark source_of(const Setting& s, const Configuration& configuration) {
  return s.mark == Mark::code && s.get(configuration) != s.get(Configuration{}) ? Mark::lumo : s.mark;
}

const std::vector<Setting>& settings() {
  static const std::vector<Setting> all = make_settings();
  return all;
}

const Setting& setting(const std::string& path) {
  for (const Setting& s : settings())
    if (s.path == path) return s;
  std::vector<std::string> paths;
  for (const Setting& s : settings()) paths.push_back(s.path);
  throw UsageError("unknown setting " + in_quotes(path) + ", the nearest is '" + nearest(path, paths) + "'");
}

void put(const Setting& s, Configuration& configuration, const Json& v) {
  switch (s.kind) {
    case Kind::number_or_null:
      if (v.is_null()) break;
      [[fallthrough]];
    case Kind::number: check_number(s, v); break;
    case Kind::whole: check_whole(s, v); break;
    case Kind::flag:
      if (!v.is_boolean()) throw Misfit{"", "be true or false"};
      break;
    case Kind::word: check_word(s, v); break;
    case Kind::numbers: s.count == 5 ? check_theta(v) : check_list(s, v); break;
  }
  s.put(configuration, v);
}

std::string admitted(const Setting& s) {
  const std::string range = s.limits.low < s.limits.high && std::isfinite(s.limits.low)
                                ? exact(s.limits.low) + " … " + exact(s.limits.high)
                                : "numbers";
  const std::string list = listing(s.words, [](const std::string& word) { return word; });
  switch (s.kind) {
    case Kind::flag: return "true, false";
    case Kind::word: return s.words.empty() ? "any name" : list;
    case Kind::number_or_null: return range + ", or null";
    case Kind::numbers: return s.count > 0 ? std::to_string(s.count) + " numbers" : "list, each " + range;
    default: return range;
  }
}

Json typed_value(const Setting& s, const std::string& typed) {
  const auto number_or_text = [](std::string_view field) {
    const auto value = parse_number(field);
    return value ? Json(*value) : Json(std::string(field));
  };
  switch (s.kind) {
    case Kind::number_or_null:
      if (typed == "null") return nullptr;
      [[fallthrough]];
    case Kind::number: return number_or_text(typed);
    case Kind::whole: {
      int value = 0;
      const auto [end, error] = std::from_chars(typed.data(), typed.data() + typed.size(), value);
      return error == std::errc{} && end == typed.data() + typed.size() ? Json(value) : Json(typed);
    }
    case Kind::flag: return typed == "true" || typed == "false" ? Json(typed == "true") : Json(typed);
    case Kind::numbers: {
      Json list = Json::array();
      for (const std::string_view field : split(typed)) list.push_back(number_or_text(field));
      return list;
    }
    default: return typed;
  }
}

std::string nearest(const std::string& word, const std::vector<std::string>& known) {
  const auto distance = [&word](const std::string& other) {  // Levenshtein's
    std::vector<std::size_t> row(other.size() + 1);
    for (std::size_t j = 0; j < row.size(); ++j) row[j] = j;
    for (std::size_t i = 0; i < word.size(); ++i) {
      std::size_t diagonal = std::exchange(row[0], i + 1);
      for (std::size_t j = 0; j < other.size(); ++j)
        diagonal = std::exchange(
            row[j + 1], std::min({row[j] + 1, row[j + 1] + 1, diagonal + (word[i] == other[j] ? 0u : 1u)}));
    }
    return row.back();
  };
  return *std::min_element(known.begin(), known.end(),
      [&](const std::string& a, const std::string& b) { return distance(a) < distance(b); });
}

}  // namespace lumo::program
