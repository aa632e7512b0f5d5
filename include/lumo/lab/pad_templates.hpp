#pragma once

#include "lumo/core/units.hpp"
#include "lumo/lab/pad_responses.hpp"
#include "lumo/sense/localize/response_templates.hpp"

#include <Eigen/Core>
#include <utility>
#include <vector>

namespace lumo {

/// Computed responses of a pad as templates for a localiser, per emitted power. Mirror images are among them where the
/// pad has equal ends. `angle_sigma_rad`: how far contacts come from the side. Throws InputError for responses that do
/// not fit together.
inline sense::ResponseTemplates templates_of(const PadResponses& responses, double angle_sigma_rad = 0.5_deg) {
  const PadLight light(responses);
  sense::ResponseTemplates t;
  t.position_m = responses.position_m;
  t.unloaded = responses.unloaded;
  t.load_N = responses.load_N;
  const std::vector<double> places = light.places_m();
  t.place_m = Eigen::Map<const Eigen::VectorXd>(places.data(), Eigen::Index(places.size()));
  for (const double y : places) {
    Eigen::MatrixXd value(t.position_m.size(), t.load_N.size()), sideways = value;
    for (Eigen::Index l = 0; l < t.load_N.size(); ++l) {
      value.col(l) = light.change(y, t.load_N[l]);
      sideways.col(l) = light.change(y, t.load_N[l], angle_sigma_rad) - value.col(l);
    }
    t.value.push_back(std::move(value));
    t.sideways.push_back(std::move(sideways));
  }
  return t;
}

}  // namespace lumo
