#include "catch.hpp"
#include "lumo/optics/surface/carrier_cells.hpp"

using namespace lumo;

namespace {

// Top and one side of a stem that is 8 mm wide, 6 mm high and 55 mm long.
std::vector<RigidFace> stem() {
  const double w = 4e-3, h = 6e-3, l = 27.5e-3;
  return {{"top", {{-w, -l, h}, {w, -l, h}, {w, l, h}, {-w, l, h}}},
      {"side", {{w, -l, 0}, {w, l, 0}, {w, l, h}, {w, -l, h}}}};
}

std::vector<double> depths(const std::vector<RigidFace>& faces, const std::vector<Vec3d>& soft) {
  std::vector<FaceFrame> frames;
  for (const RigidFace& f : faces) frames.push_back(face_frame(f));
  return resting_depths(faces, frames, soft);
}

}  // namespace

TEST_CASE("A roof that is pressed on a stem's top rests there, and not on the stem's side", "[carrier]") {
  // 5 µm below the top, over all of its width: up to the edge these points lie behind the side, too.
  std::vector<Vec3d> roof;
  for (int i = 0; i <= 80; ++i) roof.push_back({(4.0 - 1e-3 - 0.05 * i) * 1e-3, 0.0, 6e-3 - 5e-6});
  const std::vector<double> d = depths(stem(), roof);
  CHECK(d[0] == Approx(5e-6));
  CHECK(d[1] <= 5e-6);
  CHECK(depths(stem(), {{3.0e-3, 0.0, 3e-3}})[1] == 0.0);  // far inside: rests on nothing
  CHECK(depths(stem(), {{4.001e-3, 0.0, 3e-3}})[1] == 0.0);
  CHECK(depths(stem(), {{3.99e-3, 0.0, 3e-3}})[1] == Approx(10e-6));
}

TEST_CASE("A carrier face that stands back grows by a rim as wide as the slit to its neighbour", "[carrier]") {
  const RigidFace side = stem()[1];
  const std::vector<Vec3d> c = set_back(side, face_frame(side), 20e-6, 50e-6);
  for (std::size_t k = 0; k < 4; ++k) {
    CHECK(c[k].x() == Approx(4e-3 - 20e-6));
    for (int axis : {1, 2}) CHECK(std::abs(c[k][axis] - side.corners[k][axis]) == Approx(50e-6));
  }
}

TEST_CASE("Carrier faces that are no faces are refused by name", "[carrier]") {
  CHECK_THROWS_WITH(face_frame({"flap", {{0, 0, 0}, {1, 0, 0}}}), "carrier face 'flap' has 2 corners, needs 3");
  CHECK_THROWS_WITH(face_frame({"flap", {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}}), "carrier face 'flap' has no area");
}
