#include "options/groups.hpp"

#include "lumo/pipeline/lighting.hpp"

#include <algorithm>
#include <limits>
#include <thread>

namespace lumo::program {

namespace {

constexpr int most_threads = 1024;

}  // namespace

int all_threads() { return std::clamp(int(std::thread::hardware_concurrency()), 1, most_threads); }

void add_theta(CLI::App& app, Effective& e) {
  add_setting(app, e, "--theta", "theta_mm", "Design h_fp,h_ep,w_s,h_s,w_v [mm], default " + joined(e->pad.theta_mm));
}

void add_material(CLI::App& app, Effective& e, const char* help) {
  add_value(app, "--material", "NAME", help, [&e](const std::string& typed) {
    e.type("--material", "silicone.name", one_of("--material", typed, {"DS", "Sol"}));
  });
}

void add_pad(CLI::App& app, Effective& e) {
  add_theta(app, e);
  add_material(app, e);
}

void add_threads(CLI::App& app, int& threads) {
  add_whole(app, "--threads", threads, 1, most_threads, "Threads, 1 to 1024, default: all");
}

void add_seed(CLI::App& app, int& seed, const char* help) {
  add_whole(app, "--seed", seed, 0, std::numeric_limits<int>::max(), help);
}

void add_approach(CLI::App& app, Effective& e) {
  add_setting(app, e, "--diameter", "contact.diameter_mm", "Sphere's diameter [mm], default 10");
  add_setting(app, e, "--angle", "contact.angle_deg", "Approach angle from the pad normal [deg], default 0");
  add_setting(app, e, "--x", "contact.x_mm", "Place across the finger [mm], default 0");
  add_setting(app, e, "--y", "contact.y_mm", "Place along the finger [mm], default 0");
}

void add_touch(CLI::App& app, Effective& e) {
  add_approach(app, e);
  add_setting(app, e, "--loads", "contact.loads_N", "Increasing loads [N], default 1,2,5,10,15");
}

void add_ensemble(CLI::App& app, Effective& e) {
  add_setting(app, e, "--ensemble", "ensemble.name",
      "Contacts: flat (0°, default) or curved (−30° … 30°); flat-authors or curved-authors, as their code has them");
}

void add_ray_error(CLI::App& app, Effective& e) {
  add_setting(app, e, "--ray-error", "light.ray_error_percent",
      lumo::message("Standard error of J_obs up to which rays are added [%], default ", e->light.ray_error_percent,
          "; at most in ", e->light.rounds, " rounds"));
}

void add_time_limit(CLI::App& app, Effective& e, const char* standard) {
  add_setting(app, e, "--time-limit", "limits.scenario_time_s",
      std::string("Of each scenario's press, by the clock [s]; null: none. Default ") + standard);
}

void add_mode(CLI::App& app, Effective& e) {
  add_setting(app, e, "--mode", "mechanics.mode",
      "default, or paper: 1 mm linear tetrahedra, vertex block descent in time, Newton's law, friction; held states "
      "are scored. "
      "A press of five loads takes about 1.5 min of one processor");
}

void add_contact(CLI::App& app, Effective& e) {
  add_setting(app, e, "--law", "mechanics.law",
      "Neo-Hookean law: neo_hookean (default) or newton (Newton's, without a logarithm)");
  add_setting(app, e, "--contact-stiffness", "mechanics.contact_stiffness_N_per_m3",
      "Of the contact penalty [N/m3], default 1e11");
  add_setting(app, e, "--contact-points", "mechanics.contact_points",
      "Contact all over the surface (default) or at each vertex");
  add_setting(
      app, e, "--friction", "mechanics.friction", "Coulomb's coefficient of contact, default 0, in paper mode 0.5");
}

void add_mechanics(CLI::App& app, Effective& e) {
  add_mode(app, e);
  add_setting(app, e, "--solver", "mechanics.solver",
      "quasi_static (default) or vbd: vertex block descent, 5 mm/s to each load, and a hold");
  add_setting(app, e, "--element", "mechanics.element", "Tetrahedra: quadratic (default) or linear, which lock");
  add_setting(app, e, "--size", "mechanics.edge_mm",
      "Of all edges [mm], default: graded, fine at the contact; in paper mode 1");
  add_value(app, "--sweeps", "N", "Of vbd, per 0.01 s step, default 10", [&e](const std::string& typed) {
    e.type("--sweeps", "mechanics.sweeps", typed);
    if (!e->mechanics.holds()) throw UsageError("--sweeps is an option of --solver vbd");  // which has been read before
  });
  add_contact(app, e);
}

}  // namespace lumo::program
