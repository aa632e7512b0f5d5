#pragma once

#include "catch.hpp"
#include "lumo/mesh/body_mesh.hpp"
#include "lumo/mesh/quality.hpp"
#include "lumo/mesh/size_field.hpp"
#include "lumo/morphology/finger.hpp"

/// What must hold for every finger's mesh; `thorough`: node by node, too.
template <class M>
void check_finger_mesh(const lumo::FingerDesign& design, const M& mesher, const lumo::Focus& focus, bool thorough) {
  using namespace lumo;
  const auto v = design.values();
  INFO("theta " << v[0] << " " << v[1] << " " << v[2] << " " << v[3] << " " << v[4]);
  const Body body = focused(
      finger(design, dragon_skin(), plain_finger()), {Vec3d(0, 11e-3, 1e-3 * (design.h_fp + design.h_ep))}, focus);
  const TetMesh mesh = mesh_body(body, mesher);
  const MeshQuality q = measure(mesh);
  CHECK(q.min_jacobian_ratio > 0.0);
  CHECK(q.volume_m3 == Approx(body.exact_volume_m3).epsilon(2e-3));
  if (!thorough) return;
  for (const BoundaryFace& f : mesh.faces)
    for (int n : f.nodes) {
      Vec3d x = mesh.nodes[std::size_t(n)];
      if (x.x() < 0) x.x() = -x.x();
      if (x.y() < 0) x.y() = -x.y();
      CHECK((closest_point(body.patches[std::size_t(f.patch)].shape, x) - x).norm() < 1e-12);
    }
  for (std::size_t k = 0; k < mesh.nodes.size(); ++k) {  // exact mirror images, to the bit
    const Vec3d &x = mesh.nodes[k], &mx = mesh.nodes[std::size_t(mesh.mirror_x[k])],
                &my = mesh.nodes[std::size_t(mesh.mirror_y[k])];
    CHECK((mx.x() == -x.x() && mx.y() == x.y() && mx.z() == x.z()));
    CHECK((my.x() == x.x() && my.y() == -x.y() && my.z() == x.z()));
    CHECK(mesh.mirror_x[std::size_t(mesh.mirror_x[k])] == int(k));
  }
}
