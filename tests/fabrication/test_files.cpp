#include "catch.hpp"

#include "fabrication/designs.hpp"
#include "german_locale.hpp"
#include "lumo/fabrication/casting_drawings.hpp"
#include "lumo/fabrication/casting_kit.hpp"
#include "lumo/fabrication/drawing.hpp"
#include "lumo/fabrication/stl.hpp"
#include "lumo/geometry/surface_file.hpp"
#include "lumo/support/zip.hpp"
#include "temporary_folder.hpp"

#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string>

using namespace lumo;

namespace {

std::string dxf(const Drawing& d) {
  std::ostringstream out;
  write_dxf(out, d);
  return out.str();
}

/// The closed loops of a DXF file, by layer, in mm.
std::multimap<std::string, std::vector<std::array<double, 2>>> loops(const std::string& text) {
  std::istringstream in(text);
  std::multimap<std::string, std::vector<std::array<double, 2>>> found;
  std::string code, value, entity, layer;
  std::vector<std::array<double, 2>> points;
  bool closed = false;
  while (std::getline(in, code) && std::getline(in, value)) {
    if (code == "0") {
      if (value == "POLYLINE") {
        points.clear();
        closed = false;
      }
      if (value == "SEQEND" && closed) found.emplace(layer, points);
      if (value == "VERTEX") points.emplace_back();
      entity = value;
    } else if (code == "8") layer = value;
    else if (code == "70" && entity == "POLYLINE") closed = value == "1";
    else if (code == "10" && entity == "VERTEX") points.back()[0] = std::stod(value);
    else if (code == "20" && entity == "VERTEX") points.back()[1] = std::stod(value);
  }
  return found;
}

double area(const std::vector<std::array<double, 2>>& p) {
  double sum = 0.0;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const auto &a = p[i], &b = p[(i + 1) % p.size()];
    sum += 0.5 * (a[0] * b[1] - a[1] * b[0]);
  }
  return std::abs(sum);
}

struct Broken : std::stringbuf {
  int_type overflow(int_type) override { return traits_type::eof(); }
  std::streamsize xsputn(const char*, std::streamsize) override { return 0; }
};

}  // namespace

TEST_CASE("a binary .stl is read back as the same solid", "[fabrication]") {
  TemporaryFolder folder;
  for (const CastingPart& part : casting_kit(casting_section({5, 10, 10, 6, 3}, plain_pad()), plain_casting())) {
    const std::string path = folder / (part.name + ".stl");
    std::ofstream out(path, std::ios::binary);
    write_stl(out, part.printed);
    out.close();
    CHECK(std::filesystem::file_size(path) == 84 + 50 * part.printed.triangles.size());
    const TriangleSurface back = read_surface(path);  // refuses what is not closed
    CHECK(back.vertices.size() == part.printed.vertices.size());
    CHECK(validate_surface(back).volume == Approx(part.volume_m3).epsilon(1e-6));
  }
}

TEST_CASE("lengths are written in mm, in every locale, without noise", "[fabrication]") {
  CHECK(lumo::in_mm(0.0125) == "12.5");
  CHECK(lumo::in_mm(-1e-12) == "0");
  CHECK(lumo::in_mm(-0.03) == "-30");
  CHECK(lumo::in_mm(1.0 / 3000.0) == "0.333333");
}

TEST_CASE("a 3MF package names its parts, their copies and the mm", "[fabrication]") {
  const auto kit = casting_kit(casting_section({5, 10, 10, 6, 3}, plain_pad()), plain_casting());
  std::vector<PrintItem> items;
  for (const CastingPart& p : kit) items.push_back({p.name, p.printed, p.copies});
  const auto files = three_mf_files(items);
  CHECK(files.size() == 3);
  const std::string& model = files.back().contents;
  const auto count = [&model](const std::string& word) {
    std::size_t n = 0;
    for (auto at = model.find(word); at != std::string::npos; at = model.find(word, at + 1)) ++n;
    return n;
  };
  CHECK(count("unit=\"millimeter\"") == 1);
  CHECK(count("<object ") == 4);
  CHECK(count("<item ") == 5);
  std::size_t vertices = 0, triangles = 0;
  for (const CastingPart& p : kit) {
    vertices += p.printed.vertices.size();
    triangles += p.printed.triangles.size();
  }
  CHECK(count("<vertex ") == vertices);
  CHECK(count("<triangle ") == triangles);
  const std::vector<PrintItem> bad{{"<&>", kit[0].printed}};
  CHECK_THROWS_AS(three_mf_files(bad), InvalidArgument);

  std::ostringstream first, second;
  write_3mf(first, std::span<const PrintItem>(items), Zip{});
  write_3mf(second, std::span<const PrintItem>(items), Zip{});
  CHECK(first.str() == second.str());
  CHECK(first.str().find(model) != std::string::npos);  // stored, not compressed
}

TEST_CASE("drawings are the design at 1:1", "[fabrication]") {
  for (const FingerDesign& d : {FingerDesign{5, 10, 10, 6, 3}, {6, 6, 8, 5, 0}}) {
    const HalfSection s = casting_section(d, plain_pad());
    const auto section = loops(dxf(section_drawing(s, plain_casting())));
    CHECK(section.count("SILICONE") == 1);
    CHECK(area(section.find("SILICONE")->second) == Approx(section_area_mm2(s)).epsilon(1e-5));
    CHECK(area(section.find("CARRIER")->second) == Approx(35.5 * 4.0 + d.w_s * d.h_s - 2.4 * 0.9).epsilon(1e-9));
    CHECK(section.count("MOULD") == 2);
    CHECK(section.count("CORES") == (d.w_v > 0.0 ? 2u : 0u));
    const auto strip = loops(dxf(strip_drawing(s, plain_casting())));
    CHECK(strip.count("LEDS") == 5);
    for (auto led = strip.lower_bound("LEDS"); led != strip.upper_bound("LEDS"); ++led)
      CHECK(area(led->second) == Approx(1.6 * 0.8).epsilon(1e-9));
    CHECK(area(strip.find("OUTLINE")->second) == Approx(52.0 * 2.0).epsilon(1e-9));
  }
  const auto core = loops(dxf(core_drawing(casting_section({5, 10, 10, 6, 3}, plain_pad()), plain_casting())));
  CHECK(area(core.find("OUTLINE")->second) == Approx(82.0 * 6.0 + 3.0 * 10.0).epsilon(1e-9));
  CHECK_THROWS_AS(core_drawing(casting_section({6, 6, 8, 5, 0}, plain_pad()), plain_casting()), InvalidArgument);
}

TEST_CASE("an .svg at scale is as many mm wide as its user units", "[fabrication]") {
  std::ostringstream out;
  write_svg(out, strip_drawing(casting_section({6, 6, 8, 5, 0}, plain_pad()), plain_casting()));
  const std::string s = out.str();
  const auto value = [&s](const std::string& key) {
    const auto at = s.find(key) + key.size();
    return s.substr(at, s.find('"', at) - at);
  };
  const std::string width = value(" width=\""), height = value(" height=\"");
  CHECK(width.ends_with("mm"));
  CHECK(value("viewBox=\"") == "0 0 " + width.substr(0, width.size() - 2) + " " + height.substr(0, height.size() - 2));
}

TEST_CASE("a stream that fails is an error", "[fabrication]") {
  Broken broken;
  std::ostream out(&broken);
  const HalfSection s = casting_section({6, 6, 8, 5, 0}, plain_pad());
  CHECK_THROWS_AS(write_stl(out, carrier_solid(s, plain_casting())), InputError);
  out.clear();
  CHECK_THROWS_AS(write_dxf(out, strip_drawing(s, plain_casting())), InputError);
  out.clear();
  CHECK_THROWS_AS(write_svg(out, strip_drawing(s, plain_casting())), InputError);
  out.clear();
  const std::vector<PrintItem> items{{"carrier", carrier_solid(s, plain_casting())}};
  CHECK_THROWS_AS(write_3mf(out, std::span<const PrintItem>(items), Zip{}), InputError);
}

TEST_CASE("drawings are the same under every locale") {
  Drawing d;
  d.title = "a line";
  d.layers = {{"cut", 1, "#000000"}};
  d.lines = {{0, {{0.0, 0.0}, {1.2345, 2000.5}}, false}};
  const auto written = [&] {
    std::ostringstream out;
    write_svg(out, d);
    return dxf(d) + out.str();
  };
  const std::string plain = written();
  const GermanLocale german;
  CHECK(written() == plain);
}
