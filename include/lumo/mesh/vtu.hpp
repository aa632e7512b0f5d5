#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mesh/tet_mesh.hpp"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <ostream>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace lumo {

/// Values on the nodes of a mesh: `components` (1 or 3) numbers per node, node by node. The unit belongs in the name.
struct NodeField {
  std::string name;
  int components = 1;
  std::vector<double> values;
};

/// One file of a time series and the value (a load, a time) it stands for.
struct SeriesEntry {
  double value;
  std::string file;
};

/// The mesh as a ParaView unstructured grid (.vtu, coordinates in m, binary arrays), with fields on its nodes.
/// Throws InvalidArgument when a field does not fit the mesh, InputError when the stream fails. Source: VTK file
/// formats, cell types 10 and 24.
inline void write_vtu(std::ostream& out, const TetMesh& mesh, const std::span<const NodeField>& fields = {});

/// A ParaView collection (.pvd) of .vtu files.
inline void write_pvd(std::ostream& out, const std::span<const SeriesEntry>& entries);

/// The field for write_vtu from one vector per node.
inline NodeField node_field(std::string name, const std::span<const Vec3d>& vectors) {
  NodeField f{std::move(name), 3, {}};
  f.values.reserve(3 * vectors.size());
  for (const Vec3d& v : vectors) f.values.insert(f.values.end(), {v.x(), v.y(), v.z()});
  return f;
}

inline std::string base64(std::span<const unsigned char> bytes) {
  static constexpr std::string_view digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string s;
  s.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t have = std::min<std::size_t>(3, bytes.size() - i);
    unsigned group = unsigned(bytes[i]) << 16;
    if (have > 1) group |= unsigned(bytes[i + 1]) << 8;
    if (have > 2) group |= bytes[i + 2];
    for (std::size_t k = 0; k < 4; ++k) s += k <= have ? digits[group >> (18 - 6 * k) & 63u] : '=';
  }
  return s;
}

// VTK's inline binary: the number of bytes as UInt64, then the values, encoded as one piece.
template <class T> void vtu_array(
    std::ostream& out, std::string_view type, std::string_view name, int components, const std::vector<T>& values) {
  const std::uint64_t size = values.size() * sizeof(T);
  std::vector<unsigned char> bytes(sizeof size + size);
  std::memcpy(bytes.data(), &size, sizeof size);
  if (size > 0) std::memcpy(bytes.data() + sizeof size, values.data(), size);
  out << "<DataArray type=\"" << type << "\" Name=\"" << name << "\"";
  if (components > 1) out << message(" NumberOfComponents=\"", components, "\"");
  out << " format=\"binary\">" << base64(bytes) << "</DataArray>\n";
}

inline std::string xml_attribute(std::string_view s) {
  std::string out;
  for (const char c : s) {
    if (c == '&') out += "&amp;";
    else if (c == '<') out += "&lt;";
    else if (c == '"') out += "&quot;";
    else out += c;
  }
  return out;
}

inline void write_vtu(std::ostream& out, const TetMesh& mesh, const std::span<const NodeField>& fields) {
  for (const NodeField& f : fields)
    if ((f.components != 1 && f.components != 3) || f.values.size() != mesh.nodes.size() * std::size_t(f.components))
      throw InvalidArgument(message("field '", f.name, "' has ", f.values.size(), " values of ", f.components,
          " components, the mesh has ", mesh.nodes.size(), " nodes"));

  const std::size_t per_tet = std::size_t(mesh.nodes_per_tet());
  std::vector<std::int64_t> connectivity, offsets;
  connectivity.reserve(mesh.tets.size() * per_tet);
  offsets.reserve(mesh.tets.size());
  for (const auto& tet : mesh.tets) {  // the edge order 01, 12, 02, 03, 13, 23 is VTK's own
    for (std::size_t k = 0; k < per_tet; ++k) connectivity.push_back(tet[k]);
    offsets.push_back(std::int64_t(connectivity.size()));
  }
  const std::vector<std::uint8_t> types(mesh.tets.size(), mesh.order == 2 ? 24 : 10);

  out << "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\""
      << (std::endian::native == std::endian::little ? "LittleEndian" : "BigEndian")
      << "\" header_type=\"UInt64\">\n<UnstructuredGrid>\n"
      << message(
             "<Piece NumberOfPoints=\"", mesh.nodes.size(), "\" NumberOfCells=\"", mesh.tets.size(), "\">\n<Points>\n");
  vtu_array(out, "Float64", "position_m", 3, node_field("", mesh.nodes).values);
  out << "</Points>\n<Cells>\n";
  vtu_array(out, "Int64", "connectivity", 1, connectivity);
  vtu_array(out, "Int64", "offsets", 1, offsets);
  vtu_array(out, "UInt8", "types", 1, types);
  out << "</Cells>\n<PointData>\n";
  for (const NodeField& f : fields) vtu_array(out, "Float64", xml_attribute(f.name), f.components, f.values);
  out << "</PointData>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n";
  if (!out) throw InputError("writing a .vtu file failed");
}

inline void write_pvd(std::ostream& out, const std::span<const SeriesEntry>& entries) {
  out << "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\">\n<Collection>\n";
  for (const SeriesEntry& e : entries)
    out << "<DataSet timestep=\"" << message(e.value) << "\" part=\"0\" file=\"" << xml_attribute(e.file) << "\"/>\n";
  out << "</Collection>\n</VTKFile>\n";
  if (!out) throw InputError("writing a .pvd file failed");
}

}  // namespace lumo
