#pragma once

// The virtual lab: a pad, a camera, a motor and an indenter that write the same recordings as a real rig. Needs Eigen
// only.

#include "lumo/version.hpp"

#include "lumo/lab/hand_lab.hpp"
#include "lumo/lab/observe_pad.hpp"
#include "lumo/lab/pad_file.hpp"
#include "lumo/lab/pad_responses.hpp"
#include "lumo/lab/pad_templates.hpp"
#include "lumo/lab/side_view.hpp"
#include "lumo/lab/virtual_rig.hpp"
