#pragma once

#include "options/configured.hpp"

#include <string>

/// Options that several commands share.
namespace lumo::program {

/// All processors that there are.
int all_threads();

void add_theta(CLI::App& app, Effective& effective);
void add_material(
    CLI::App& app, Effective& effective, const char* help = "Silicone: DS (Dragon Skin, default) or Sol (Solaris)");
void add_pad(CLI::App& app, Effective& effective);
void add_threads(CLI::App& app, int& threads);
void add_seed(CLI::App& app, int& seed, const char* help);
/// Diameter, angle and place of the sphere.
void add_approach(CLI::App& app, Effective& effective);
/// And its loads.
void add_touch(CLI::App& app, Effective& effective);
void add_ensemble(CLI::App& app, Effective& effective);
void add_ray_error(CLI::App& app, Effective& effective);
void add_time_limit(CLI::App& app, Effective& effective, const char* standard = "none");

/// --mode, which decides solver, element and law.
void add_mode(CLI::App& app, Effective& effective);
/// --law, --contact-stiffness, --contact-points, --friction.
void add_contact(CLI::App& app, Effective& effective);
/// All of them, with --solver, --element, --size and --sweeps.
void add_mechanics(CLI::App& app, Effective& effective);

}  // namespace lumo::program
