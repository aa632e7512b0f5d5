#pragma once

#include "computing/request.hpp"
#include "options/options.hpp"

#include <string>

/// Options that several commands share.
namespace lumo::program {

/// All processors that there are.
int all_threads();

void add_theta(CLI::App& app, Pad& pad);
void add_material(
    CLI::App& app, std::string& material, const char* help = "Silicone: DS (Dragon Skin, default) or Sol (Solaris)");
void add_pad(CLI::App& app, Pad& pad);
void add_threads(CLI::App& app, int& threads);
void add_seed(CLI::App& app, int& seed, const char* help);
void add_touch(CLI::App& app, Touch& touch);
void add_ensemble(CLI::App& app, Ensemble& ensemble);
void add_ray_error(CLI::App& app, double& percent);

/// --mode, which decides solver, element and law.
void add_mode(CLI::App& app, Mechanics& m);
/// --law, --contact-stiffness, --contact-points, --friction.
void add_contact(CLI::App& app, Mechanics& m);
/// All of them, with --solver, --element, --size and --sweeps.
void add_mechanics(CLI::App& app, Mechanics& m);
/// Throws InfeasibleDesign.
void check_design(const Pad& pad);

}  // namespace lumo::program
