#include "options/groups.hpp"

#include "lumo/mechanics/contact/scenario.hpp"
#include "lumo/morphology/design.hpp"

#include <algorithm>
#include <limits>
#include <thread>

namespace lumo::program {

namespace {

constexpr int most_threads = 1024;

/// Not a number and infinity are read: they are values, and whether a value is feasible is the design space's to say.
std::array<double, 5> read_theta(const std::string& typed) {
  const auto fields = split(typed);
  const auto refuse = [&](const std::string& why) {
    throw UsageError(
        "--theta is " + in_quotes(typed) + " (" + why + "), must be five numbers h_fp,h_ep,w_s,h_s,w_v [mm]");
  };
  if (fields.size() != 5) refuse(lumo::message(fields.size(), fields.size() == 1 ? " field" : " fields"));
  std::array<double, 5> theta{};
  for (std::size_t i = 0; i < 5; ++i) {
    const auto value = parse_number(fields[i]);
    if (!value) refuse(in_quotes(fields[i]) + " is not a number");
    theta[i] = *value + 0.0;  // no −0
  }
  return FingerDesign::from(theta).values();  // on the lattice in every bit, where it is but for rounding
}

/// Loads, in the order in which they are met.
std::vector<double> read_loads(const std::string& typed) {
  std::vector<double> loads;
  const auto fields = split(typed);
  for (std::size_t i = 0; i < fields.size(); ++i) {
    const auto refuse = [&](const std::string& why) {
      throw UsageError(lumo::message("--loads is ", in_quotes(typed), " (field ", i + 1, " of ", fields.size(), ", ",
          in_quotes(fields[i]), ", ", why));
    };
    const Limits& admitted = loads_admitted_N;
    const auto load = parse_number(fields[i]);
    if (!load) refuse("is not a number), must be increasing loads [N]");
    if (!(*load >= admitted.low && *load <= admitted.high))
      refuse(lumo::message("is out of range), each must lie in [", admitted.low, ", ", admitted.high, "] N"));
    if (!loads.empty() && *load <= loads.back())
      refuse(lumo::message("follows ", exact(loads.back()), " N), loads must increase"));
    loads.push_back(*load);
  }
  return loads;
}

/// What --mode paper decides may be said once more, not otherwise.
template <class T> void add_decided(CLI::App& app, const std::string& flag, T Mechanics::*which, Mechanics& m,
    const std::vector<std::pair<std::string, T>>& choices, const char* help) {
  std::vector<std::string> names;
  for (const auto& choice : choices) names.push_back(choice.first);
  add_value(app, flag, "NAME", help, [=, &m](const std::string& typed) {
    const std::string chosen = one_of(flag, typed, names);
    for (const auto& [key, value] : choices) {
      if (key != chosen) continue;
      if (m.paper && value != m.*which)
        throw UsageError(lumo::message(flag, " ", typed, " contradicts --mode paper, which is ", name(m.*which)));
      m.*which = value;
    }
  });
}

}  // namespace

int all_threads() { return std::clamp(int(std::thread::hardware_concurrency()), 1, most_threads); }

void add_theta(CLI::App& app, Pad& pad) {
  add_value(app, "--theta", "N,N,N,N,N", "Design h_fp,h_ep,w_s,h_s,w_v [mm], default 6,6,8,5,0",
      [&pad](const std::string& typed) { pad.theta_mm = read_theta(typed); });
}

void add_material(CLI::App& app, std::string& material, const char* help) {
  add_word(app, "--material", material, {"DS", "Sol"}, help);
}

void add_pad(CLI::App& app, Pad& pad) {
  add_theta(app, pad);
  add_material(app, pad.material);
}

void add_threads(CLI::App& app, int& threads) {
  add_whole(app, "--threads", threads, 1, most_threads, "Threads, 1 to 1024, default: all");
}

void add_seed(CLI::App& app, int& seed, const char* help) {
  add_whole(app, "--seed", seed, 0, std::numeric_limits<int>::max(), help);
}

// The library's own limits, in the words and units of who typed the values.
void add_touch(CLI::App& app, Touch& touch) {
  add_number(app, "--diameter", touch.diameter_mm, sphere_diameters_mm, "mm", "Sphere's diameter [mm], default 10");
  add_number(app, "--angle", touch.angle_deg, approach_angles_deg, "deg",
      "Approach angle from the pad normal [deg], default 0");
  add_number(app, "--y", touch.y_mm, contact_places_mm, "mm", "Place along the finger [mm], default 0");
  add_value(app, "--loads", "N,N,...", "Increasing loads [N], default 1,2,5,10,15",
      [&touch](const std::string& typed) { touch.loads_N = read_loads(typed); });
}

void add_ensemble(CLI::App& app, Ensemble& ensemble) {
  add_choice<Ensemble>(app, "--ensemble", ensemble, {{"flat", Ensemble::flat}, {"curved", Ensemble::curved}},
      "Approach angles: flat (0°, default) or curved (−30° … 30°)");
}

void add_ray_error(CLI::App& app, double& percent) {
  add_number(app, "--ray-error", percent, {0.1, 100.0}, "%",
      lumo::message("Standard error of J_obs up to which rays are added [%], default ", percent, "; at most ",
          rays_up_to(RayRefinement{}.rounds), " times the first ones"));
}

void add_mode(CLI::App& app, Mechanics& m) {
  const char* const help =
      "default, or paper: 1 mm linear tetrahedra, vertex block descent in time, Newton's law, friction; held states "
      "are scored. "
      "A press of five loads takes about 1.5 min of one processor";
  add_value(app, "--mode", "NAME", help, [&m](const std::string& typed) {
    m = one_of("--mode", typed, {"default", "paper"}) == "paper" ? paper_mechanics() : Mechanics{};
  });
}

void add_contact(CLI::App& app, Mechanics& m) {
  using enum Mechanics::Law;
  using enum Mechanics::Points;
  add_decided<Mechanics::Law>(app, "--law", &Mechanics::law, m, {{"neo_hookean", neo_hookean}, {"newton", newton}},
      "Neo-Hookean law: neo_hookean (default) or newton (Newton's, without a logarithm)");
  add_number(app, "--contact-stiffness", m.contact_stiffness_N_per_m3, {1e6, 1e15}, "N/m3",
      "Of the contact penalty [N/m3], default 1e11");
  add_choice<Mechanics::Points>(app, "--contact-points", m.points, {{"surface", surface}, {"vertex", vertex}},
      "Contact all over the surface (default) or at each vertex");
  add_number(
      app, "--friction", m.friction, {0.0, 10.0}, "", "Coulomb's coefficient of contact, default 0, in paper mode 0.5");
}

void add_mechanics(CLI::App& app, Mechanics& m) {
  using enum Mechanics::Solver;
  using enum Mechanics::Element;
  add_mode(app, m);
  add_decided<Mechanics::Solver>(app, "--solver", &Mechanics::solver, m, {{"quasi_static", quasi_static}, {"vbd", vbd}},
      "quasi_static (default) or vbd: vertex block descent, 5 mm/s to each load, 1 s hold");
  add_decided<Mechanics::Element>(app, "--element", &Mechanics::element, m,
      {{"linear", linear}, {"quadratic", quadratic}}, "Tetrahedra: quadratic (default) or linear, which lock");
  add_number(app, "--size", m.size_mm, {0.2, 10.0}, "mm",
      "Of all edges [mm], default: graded, fine at the contact; in paper mode 1");
  add_value(app, "--sweeps", "N", "Of vbd, per 0.01 s step, default 10", [&m](const std::string& typed) {
    m.sweeps = whole_in("--sweeps", typed, 1, 1000000);
    if (!m.holds()) throw UsageError("--sweeps is an option of --solver vbd");  // which has been read before
  });
  add_contact(app, m);
}

void check_design(const Pad& pad) { finger_space().check(pad.theta_mm); }

}  // namespace lumo::program
