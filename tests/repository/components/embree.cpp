#include "lumo/support/embree.hpp"

#include "version.hpp"

#include <cmath>

int main() {
  const std::vector<lumo::SceneTriangle> facing_up{{{lumo::Vec3d{-1, -1, 1}, {1, -1, 1}, {0, 2, 1}}}};
  const auto scene = lumo::Embree{}.build(facing_up);
  const lumo::RayHit hit = scene.first_hit(lumo::Vec3d::Zero(), lumo::Vec3d::UnitZ(), true);
  return hit && std::abs(hit.t - 1.0) < 1e-6 && is_wanted_version() ? 0 : 1;
}
