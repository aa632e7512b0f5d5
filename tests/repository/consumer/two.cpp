#include "every_header.hpp"

double volume() { return lumo::finger(lumo::baseline_design(), lumo::dragon_skin()).exact_volume_m3; }
