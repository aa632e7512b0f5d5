#pragma once

// The design chain and its optimisation, in the order in which data flows: section → mesh → contact → light →
// objectives → search. Needs Eigen only. Foreign libraries enter through lumo/support/.

#include "lumo/version.hpp"

#include "lumo/core/design_space.hpp"
#include "lumo/core/error.hpp"
#include "lumo/core/executor.hpp"
#include "lumo/core/units.hpp"

#include "lumo/geometry/surface_file.hpp"

#include "lumo/morphology/design.hpp"
#include "lumo/morphology/emitter.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/morphology/measured_lobe.hpp"
#include "lumo/morphology/profile.hpp"
#include "lumo/morphology/round_shapes.hpp"
#include "lumo/morphology/section.hpp"
#include "lumo/morphology/silicone.hpp"

#include "lumo/mesh/body_mesh.hpp"
#include "lumo/mesh/quality.hpp"
#include "lumo/mesh/size_field.hpp"
#include "lumo/mesh/surface_mesh.hpp"
#include "lumo/mesh/swept_mesher.hpp"
#include "lumo/mesh/vtu.hpp"

#include "lumo/mechanics/materials/mooney_rivlin.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/materials/ogden.hpp"
#include "lumo/mechanics/materials/stable_neo_hookean.hpp"
#include "lumo/mechanics/materials/yeoh.hpp"

#include "lumo/mechanics/indenters/box.hpp"
#include "lumo/mechanics/indenters/capsule.hpp"
#include "lumo/mechanics/indenters/cylinder.hpp"
#include "lumo/mechanics/indenters/mesh_indenter.hpp"
#include "lumo/mechanics/indenters/oriented.hpp"

#include "lumo/mechanics/contact/contact_handler.hpp"

#include "lumo/mechanics/solvers/vertex_block_descent.hpp"

#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/press_svg.hpp"
#include "lumo/mechanics/simulator.hpp"

#include "lumo/optics/camera_cone.hpp"
#include "lumo/optics/photodiode.hpp"
#include "lumo/optics/pinhole_camera.hpp"
#include "lumo/optics/scattering_medium.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/optics/view.hpp"

#include "lumo/objective/contact_progression.hpp"
#include "lumo/objective/optical_separation.hpp"

#include "lumo/pipeline/evaluate.hpp"

#include "lumo/optimize/log_nehvi.hpp"
#include "lumo/optimize/optimizer.hpp"

#include "lumo/campaign/copy_store.hpp"
#include "lumo/campaign/finger_campaign.hpp"

#include "lumo/study/choice_stability.hpp"
#include "lumo/study/matched_study.hpp"
#include "lumo/study/paired_differences.hpp"
