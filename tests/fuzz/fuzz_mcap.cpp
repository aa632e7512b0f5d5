// MCAP files with their ROS messages, and headers of image files. The first byte says which.
#include "findings.hpp"

#include "lumo/sense/devices/picture_header.hpp"
#include "lumo/sense/recording/mcap/mcap_log.hpp"
#include "lumo/support/lz4.hpp"
#include "lumo/support/zstd.hpp"

#include <cstdint>
#include <memory>
#include <sstream>
#include <string>

using namespace lumo;
using namespace lumo::sense;

namespace {

void read_file(const std::string& bytes) {
  using Reader = McapReader<Zstd, Lz4>;
  Reader file(
      std::make_unique<std::istringstream>(bytes), "fuzzed", {.record_bytes = 1u << 20, .kept_bytes = 1u << 20});
  std::uint64_t before = 0;
  for (const McapEntry& e : file.messages()) {
    if (e.log_ns < before) fuzz::finding("messages are not in order");
    before = e.log_ns;
    fuzz::attempt([&] { file.read(e); });
  }
  const McapLog log = read_mcap_log(file);
  if (log.pictures.size() != log.log.frames.size()) fuzz::finding("pictures without frames");
  for (const McapPicture& p : log.pictures) {
    const McapMessage m = file.read(p.at);
    if (p.compressed) {
      picture_header(from_cdr<RosCompressedImage>(m.data).data);
      continue;
    }
    RosPixels pixels;
    const RosImage image = from_cdr<RosImage>(m.data);
    const ImageView view = pixels(image);
    unsigned sum = 0;  // every pixel that the view promises is there
    for (int y = 0; y < view.height; ++y)
      for (int x = 0; x < view.width * channels(view.format); ++x) sum += view.row(y)[x];
    if (sum == 0xffffffffu) fuzz::finding("too bright");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  if (data[0] == 'i') {
    if (picture_header({data + 1, size - 1}) && size < 12) fuzz::finding("a header in fewer bytes than any has");
    return 0;
  }
  fuzz::attempt([&] { read_file(std::string(reinterpret_cast<const char*>(data) + 1, size - 1)); });
  return 0;
}
