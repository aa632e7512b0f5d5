#pragma once

#include "lumo/sense/recording/recording.hpp"
#include "lumo/sense/recording/tables.hpp"

#include <cstdint>

inline lumo::sense::JointVector joints_of(double a, double b) {
  lumo::sense::JointVector v(2);
  v << a, b;
  return v;
}

/// One of everything that a folder can hold; three clocks.
inline lumo::sense::Recording full_log(lumo::sense::Effort unit) {
  using namespace lumo;
  using namespace lumo::sense;
  Recording log;
  log.session.title = "a µ \"log\"";
  log.session.theta_mm = {5, 10, 10, 6, 3};
  log.session.torque_constant_Nm_per_A = {0.9, 1.1};
  log.session.joint_to_joint_m = {0.0453};
  log.session.led_depth_m = 0.01475;
  log.session.camera_distance_m = 0.25;
  log.session.joint_clock = {1000, 12.5, 1e-5, 1e-4};
  log.session.wrench_clock = {0, -3.0, 0.0, 0.0};
  log.session.segments = {{100, 200, SegmentKind::hold, 3, 5.0, 1, -1, 10.0, -30.0, 10.0}};
  SessionLink link{{"tip", {0, 1}, Eigen::Matrix2Xd(2, 2)}, Eigen::Matrix2Xd(2, 2)};
  link.link.hole_m << -0.022, 0.022, -0.004, -0.004;
  link.hole_px << 10, 90, 20, 20;
  log.session.links = {link};
  for (int k = 0; k < 7; ++k) {
    const std::int64_t t = 1'700'000'000'000'000'001 + 33'333'333LL * k;
    log.frames.push_back({t, frame_file(std::size_t(k)), k % 2 == 0 ? 0.001 : 0.0, k % 2 == 0 ? 64.0 + k : 0.0});
    for (int j = 0; j < 5; ++j)
      log.joints.push_back(
          {t + j * 1'000'003LL, joints_of(0.1 * k, -j), joints_of(1.0 / 3.0, 1e-300), joints_of(k, 0.7 * j), unit});
    log.wrenches.push_back({t + 3'000'000'000, Vec3d(0.1, 0.2, -k), Vec3d(k, 0, 1e-9)});
    log.markers.push_back({t + 3'000'000'001, 1e-4 * k});
    log.photodiodes.push_back({t, Eigen::Vector3d(0.5, 0.25 * k, 1.0)});
  }
  return log;
}
