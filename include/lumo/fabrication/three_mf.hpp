#pragma once

#include "lumo/core/error.hpp"
#include "lumo/fabrication/drawing.hpp"
#include "lumo/geometry/triangle_surface.hpp"

#include <algorithm>
#include <concepts>
#include <ostream>
#include <span>
#include <string>
#include <vector>

namespace lumo {

/// A file within an archive.
struct ArchivedFile {
  std::string name;  ///< with its folders, as in "3D/3dmodel.model"
  std::string contents;
};

/// Packs files into the bytes of one .zip file. Laws: same files, same bits; unpacked, the files are the same. Throws
/// InputError.
template <class A>
concept Archiver = requires(const A& archiver, std::span<const ArchivedFile> files) {
  { archiver.pack(files) } -> std::same_as<std::string>;
};

/// A thing to be printed, `copies` times, standing on z = 0 with its corner at the origin.
struct PrintItem {
  std::string name;  ///< letters, digits, blanks and _ only
  TriangleSurface surface;
  int copies = 1;
};

/// The files of a 3MF package in mm: one object each, the copies beside each other, `spacing` [m] apart. Throws
/// InvalidArgument for a name with other characters. Source: 3MF Consortium, 3D Manufacturing Format Core
/// Specification 1.3; ECMA-376 part 2 (open packaging).
inline std::vector<ArchivedFile> three_mf_files(std::span<const PrintItem> items, double spacing = 5.0e-3);

/// The package in one. Throws InputError when the stream fails.
template <Archiver A> void write_3mf(std::ostream& out, std::span<const PrintItem> items, const A& archiver) {
  const std::string bytes = archiver.pack(three_mf_files(items));
  out.write(bytes.data(), std::streamsize(bytes.size()));
  if (!out) throw InputError("writing a .3mf file failed");
}

inline std::vector<ArchivedFile> three_mf_files(std::span<const PrintItem> items, double spacing) {
  std::string objects, build;
  double x = 0.0;
  for (std::size_t k = 0; k < items.size(); ++k) {
    const PrintItem& item = items[k];
    for (const char c : item.name)
      if (!((c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == ' ' || c == '_'))
        throw InvalidArgument(
            message("name of a printed part is '", item.name, "', must be of letters, digits, blanks and _"));
    const std::string id = std::to_string(k + 1);
    objects += "<object id=\"" + id + "\" type=\"model\" name=\"" + item.name + "\"><mesh><vertices>\n";
    double width = 0.0;
    for (const Vec3d& v : item.surface.vertices) {
      objects += "<vertex x=\"" + in_mm(v.x()) + "\" y=\"" + in_mm(v.y()) + "\" z=\"" + in_mm(v.z()) + "\"/>\n";
      width = std::max(width, v.x());
    }
    objects += "</vertices><triangles>\n";
    for (const auto& t : item.surface.triangles)
      objects += "<triangle v1=\"" + std::to_string(t[0]) + "\" v2=\"" + std::to_string(t[1]) + "\" v3=\"" +
                 std::to_string(t[2]) + "\"/>\n";
    objects += "</triangles></mesh></object>\n";
    for (int copy = 0; copy < item.copies; ++copy, x += width + spacing)
      build += "<item objectid=\"" + id + "\" transform=\"1 0 0 0 1 0 0 0 1 " + in_mm(x) + " 0 0\"/>\n";
  }
  const std::string xml = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
  return {
      {"[Content_Types].xml",
          xml + "<Types xmlns=\"http://schemas.openxmlformats.org/package/2006/content-types\">"
                "<Default Extension=\"rels\" ContentType=\"application/vnd.openxmlformats-package.relationships+xml\"/>"
                "<Default Extension=\"model\" "
                "ContentType=\"application/vnd.ms-package.3dmanufacturing-3dmodel+xml\"/></Types>\n"},
      {"_rels/.rels", xml +
                          "<Relationships xmlns=\"http://schemas.openxmlformats.org/package/2006/relationships\">"
                          "<Relationship Target=\"/3D/3dmodel.model\" Id=\"rel0\" "
                          "Type=\"http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel\"/></Relationships>\n"},
      {"3D/3dmodel.model", xml +
                               "<model unit=\"millimeter\" xml:lang=\"en\" "
                               "xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\">\n<resources>\n" +
                               objects + "</resources>\n<build>\n" + build + "</build>\n</model>\n"}};
}

}  // namespace lumo
