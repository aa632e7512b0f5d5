// Writes good files for the fuzzer to start from: make_seeds FOLDER makes FOLDER/text and FOLDER/mcap.
#include "lab/test_pad.hpp"
#include "sense/recording/full_log.hpp"

#include "lumo/lab/pad_file.hpp"
#include "lumo/sense/recording/mcap/mcap_log_writer.hpp"
#include "lumo/sense/recording/tables.hpp"
#include "lumo/support/json.hpp"
#include "lumo/support/lz4.hpp"
#include "lumo/support/zstd.hpp"

#include <filesystem>
#include <sstream>
#include <string>

using namespace lumo;
using namespace lumo::sense;

namespace {

template <class Codec> std::string mcap_of(const Recording& log, bool raw, Codec codec) {
  std::ostringstream out;
  Image image = Image::black(4, 3, PixelFormat::bgr);
  write_mcap_log(
      out, log, to_json(log.session),
      [&](std::size_t) {
        McapPictureData p;
        p.width = image.width;
        p.height = image.height;
        if (raw) {
          p.pixels = image.view();
          return p;
        }
        p.format = "png";
        p.file = {
            0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n', 0, 0, 0, 13, 'I', 'H', 'D', 'R', 0, 0, 0, 4, 0, 0, 0, 3, 8, 2};
        return p;
      },
      codec);
  return out.str();
}

/// A checksum of 0 is none: the fuzzer could not put the others right.
std::string without_checksums(std::string file) {
  for (std::size_t at = mcap_magic.size(); at + 9 < file.size() - mcap_magic.size();) {
    const auto opcode = McapOpcode(file[at]);
    const std::size_t begin = at + 9, length = std::size_t(number_at<std::uint64_t>(&file[at + 1], ByteOrder::little));
    const std::size_t sum = opcode == McapOpcode::chunk        ? begin + 24
                            : opcode == McapOpcode::data_end   ? begin
                            : opcode == McapOpcode::attachment ? begin + length - 4
                            : opcode == McapOpcode::footer     ? begin + 16
                                                               : 0;
    if (sum > 0) file.replace(sum, 4, 4, '\0');
    at = begin + length;
  }
  return file;
}

}  // namespace

int main(int count, char** words) {
  if (count != 2) return 2;
  const std::string folder = words[1];
  for (const char* kind : {"/text", "/mcap"}) std::filesystem::create_directories(folder + kind);
  const auto write = [&](const std::string& name, char which, const std::string& text) {
    write_whole(folder + "/" + name, which + text);
  };
  const Recording log = full_log(Effort::current_A);
  write("text/session", 's', to_json(log.session));
  write("text/frames", 'f', frame_log_text(log.frames));
  write("text/joints", 'j', joint_log_text(log.joints));
  write("text/torques", 'j',
      "time_s, position_rad_0, velocity_rad_per_s_0, torque_Nm_0\r\n-1.5, 0, 1e-3, 2\r\n0, 1, 2, 3\r\n");
  write("text/wrench", 'w', wrench_log_text(log.wrenches));
  write("text/backward", 'c', wrench_log_text(log.wrenches) + "1,0,0,0,0,0,0\n");
  write("text/spreadsheet", 'j', "time_s;position_rad_0;torque_Nm_0\n0,5;1,25;1e-3\n0,6;1,5;2\n");
  write("text/bag", 'b', "storage_identifier: mcap\nrelative_file_paths:\n  - a_0.mcap\n  - \"a_10.mcap\" # b\nx: 1\n");
  write("text/marker", 'm', marker_log_text(log.markers));
  write("text/diodes", 'p', photodiode_log_text(log.photodiodes));
  write("text/touches", 'h', "stamp_ns,link,y_mm,force_N\n0,0,-9.5,8\n0,3,12,1e-3\n33333333,15,0,5\n");
  write("text/obj", 'o',
      "# a tetrahedron\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 1\nf 1 3 2\nf 1/1 2/2 4/4\nf 1//1 4//1 -2//1\nf 2 "
      "3 4\n");
  std::string stl = "solid seed\n", binary(80, ' ');
  binary += std::string("\4\0\0\0", 4);
  for (const char* corners : {"000010100", "000100001", "000001010", "100010001"}) {
    stl += "facet normal 0 0 0\nouter loop\n";
    binary += std::string(12, '\0');
    for (int k = 0; k < 9; k += 3)
      stl += message("vertex ", corners[k], ' ', corners[k + 1], ' ', corners[k + 2], '\n');
    for (int k = 0; k < 9; ++k) binary += corners[k] == '1' ? std::string("\0\0\x80\x3f", 4) : std::string(4, '\0');
    stl += "endloop\nendfacet\n";
    binary += std::string(2, '\0');
  }
  write("text/stl", 't', stl + "endsolid seed\n");
  write("text/binary_stl", 't', binary);
  write("text/pad", 'r', to_text(test_pad(), "key"));
  for (const bool raw : {false, true}) {
    const std::string name = raw ? "mcap/raw_" : "mcap/png_";
    write(name + "plain", 'm', without_checksums(mcap_of(log, raw, Uncompressed{})));
    write(name + "zstd", 'm', without_checksums(mcap_of(full_log(Effort::torque_Nm), raw, Zstd{})));
    write(name + "lz4", 'm', without_checksums(mcap_of(log, raw, Lz4{})));
  }
  write("mcap/png", 'i', std::string("\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\4\0\0\0\3\10\2\0\0\0", 29));
  write("mcap/webp", 'i', std::string("RIFF\0\0\0\0WEBPVP8L\0\0\0\0\57\4\300\0\0", 25));
  write("mcap/jpeg", 'i', std::string("\xff\xd8\xff\xe0\0\4\0\0\xff\xff\xc0\0\21\10\0\3\0\4\3", 19));
  write("mcap/bmp", 'i', std::string("BM\0\0\0\0\0\0\0\0\66\0\0\0\50\0\0\0\4\0\0\0\3\0\0\0\1\0\30\0", 30));
  return 0;
}
