// Texts that lumo reads: a log's tables and session, a bag's list of files, surfaces, a pad's responses. The first byte
// says which.
#include "findings.hpp"

#include "lumo/geometry/surface_file.hpp"
#include "lumo/lab/pad_file.hpp"
#include "lumo/sense/hand/hand_log.hpp"
#include "lumo/sense/recording/mcap/bag_metadata.hpp"
#include "lumo/sense/recording/tables.hpp"
#include "lumo/support/json.hpp"

#include <cmath>
#include <cstdint>
#include <sstream>
#include <string>
#include <vector>

using namespace lumo;
using namespace lumo::sense;

namespace {

/// What was read is finite and ascends, and what is written of it reads back as the same text.
template <class Read, class Write> void check_table(const std::string& text, Read read, Write write) {
  const auto rows = [&](const std::string& t) {
    std::istringstream in(t);
    return read(in, "table");
  };
  const auto samples = rows(text);
  for (std::size_t k = 1; k < samples.size(); ++k)
    if (samples[k].stamp_ns <= samples[k - 1].stamp_ns) fuzz::finding("stamps do not ascend");
  if (samples.empty()) return;
  const std::string written = write(samples);
  if (write(rows(written)) != written) fuzz::finding("a table that does not read back", written);
}

void check_surface(const char* kind, const std::string& text) {
  const TriangleSurface s = parse_surface(kind, text, "surface", 1e-3);
  for (const auto& t : s.triangles)
    for (const int v : t)
      if (v < 0 || std::size_t(v) >= s.vertices.size()) fuzz::finding("a triangle without a vertex");
}

void check_bag(const std::string& text) {
  std::vector<std::string> files = bag_metadata(text, "metadata.yaml").files;
  sort_by_number(files);
  for (const std::string& file : files)
    if (file.empty() || file.front() == '/' || file.find("..") != std::string::npos)
      fuzz::finding("a file that is not below the folder");
}

void parse(std::uint8_t which, const std::string& text) {
  switch (which) {
    case 's': {
      const std::string written = to_json(session_from_json(text, "session"));
      const Session s = session_from_json(written, "session");
      if (to_json(s) != written) fuzz::finding("a session that does not read back", written);
      if (!s.links.empty()) hand_observer(s);
      return;
    }
    case 'h': {
      std::istringstream in(text);
      for (const auto& t : HandTouches::from_table(in, "truth").at(0))
        if (t.link < 0 || t.link > 15 || !(std::abs(t.y_m) <= 10.0) || !std::isfinite(t.force_N))
          fuzz::finding("a touch beyond any hand");
      return;
    }
    case 'f':
      return check_table(
          text, [](auto& in, const char* n) { return read_frame_log(in, n); },
          [](const auto& rows) { return frame_log_text(rows); });
    case 'j':
      return check_table(
          text, [](auto& in, const char* n) { return read_joint_log(in, n); },
          [](const auto& rows) { return joint_log_text(rows); });
    case 'w':
      return check_table(
          text, [](auto& in, const char* n) { return read_wrench_log(in, n); },
          [](const auto& rows) { return wrench_log_text(rows); });
    case 'm':
      return check_table(
          text, [](auto& in, const char* n) { return read_marker_log(in, n); },
          [](const auto& rows) { return marker_log_text(rows); });
    case 'p':
      return check_table(
          text, [](auto& in, const char* n) { return read_photodiode_log(in, n); },
          [](const auto& rows) { return photodiode_log_text(rows); });
    case 'c': {  // rows in any order are left out, and what is left ascends
      StreamReading reading;
      return check_table(
          text, [&](auto& in, const char* n) { return read_wrench_log(in, n, &reading); },
          [](const auto& rows) { return wrench_log_text(rows); });
    }
    case 'b': return check_bag(text);
    case 'o': return check_surface(".obj", text);
    case 't': return check_surface(".stl", text);
    default: {
      // The fuzzer cannot guess a checksum: it is put right, so that what is behind it is reached.
      const auto last = std::min(text.rfind("checksum "), text.size());
      const std::string body = text.substr(0, last);
      const PadResponses r = pad_responses_from_text(body + message("checksum ", checksum(body), '\n'), {}, "pad");
      if (!r.change.empty() && !r.change.front().allFinite()) fuzz::finding("responses that are not finite");
    }
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size > 0) fuzz::attempt([&] { parse(data[0], std::string(reinterpret_cast<const char*>(data) + 1, size - 1)); });
  return 0;
}
