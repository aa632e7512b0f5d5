#pragma once

// Everything of lumo that needs nothing but Eigen, in the order in which data flows. Foreign libraries enter through lumo/support/.

#include "lumo/core/design_space.hpp"
#include "lumo/core/error.hpp"
#include "lumo/core/executor.hpp"
#include "lumo/core/units.hpp"

#include "lumo/morphology/design.hpp"
#include "lumo/morphology/section.hpp"
#include "lumo/morphology/silicone.hpp"
#include "lumo/morphology/finger.hpp"

#include "lumo/mesh/body_mesh.hpp"
#include "lumo/mesh/quality.hpp"
#include "lumo/mesh/sizing.hpp"
#include "lumo/mesh/vtu.hpp"

#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"

#include "lumo/optics/tracer.hpp"

#include "lumo/objective/contact_progression.hpp"
#include "lumo/objective/optical_separation.hpp"

#include "lumo/optimize/optimizer.hpp"
#include "lumo/optimize/qlog_nehvi.hpp"

#include "lumo/campaign/evaluate.hpp"
#include "lumo/campaign/finger_campaign.hpp"
#include "lumo/campaign/choice_stability.hpp"
#include "lumo/campaign/matched_study.hpp"
#include "lumo/campaign/paired_differences.hpp"
