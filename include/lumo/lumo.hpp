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
#include "lumo/mesh/surface_file.hpp"
#include "lumo/mesh/vtu.hpp"

#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/neo_hookean.hpp"
#include "lumo/mechanics/stable_neo_hookean.hpp"
#include "lumo/mechanics/mooney_rivlin.hpp"
#include "lumo/mechanics/yeoh.hpp"
#include "lumo/mechanics/ogden.hpp"
#include "lumo/mechanics/box.hpp"
#include "lumo/mechanics/capsule.hpp"
#include "lumo/mechanics/cylinder.hpp"
#include "lumo/mechanics/oriented.hpp"
#include "lumo/mechanics/mesh_indenter.hpp"
#include "lumo/mechanics/vertex_contact.hpp"
#include "lumo/mechanics/vertex_block_descent.hpp"
#include "lumo/mechanics/simulator.hpp"

#include "lumo/optics/tracer.hpp"

#include "lumo/objective/contact_progression.hpp"
#include "lumo/objective/optical_separation.hpp"

#include "lumo/optimize/optimizer.hpp"
#include "lumo/optimize/qlog_nehvi.hpp"

#include "lumo/sense/recorded_camera.hpp"
#include "lumo/sense/recorded_actuator.hpp"
#include "lumo/sense/photodiode_log.hpp"
#include "lumo/sense/led_detector.hpp"
#include "lumo/sense/segment_responses.hpp"
#include "lumo/sense/nearest_template.hpp"
#include "lumo/sense/bayes_decoder.hpp"
#include "lumo/sense/cross_validation.hpp"
#include "lumo/sense/constraint_gain.hpp"
#include "lumo/sense/peak_localizer.hpp"
#include "lumo/sense/bayes_localizer.hpp"
#include "lumo/sense/serial_chain.hpp"
#include "lumo/sense/force_estimator.hpp"
#include "lumo/sense/force_baselines.hpp"

#include "lumo/campaign/evaluate.hpp"
#include "lumo/campaign/finger_campaign.hpp"
#include "lumo/campaign/choice_stability.hpp"
#include "lumo/campaign/matched_study.hpp"
#include "lumo/campaign/paired_differences.hpp"
#include "lumo/campaign/gaussian_process_decoder.hpp"
