#pragma once

// Adapter to LZ4 (BSD-2-Clause): chunks of MCAP files as LZ4 frames.

#include "lumo/sense/recording/mcap/mcap.hpp"

#include <lz4frame.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace lumo {

/// Chunks as frames of LZ4, with a checksum.
class Lz4 {
 public:
  static constexpr std::string_view name = "lz4";

  std::vector<std::uint8_t> compress(std::span<const std::uint8_t> bytes) const {
    LZ4F_preferences_t preferences{};
    preferences.frameInfo.contentChecksumFlag = LZ4F_contentChecksumEnabled;
    preferences.frameInfo.contentSize = bytes.size();
    std::vector<std::uint8_t> out(LZ4F_compressFrameBound(bytes.size(), &preferences));
    out.resize(good(LZ4F_compressFrame(out.data(), out.size(), bytes.data(), bytes.size(), &preferences)));
    return out;
  }

  std::vector<std::uint8_t> decompress(std::span<const std::uint8_t> bytes, std::size_t size) const {
    LZ4F_dctx* made = nullptr;
    good(LZ4F_createDecompressionContext(&made, LZ4F_VERSION));
    const std::unique_ptr<LZ4F_dctx, LZ4F_errorCode_t (*)(LZ4F_dctx*)> context(made, LZ4F_freeDecompressionContext);
    std::vector<std::uint8_t> out;
    std::size_t read = 0, written = 0, more = 1;
    while (more != 0 && (read < bytes.size() || written < size)) {
      if (written == out.size() && written < size)
        out.resize(std::min(size, std::max<std::size_t>(2 * written, 1u << 16)));
      std::size_t from = bytes.size() - read, to = out.size() - written;
      more = good(LZ4F_decompress(context.get(), out.data() + written, &to, bytes.data() + read, &from, nullptr));
      if (from == 0 && to == 0 && more != 0) break;  // cut, or more than was said
      read += from;
      written += to;
    }
    if (more != 0 || written != size || read != bytes.size())
      throw InputError(message("LZ4 frame gives ", written, " bytes, or is not whole; must give ", size));
    out.resize(size);
    return out;
  }

 private:
  static std::size_t good(std::size_t result) {
    if (LZ4F_isError(result) != 0) throw InputError(std::string("LZ4: ") + LZ4F_getErrorName(result));
    return result;
  }
};

static_assert(sense::ChunkCodec<Lz4>);

}  // namespace lumo
