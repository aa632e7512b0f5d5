#pragma once

#include "lumo/lab/pad_responses.hpp"

/// Responses with simple, known numbers, for the machinery of the lab: smooth in y, linear in the load. Not a pad's;
/// logs for estimators come from computed ones.
inline lumo::PadResponses test_pad() {
  using namespace lumo;
  PadResponses r;
  r.theta_mm = {6, 6, 8, 5, 0};
  r.material = "Sol";
  r.diameter_m = 10e-3;
  r.position_m = Eigen::VectorXd::LinSpaced(60, -29.5e-3, 29.5e-3);
  r.unloaded = Eigen::VectorXd::Constant(60, 5e-4);
  r.place_m = Eigen::VectorXd::LinSpaced(27, 0.0, 26e-3);
  r.load_N.resize(3);
  r.load_N << 5.0, 10.0, 20.0;
  r.error = Eigen::Vector3d::Constant(1e-7);
  r.depth_m = Eigen::Vector3d(1e-3, 2e-3, 4e-3).replicate(1, 27);
  for (const double y : r.place_m) {
    const Eigen::VectorXd bump = (-0.5 * ((r.position_m.array() - y) / 4e-3).square()).exp();
    r.change.push_back(bump * (2e-5 * r.load_N.transpose()));
  }
  r.tilt_place_m = Eigen::VectorXd::Constant(1, 0.0);
  r.tilt.push_back((-0.5 * (r.position_m.array() / 4e-3).square()).exp().matrix() * (1e-5 * r.load_N.transpose()));
  return r;
}
