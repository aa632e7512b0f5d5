#include "every_header.hpp"

double volume() { return lumo::finger(lumo::built_baseline(), lumo::dragon_skin()).exact_volume_m3; }
