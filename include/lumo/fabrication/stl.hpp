#pragma once

#include "lumo/core/error.hpp"
#include "lumo/geometry/triangle_surface.hpp"

#include <array>
#include <bit>
#include <cstdint>
#include <ostream>
#include <string>

namespace lumo {

/// The surface as a binary .stl file in mm, the format's unit by habit. Throws InputError when the stream fails.
/// Source: 3D Systems, StereoLithography Interface Specification, 1989: 80 bytes, the number of triangles, then 50
/// bytes each, little-endian.
inline void write_stl(std::ostream& out, const TriangleSurface& surface) {
  std::string bytes = "binary STL, mm, by lumo";  // not "solid", by which texts are known
  bytes.resize(80, ' ');
  const auto word = [&bytes](std::uint32_t value) {
    for (int shift = 0; shift < 32; shift += 8) bytes += char(value >> shift & 0xFFu);
  };
  const auto point = [&word](const Vec3d& p) {
    for (int i = 0; i < 3; ++i) word(std::bit_cast<std::uint32_t>(float(p[i])));
  };
  word(std::uint32_t(surface.triangles.size()));
  for (const auto& t : surface.triangles) {
    const std::array<Vec3d, 3> corner{1e3 * surface.vertices[std::size_t(t[0])],
        1e3 * surface.vertices[std::size_t(t[1])], 1e3 * surface.vertices[std::size_t(t[2])]};
    point((corner[1] - corner[0]).cross(corner[2] - corner[0]).normalized());
    for (const Vec3d& p : corner) point(p);
    bytes.append(2, '\0');
  }
  out.write(bytes.data(), std::streamsize(bytes.size()));
  if (!out) throw InputError("writing an .stl file failed");
}

}  // namespace lumo
