#pragma once

// What casts a finger: kit, drawings, files for printers. Needs Eigen only.

#include "lumo/version.hpp"

#include "lumo/fabrication/casting_drawings.hpp"
#include "lumo/fabrication/casting_kit.hpp"
#include "lumo/fabrication/drawing.hpp"
#include "lumo/fabrication/stl.hpp"
#include "lumo/fabrication/three_mf.hpp"
