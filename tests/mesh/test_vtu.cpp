#include "catch.hpp"

#include "german_locale.hpp"
#include "lumo/mesh/vtu.hpp"

#include <sstream>

using namespace lumo;

namespace {

/// The quadratic reference tetrahedron.
TetMesh one_tet() {
  TetMesh m;
  m.nodes = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {.5, 0, 0}, {.5, .5, 0}, {0, .5, 0}, {0, 0, .5}, {.5, 0, .5},
      {0, .5, .5}};
  m.tets = {{0, 1, 2, 3, 4, 5, 6, 7, 8, 9}};
  return m;
}

std::string encode(std::string_view s) {
  return lumo::base64({reinterpret_cast<const unsigned char*>(s.data()), s.size()});
}

}  // namespace

TEST_CASE("base64 as in RFC 4648") {
  CHECK(encode("") == "");
  CHECK(encode("f") == "Zg==");
  CHECK(encode("fo") == "Zm8=");
  CHECK(encode("foobar") == "Zm9vYmFy");
}

TEST_CASE("a .vtu file names its cells and fields") {
  std::ostringstream out;
  const std::vector<NodeField> fields = {
      {"pressure_Pa", 1, std::vector<double>(10, 1.0)}, {"a<b", 3, std::vector<double>(30, 0.0)}};
  write_vtu(out, one_tet(), fields);
  const std::string s = out.str();
  for (const char* part : {"NumberOfPoints=\"10\" NumberOfCells=\"1\"", "Name=\"pressure_Pa\" format",
           "Name=\"a&lt;b\" NumberOfComponents=\"3\""})
    CHECK(s.find(part) != std::string::npos);
  CHECK(s.find("\">AQAAAAAAAAAY</DataArray>") != std::string::npos);  // one byte follows: type 24
}

TEST_CASE("a linear mesh has four nodes a cell") {
  TetMesh m = one_tet();
  m.order = 1;
  m.tets[0] = {0, 1, 2, 3, -1, -1, -1, -1, -1, -1};
  m.nodes.resize(4);
  std::ostringstream out;
  write_vtu(out, m);
  CHECK(out.str().find("\">AQAAAAAAAAAK</DataArray>") != std::string::npos);  // type 10
}

TEST_CASE("fields must fit the mesh, and the stream must hold") {
  std::ostringstream out;
  CHECK_THROWS_AS(write_vtu(out, one_tet(), std::vector<NodeField>{{"f", 1, {1.0}}}), InvalidArgument);
  CHECK_THROWS_AS(
      write_vtu(out, one_tet(), std::vector<NodeField>{{"f", 2, std::vector<double>(20)}}), InvalidArgument);
  out.setstate(std::ios::badbit);
  CHECK_THROWS_AS(write_vtu(out, one_tet()), InputError);
}

TEST_CASE("a .pvd series lists its files with their loads") {
  std::ostringstream out;
  write_pvd(out, std::vector<SeriesEntry>{{1.0, "a.vtu"}, {2.5, "b.vtu"}});
  CHECK(out.str().find("timestep=\"2.5\" part=\"0\" file=\"b.vtu\"") != std::string::npos);
}

TEST_CASE("files of a mesh are the same under every locale") {
  TetMesh many = one_tet();
  while (many.nodes.size() < 2000) many.nodes.push_back(many.nodes.front());
  const auto written = [&] {
    std::ostringstream out;
    write_vtu(out, many);
    write_pvd(out, std::vector<SeriesEntry>{{0.5, "a.vtu"}, {1500.0, "b.vtu"}});
    return out.str();
  };
  const std::string plain = written();
  const GermanLocale german;
  CHECK(written() == plain);
}
