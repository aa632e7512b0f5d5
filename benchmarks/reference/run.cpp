// Reference solutions of presses against lumo's default: `lumo_reference run …` fills a table of results,
// `lumo_reference table` compares. Rows that the file already holds are skipped, so a run can be stopped and taken up
// again.

#include "lumo/core/stopwatch.hpp"
#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/objective/contact_progression.hpp"
#include "lumo/support/mixed_cholesky.hpp"
#include "lumo/support/tetgen.hpp"
#include "taylor_hood.hpp"

#include <cstdio>
#include <fstream>
#include <iostream>
#include <map>
#include <optional>
#include <set>
#include <sstream>
#include <string>

namespace {

using namespace lumo;

const std::vector<double> loads = {1.0, 2.0, 5.0, 10.0, 15.0};
constexpr std::size_t loads_n = 5;

/// What is pressed.
struct Kind {
  FingerOptions options;
  std::vector<FingerDesign> designs;
};

Kind kind_of(const std::string& finger) {
  if (finger == "built") {
    std::vector<FingerDesign> all = built_references();
    all.push_back(built_baseline());
    all.push_back({8.0, 8.0, 7.0, 9.0, 3.0});  // the first gives way under the 10 mm sphere before 15 N
    return {built_finger(), all};
  }
  std::vector<FingerDesign> all = plain_references();
  all.push_back({10.0, 8.0, 4.5, 4.0, 7.5});  // a wall of 5 mm beside wide voids
  return {plain_finger(), all};
}

struct Case {
  FingerOptions options;
  FingerDesign design;
  double d_mm, alpha_deg, y_mm;

  Scenario<Sphere> scenario() const { return {Sphere{d_mm * 1e-3}, alpha_deg * pi / 180, y_mm * 1e-3, loads}; }
  Symmetry planes() const { return {alpha_deg == 0.0, y_mm == 0.0 && options.pad.cap_length == 0.0}; }
  Body body(const FingerOptions::Mesh& mesh) const {
    FingerOptions o = options;
    o.mesh = mesh;
    return finger(design, dragon_skin(), o);
  }
  std::string key() const {
    std::ostringstream s;
    s << design.h_fp << ',' << design.h_ep << ',' << design.w_s << ',' << design.h_s << ',' << design.w_v << ',' << d_mm
      << ',' << alpha_deg << ',' << y_mm;
    return s.str();
  }
};

using PerLoad = std::array<double, loads_n>;

/// One solution of one case; lengths in mm, areas in mm².
struct Row {
  std::string level;  ///< "lumo", or the reference's mesh size
  std::string status;
  double nodes = 0, factors = 0, seconds = 0;
  PerLoad depth{}, area{}, area0{}, area_fit{};
  double iou = 0, iou_fit = 0;

  double kappa_early() const { return 1.0 / (depth[1] - depth[0]); }
  double kappa_late() const { return 5.0 / (depth[3] - depth[2]); }
  double form(double d_mm) const { return std::min(1.0, std::sqrt(area[1] / (0.25 * pi * d_mm * d_mm))); }
  double stiff() const { return std::clamp(1.0 - kappa_early() / kappa_late(), 0.0, 1.0); }
  double score(double d_mm) const { return std::cbrt(form(d_mm) * iou * stiff()); }
};

constexpr const char* header =
    "h_fp_mm,h_ep_mm,w_s_mm,h_s_mm,w_v_mm,d_mm,alpha_deg,y_mm,level,status,nodes,factors,seconds,"
    "depth1_mm,depth2_mm,depth5_mm,depth10_mm,depth15_mm,area1_mm2,area2_mm2,area5_mm2,area10_mm2,area15_mm2,"
    "area0_1_mm2,area0_2_mm2,area0_5_mm2,area0_10_mm2,area0_15_mm2,areafit1_mm2,areafit2_mm2,areafit5_mm2,areafit10_"
    "mm2,areafit15_mm2,"
    "iou,iou_fit,kappa_early_N_per_mm,kappa_late_N_per_mm,q_form,q_stiff,J";

void write(std::ostream& out, const Case& c, const Row& r) {
  out << c.key() << ',' << r.level << ',' << r.status << ',' << r.nodes << ',' << r.factors;
  char text[32];
  const auto put = [&](double v, const char* format = ",%.6g") {
    out << (std::snprintf(text, sizeof text, format, v), text);
  };
  put(r.seconds, ",%.1f");
  for (const PerLoad* list : {&r.depth, &r.area, &r.area0, &r.area_fit})
    for (double v : *list) put(v);
  for (double v : {r.iou, r.iou_fit, r.kappa_early(), r.kappa_late(), r.form(c.d_mm), r.stiff(), r.score(c.d_mm)})
    put(v);
  out << '\n';
}

/// Rows of a file, by case and level.
std::map<std::string, std::map<std::string, Row>> read(const std::string& file) {
  std::map<std::string, std::map<std::string, Row>> all;
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line)) {
    std::vector<std::string> cell;
    std::istringstream cells(line);
    for (std::string c; std::getline(cells, c, ',');) cell.push_back(c);
    if (cell.size() < 35) continue;
    std::string key = cell[0];
    for (std::size_t k = 1; k < 8; ++k) key += ',' + cell[k];
    Row r;
    r.level = cell[8];
    r.status = cell[9];
    const auto number = [&](std::size_t k) { return std::stod(cell[k]); };
    r.nodes = number(10);
    r.factors = number(11);
    r.seconds = number(12);
    std::size_t at = 13;
    for (PerLoad* list : {&r.depth, &r.area, &r.area0, &r.area_fit})
      for (double& v : *list) v = number(at++);
    r.iou = number(at++);
    r.iou_fit = number(at);
    all[key][r.level] = r;
  }
  return all;
}

/// Mesh sizes of lumo's own solution, from a level's name: `lumo` is the default,
/// `lumo:finest:growth:depth_growth:contact_edge:coarsest:base_growth` (edges in mm) anything else; what is left out
/// keeps its default.
std::pair<FingerOptions::Mesh, Focus> sizes_of(const std::string& level) {
  FingerOptions::Mesh mesh;
  Focus f;
  std::istringstream in(level);
  std::string part;
  std::getline(in, part, ':');
  const std::array<std::pair<double*, double>, 6> fields = {{{&f.finest, 1e-3}, {&f.growth, 1.0},
      {&f.depth_growth, 1.0}, {&mesh.contact_edge, 1e-3}, {&mesh.coarsest_edge, 1e-3}, {&mesh.growth, 1.0}}};
  for (const auto& [field, unit] : fields)
    if (std::getline(in, part, ':')) *field = unit * std::stod(part);
  return {mesh, f};
}

Row own_solution(const Case& c, const std::string& level, const TetgenMesher& mesher) {
  Row row;
  row.level = level;
  const auto [sizes, focus] = sizes_of(level);
  const Body body = c.body(sizes);
  std::vector<Scenario<Sphere>> place;  // what shares a mesh in a campaign
  for (double d : {10e-3, 15e-3, 20e-3, 30e-3})
    place.push_back({Sphere{d}, c.scenario().angle_rad, c.scenario().y_m, loads});
  const TetMesh mesh = mesh_for_contact(body, mesh_body(body, mesher), place, mesher, focus);
  const Stopwatch clock;
  const Silicone card = dragon_skin();
  const Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<MixedCholesky>> simulator{
      NeoHookean{card.mu_Pa, card.lambda_Pa}};
  const auto states = simulator.press(body, mesh, c.scenario());
  row.seconds = clock.seconds();
  row.nodes = double(mesh.nodes.size());
  row.status = std::string(to_string(states.back().status));
  for (std::size_t k = 0; k < states.size(); ++k) {
    row.depth[k] = 1e3 * states[k].depth_m;
    row.area[k] = 1e6 * states[k].contact_area_m2;
    row.area0[k] = 1e6 * states[k].reference_area_m2;
    row.factors += states[k].iterations;
  }
  const ContactSurface surface(mesh, body, [](const Patch& p) { return p.contactable; });
  if (states.size() == loads_n)
    row.iou = contact_overlap(surface, states[1].contact_field, states[3].contact_field, positions_of(mesh)).ratio();
  return row;
}

/// Contact area without an edge fit: the area where the gap is below ε, for some ε, continued to ε = 0 in powers of
/// ε^(2/3).
std::array<double, 2> areas_by_gap(
    const Body& body, const TetMesh& mesh, const Positions& x, const Sphere& sphere, const Vec3d& origin) {
  constexpr int n = 16, levels = 6;
  const std::array<double, levels> level = {8e-6, 12e-6, 18e-6, 26e-6, 36e-6, 48e-6};
  std::array<std::array<double, levels>, 2> sum{};
  for (const BoundaryFace& f : mesh.faces) {
    if (!body.patches[std::size_t(f.patch)].contactable) continue;
    const Vec3d middle = (x.col(f.nodes[0]) + x.col(f.nodes[1]) + x.col(f.nodes[2])) / 3.0;
    if (sphere.distance(middle - origin) > 2.0 * (x.col(f.nodes[0]) - x.col(f.nodes[1])).norm() + 1e-3) continue;
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j) {
        double u = (i + 1.0 / 3.0) / n, v = (j + 1.0 / 3.0) / n;
        if (i + j >= n) {
          u = 1.0 - u;
          v = 1.0 - v;
        }
        const auto shape = face_shape(u, v, 2);
        const auto slope = face_shape_derivatives(u, v, 2);
        Vec3d at = Vec3d::Zero(), by_u = at, by_v = at, by_u0 = at, by_v0 = at;
        for (std::size_t a = 0; a < 6; ++a) {
          at += shape[a] * x.col(f.nodes[a]);
          by_u += slope[a][0] * x.col(f.nodes[a]);
          by_v += slope[a][1] * x.col(f.nodes[a]);
          by_u0 += slope[a][0] * mesh.nodes[std::size_t(f.nodes[a])];
          by_v0 += slope[a][1] * mesh.nodes[std::size_t(f.nodes[a])];
        }
        const double gap = sphere.distance(at - origin);
        for (std::size_t k = 0; k < levels; ++k)
          if (gap < level[k]) {
            sum[0][k] += 0.5 / (n * n) * by_u.cross(by_v).norm();
            sum[1][k] += 0.5 / (n * n) * by_u0.cross(by_v0).norm();
          }
      }
  }
  Eigen::Matrix<double, levels, 3> A;
  Eigen::Matrix<double, levels, 2> b;
  for (int k = 0; k < levels; ++k) {
    const double t = std::cbrt(level[std::size_t(k)] * level[std::size_t(k)]) * 1e3;
    A.row(k) << 1.0, t, t * t;
    b.row(k) << sum[0][std::size_t(k)], sum[1][std::size_t(k)];
  }
  const Eigen::Matrix<double, 3, 2> fit = A.colPivHouseholderQr().solve(b);
  return {fit(0, 0), fit(0, 1)};
}

/// The body with the half beyond its symmetry plane `axis` spelled out, so that a mesh can be fine on one side only.
Body spelled_out(Body b, int axis) {
  const auto reflect = [&](Vec3d p) {
    p[axis] = -p[axis];
    return p;
  };
  const std::size_t patches = b.patches.size(), vertices = b.vertices.size();
  for (std::size_t k = 0; k < patches; ++k) {
    Patch p = b.patches[k];
    std::visit(
        [&](auto& shape) {
          if constexpr (requires { shape.direction; }) {
            shape.point = reflect(shape.point);
            shape.direction = reflect(shape.direction);
          } else if constexpr (requires { shape.center; }) {
            shape.center = reflect(shape.center);
          } else {
            throw InvalidArgument("a shape of one's own has no mirror image");
          }
        },
        p.shape);
    b.patches.push_back(p);
  }
  std::vector<int> image;
  for (std::size_t k = 0; k < vertices; ++k) {
    const bool shared = b.vertices[k][axis] == 0.0;
    image.push_back(shared ? int(k) : int(b.vertices.size()));
    if (!shared) b.vertices.push_back(reflect(b.vertices[k]));
  }
  std::vector<Facet> facets;
  for (const Facet& f : b.facets) {
    if (std::all_of(f.loop.begin(), f.loop.end(), [&](int v) { return b.vertices[std::size_t(v)][axis] == 0.0; }))
      continue;
    facets.push_back(f);
    Facet other{{}, f.patch == Body::mirror_patch ? f.patch : f.patch + int(patches)};
    for (auto v = f.loop.rbegin(); v != f.loop.rend(); ++v) other.loop.push_back(image[std::size_t(*v)]);
    facets.push_back(other);
  }
  b.facets = facets;
  (axis == 0 ? b.symmetry.x : b.symmetry.y) = false;
  return b;
}

/// The reference's mesh of size 1; other sizes multiply every length and growth of it.
const FingerOptions::Mesh base_mesh = {.contact_edge = 3e-3,
    .coarsest_edge = 8e-3,
    .growth = 0.9,
    .stretch_y = 1.0,
    .max_turn_rad = 0.6,
    .shortest_chord = 0.0};
const Focus base_focus = {.finest = 0.3e-3, .growth = 0.12, .depth_growth = 1.0};

/// The reference on a mesh of the given size.
Row reference_solution(const Case& c, double size, const std::string& level, const TetgenMesher& mesher) {
  Row row;
  row.level = level;
  const Body coarse = c.body({});
  const Scenario<Sphere> scenario = c.scenario();
  const Touch touch = first_touch(coarse, mesh_body(coarse, mesher), scenario);
  Body whole = c.body(base_mesh.scaled(size));
  if (!c.planes().x) whole = spelled_out(whole, 0);
  if (!c.planes().y && whole.symmetry.y) whole = spelled_out(whole, 1);
  const Body body = focused(whole, {touch.point}, base_focus.scaled(size));
  const TetMesh mesh = mesh_body(body, mesher);
  const Stopwatch clock;
  const Sector sector = sector_of(mesh, c.planes());
  const Silicone card = dragon_skin();
  reference::TaylorHood solver(body, sector.mesh, c.planes(), {card.mu_Pa, card.lambda_Pa});
  const auto states = solver.press(scenario.indenter, touch.origin, scenario.direction(), loads, sector.fraction());
  row.seconds = clock.seconds();
  row.nodes = double(mesh.nodes.size());
  row.status = "converged";
  const ContactSurface surface(mesh, body, [](const Patch& p) { return p.contactable; });
  std::vector<ContactField> fields;
  std::vector<double> reference_fit;
  for (std::size_t k = 0; k < states.size(); ++k) {
    const auto& s = states[k];
    row.factors += s.factors;
    if (!s.converged) row.status = "failed";
    else if (!s.stable && row.status == "converged") row.status = "unstable";
    const std::vector<Vec3d> u = unfold(mesh, sector, s.displacement);
    Positions x = positions_of(mesh);
    for (std::size_t n = 0; n < u.size(); ++n) x.col(Eigen::Index(n)) += u[n];
    const Vec3d origin = touch.origin + s.depth_m * scenario.direction();
    fields.push_back(contact_field(
        mesh, surface, SDFContact{}, Moving<Sphere>{&scenario.indenter, origin, scenario.direction()}, x));
    row.depth[k] = 1e3 * s.depth_m;
    row.area[k] = 1e6 * contact_area(surface, fields[k].field, x);
    row.area0[k] = 1e6 * contact_area(surface, fields[k].field, positions_of(mesh));
    const auto fit = areas_by_gap(body, mesh, x, scenario.indenter, origin);
    row.area_fit[k] = 1e6 * fit[0];
    reference_fit.push_back(fit[1]);
  }
  if (states.size() == loads_n) {
    row.iou = contact_overlap(surface, fields[1].field, fields[3].field, positions_of(mesh)).ratio();
    row.iou_fit = reference_fit[1] / reference_fit[3];  // sets are nested
  }
  return row;
}

/// A value extrapolated to mesh size zero, with its uncertainty.
struct Extrapolated {
  double value = 0, error = 0;
};

/// Richardson's extrapolation with the order that three sizes show, 1.5 … 3, and Roache's safety factor 1.25; the
/// finest value and the spread where they show none, or where the quantity scatters from mesh to mesh (areas) more than
/// it converges.
Extrapolated extrapolate(const std::vector<std::pair<double, double>>& by_size, bool smooth) {
  if (by_size.empty()) return {};
  const auto& fine = by_size.back();
  if (by_size.size() == 1) return {fine.second, std::numeric_limits<double>::infinity()};
  const auto& middle = by_size[by_size.size() - 2];
  const double last = fine.second - middle.second;
  if (by_size.size() == 2) return {fine.second, std::abs(last)};
  const auto& coarse = by_size[by_size.size() - 3];
  const double before = middle.second - coarse.second;
  if (!smooth) return {fine.second, std::max(std::abs(last), 0.25 * std::abs(before))};
  if (last * before <= 0.0 || std::abs(last) >= std::abs(before))
    return {fine.second, std::max(std::abs(last), 0.5 * std::abs(before))};
  const auto ratio = [&](double p) {
    return (std::pow(coarse.first, p) - std::pow(middle.first, p)) /
           (std::pow(middle.first, p) - std::pow(fine.first, p));
  };
  double low = 1.5, high = 3.0;
  for (int k = 0; k < 60; ++k) (ratio(0.5 * (low + high)) < before / last ? low : high) = 0.5 * (low + high);
  const double step = last / (std::pow(middle.first / fine.first, low) - 1.0);
  return {fine.second + step, 1.25 * std::abs(step)};
}

struct Quantity {
  std::string name;
  bool relative, smooth;
  double limit;
  std::function<double(const Row&, double d_mm)> of;
};

std::vector<Quantity> quantities() {
  std::vector<Quantity> q;
  const std::array<const char*, loads_n> name = {"1", "2", "5", "10", "15"};
  for (std::size_t k = 0; k < loads_n; ++k)
    q.push_back({std::string("depth ") + name[k] + " N [mm]", true, true, 0.01,
        [k](const Row& r, double) { return r.depth[k]; }});
  q.push_back({"kappa early [N/mm]", true, true, 0.02, [](const Row& r, double) { return r.kappa_early(); }});
  q.push_back({"kappa late [N/mm]", true, true, 0.02, [](const Row& r, double) { return r.kappa_late(); }});
  for (std::size_t k = 1; k < loads_n; ++k)
    q.push_back(
        {std::string("A ") + name[k] + " N [mm2]", true, false, 0.03, [k](const Row& r, double) { return r.area[k]; }});
  for (std::size_t k = 1; k < loads_n; ++k)
    q.push_back({std::string("A0 ") + name[k] + " N [mm2]", true, false, 0.03,
        [k](const Row& r, double) { return r.area0[k]; }});
  q.push_back({"q_stable (IoU)", false, false, 0.02, [](const Row& r, double) { return r.iou; }});
  q.push_back({"q_form", false, false, 0.01, [](const Row& r, double d) { return r.form(d); }});
  q.push_back({"q_stiff", false, true, 0.01, [](const Row& r, double) { return r.stiff(); }});
  q.push_back({"J", false, false, 0.01, [](const Row& r, double d) { return r.score(d); }});
  return q;
}

using Rows = std::map<std::string, Row>;             // of one case, by level
using Levels = std::vector<std::pair<double, Row>>;  // the reference's, by size, coarsest first

Levels reference_levels(const Rows& rows) {
  Levels levels;
  for (const auto& [level, row] : rows)
    if (!level.starts_with("lumo") && row.status == "converged") levels.emplace_back(std::stod(level), row);
  std::sort(levels.begin(), levels.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
  return levels;
}

/// The numbers of a case's key: five lengths, diameter, angle, place.
std::vector<double> numbers_of(const std::string& key) {
  std::istringstream cells(key);
  std::vector<double> number;
  for (std::string cell; std::getline(cells, cell, ',');) number.push_back(std::stod(cell));
  return number;
}

/// `v` as std::printf would write it.
std::string written(const char* format, double v) {
  char text[64];
  std::snprintf(text, sizeof text, format, v);
  return text;
}

/// Deviations of lumo's solution from the extrapolated reference: per quantity, over all cases.
struct Deviations {
  std::vector<Quantity> list = quantities();
  std::vector<std::vector<double>> deviation = std::vector<std::vector<double>>(list.size()), noise = deviation;
  std::vector<std::string> worst = std::vector<std::string>(list.size());
  double fit_area = 0, fit_iou = 0;

  void add(const std::string& key, const Row& own, const Levels& levels, std::ostream& out);
  void add_quantity(std::size_t q, const std::string& key, const Row& own, const Levels& levels, std::ostream& out);
  void write_summary(std::ostream& out) const;
};

/// One row of a case's table.
void Deviations::add_quantity(
    std::size_t q, const std::string& key, const Row& own, const Levels& levels, std::ostream& out) {
  const double d = numbers_of(key)[5];
  std::vector<std::pair<double, double>> by_size;
  out << "| " << list[q].name << " |";
  for (const auto& l : levels) {
    by_size.emplace_back(l.first, list[q].of(l.second, d));
    out << written(" %.4f |", by_size.back().second);
  }
  const Extrapolated e = extrapolate(by_size, list[q].smooth);
  const double mine = list[q].of(own, d), scale = list[q].relative ? e.value : 1.0;
  const double off = (mine - e.value) / scale;
  out << written(" %.4f |", e.value) << written(" %.4f |", e.error) << written(" %.4f |", mine)
      << (list[q].relative ? written(" %+.2f %% |\n", 100.0 * off) : written(" %+.4f |\n", off));
  if (deviation[q].empty() || std::abs(off) > *std::max_element(deviation[q].begin(), deviation[q].end()))
    worst[q] = key;
  deviation[q].push_back(std::abs(off));
  noise[q].push_back(std::abs(e.error / scale));
}

/// A case's table.
void Deviations::add(const std::string& key, const Row& own, const Levels& levels, std::ostream& out) {
  const std::vector<double> number = numbers_of(key);
  out << "\n### [" << number[0] << ", " << number[1] << ", " << number[2] << ", " << number[3] << ", " << number[4]
      << "], d = " << number[5] << " mm, alpha = " << number[6] << " deg, y = " << number[7] << " mm\n\n| quantity |";
  for (const auto& l : levels)
    out << " size " << l.first << " (" << l.second.nodes << " nodes, " << l.second.seconds << " s) |";
  out << " extrapolated | ± | lumo (" << own.nodes << " nodes, " << own.seconds << " s) | difference |\n|---|";
  for (std::size_t k = 0; k < levels.size() + 4; ++k) out << "---|";
  out << '\n';
  for (std::size_t q = 0; q < list.size(); ++q) add_quantity(q, key, own, levels, out);
  const Row& finest = levels.back().second;
  for (std::size_t k = 1; k < loads_n; ++k)
    fit_area = std::max(fit_area, std::abs(finest.area_fit[k] / finest.area[k] - 1.0));
  fit_iou = std::max(fit_iou, std::abs(finest.iou_fit - finest.iou));
}

void Deviations::write_summary(std::ostream& out) const {
  for (std::size_t q = 0; q < list.size(); ++q) {
    if (deviation[q].empty()) continue;
    auto v = deviation[q], n = noise[q];
    std::sort(v.begin(), v.end());
    std::sort(n.begin(), n.end());
    double square = 0;
    std::size_t beyond = 0;
    for (double x : v) {
      square += x * x;
      beyond += x > list[q].limit;
    }
    const auto shown = [&](double x) { return list[q].relative ? written("%.2f %%", 100.0 * x) : written("%.4f", x); };
    out << "| " << list[q].name << " | " << v.size() << " | " << shown(v.back()) << " | " << shown(v[v.size() / 2])
        << " | " << shown(std::sqrt(square / double(v.size()))) << " | " << shown(list[q].limit) << " | " << beyond
        << " | " << shown(n[n.size() / 2]) << " | " << worst[q] << " |\n";
  }
}

void write_introduction(const std::string& compared, bool built, std::ostream& out) {
  const std::string name = built ? "built" : "results", finger = built ? " --finger built" : "";
  out << "# `" << compared << "` against the extrapolated Taylor–Hood reference" << (built ? ", built finger" : "")
      << "\n\n"
         "Presses at the default setting beside equilibria of another formulation: quadratic displacement and "
         "continuous linear pressure (Taylor–Hood, inf-sup stable),\n"
         "with an element, contact assembly, factorisation and Newton loop of its own (`taylor_hood.hpp`), on two to "
         "four meshes of its own: `size` multiplies every\n"
         "length and growth. What it shares with lumo is the finger's shape, the mesher and the evaluation of areas. "
         "Smooth quantities are extrapolated (Richardson, with\n"
         "the order that three sizes show; with two, the finer one counts); areas scatter from mesh to mesh, so that "
         "their reference is the finest "
         "mesh and ± the last change. *Beyond limit* counts\n"
         "cases in which the difference alone exceeds the limit; where it is less than the reference's own ± it says "
         "nothing of lumo. Silicone: Dragon Skin.\n\n"
         "```\nlumo_reference run"
      << finger << " --csv benchmarks/reference/" << name << ".csv      # goes on where it was stopped; hours\n"
      << "lumo_reference table" << finger << " --csv benchmarks/reference/" << name
      << ".csv --markdown benchmarks/reference/" << name
      << ".md\n```\n\n"
         "| quantity | cases | largest | median | root mean square | limit | "
         "beyond limit | reference ± (median) | worst case |\n"
         "|---|---|---|---|---|---|---|---|---|\n";
}

/// Markdown: deviations of lumo's solution `compared` from the extrapolated reference, per case and in summary.
void table(const std::string& file, const std::string& compared, bool built, std::ostream& out) {
  Deviations deviations;
  std::ostringstream cases;
  for (const auto& [key, rows] : read(file)) {
    const auto own = rows.find(compared);
    const Levels levels = reference_levels(rows);
    if (own == rows.end() || own->second.status != "converged" || levels.size() < 2) continue;
    deviations.add(key, own->second, levels, cases);
  }
  write_introduction(compared, built, out);
  deviations.write_summary(out);
  out << "\nAreas measured from gap levels instead of the edge fit, finest reference: at most "
      << 100 * deviations.fit_area << " % from them; IoU " << deviations.fit_iou << ".\n";
  out << cases.str();
}

std::vector<std::string> split(const std::string& text) {
  std::vector<std::string> parts;
  std::istringstream in(text);
  for (std::string p; std::getline(in, p, ',');) parts.push_back(p);
  return parts;
}

}  // namespace

int main(int argc, char** argv) {
  std::map<std::string, std::string> option = {{"--csv", "results.csv"}, {"--designs", "0,1,2,3,4,5"}, {"--d", "10,30"},
      {"--alpha", "0,30"}, {"--y", "0,22"}, {"--levels", "lumo,1,0.7,0.5"}, {"--markdown", ""}, {"--compared", "lumo"},
      {"--finger", "plain"}};
  const std::string command = argc > 1 ? argv[1] : "";
  for (int k = 2; k + 1 < argc; k += 2) {
    if (!option.contains(argv[k])) {
      std::cerr << "unknown option " << argv[k] << '\n';
      return 2;
    }
    option[argv[k]] = argv[k + 1];
  }
  if (command == "table") {
    const bool built = option["--finger"] == "built";
    if (option["--markdown"].empty()) table(option["--csv"], option["--compared"], built, std::cout);
    else {
      std::ofstream out(option["--markdown"]);
      table(option["--csv"], option["--compared"], built, out);
    }
    return 0;
  }
  if (command != "run") {
    std::cerr << "usage: lumo_reference run|table [--csv FILE] [--designs 0,1,…] [--d 10,30] [--alpha 0,30] [--y 0,22] "
                 "[--levels lumo,1,0.7,0.5] [--markdown FILE] [--compared lumo] [--finger plain|built]\n";
    return 2;
  }
  const Kind kind = kind_of(option["--finger"]);
  TetgenMesher mesher;
  mesher.time_limit_s = 600.0;
  const auto known = read(option["--csv"]);
  if (!std::ifstream(option["--csv"]).good()) std::ofstream(option["--csv"]) << header << '\n';
  for (const std::string& alpha : split(option["--alpha"]))
    for (const std::string& y : split(option["--y"]))
      for (const std::string& level : split(option["--levels"]))
        for (const std::string& design : split(option["--designs"]))
          for (const std::string& d : split(option["--d"])) {
            const Case c{
                kind.options, kind.designs.at(std::stoul(design)), std::stod(d), std::stod(alpha), std::stod(y)};
            if (const auto found = known.find(c.key()); found != known.end() && found->second.contains(level)) continue;
            Row row;
            try {
              row = level.starts_with("lumo") ? own_solution(c, level, mesher)
                                              : reference_solution(c, std::stod(level), level, mesher);
            } catch (const Error& e) {
              std::cerr << c.key() << ' ' << level << ": " << e.what() << '\n';
              continue;
            }
            std::ofstream out(option["--csv"], std::ios::app);
            write(out, c, row);
            write(std::cout, c, row);
            std::cout.flush();
          }
}
