#pragma once

// Adapter to Zstandard (BSD-3-Clause or GPL-2): chunks of MCAP files.

#include "lumo/sense/recording/mcap/mcap.hpp"

#include <zstd.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace lumo {

/// Chunks as frames of Zstandard, with a checksum.
struct Zstd {
  static constexpr std::string_view name = "zstd";
  int level = 3;  ///< from 1, fast, to 19, small

  std::vector<std::uint8_t> compress(std::span<const std::uint8_t> bytes) const {
    const std::unique_ptr<ZSTD_CCtx, std::size_t (*)(ZSTD_CCtx*)> context(ZSTD_createCCtx(), ZSTD_freeCCtx);
    if (!context) throw InputError("Zstandard: out of memory");
    good(ZSTD_CCtx_setParameter(context.get(), ZSTD_c_compressionLevel, level));
    good(ZSTD_CCtx_setParameter(context.get(), ZSTD_c_checksumFlag, 1));
    std::vector<std::uint8_t> out(ZSTD_compressBound(bytes.size()));
    out.resize(good(ZSTD_compress2(context.get(), out.data(), out.size(), bytes.data(), bytes.size())));
    return out;
  }

  /// What a frame says that it holds [bytes]; nullopt for what begins with no frame, or with one that does not say it.
  static std::optional<std::uint64_t> frame_bytes(std::span<const std::uint8_t> bytes) {
    const unsigned long long size = ZSTD_getFrameContentSize(bytes.data(), bytes.size());
    const bool is_frame =
        bytes.size() >= 4 && bytes[0] == 0x28 && bytes[1] == 0xB5 && bytes[2] == 0x2F && bytes[3] == 0xFD;
    if (!is_frame || size == ZSTD_CONTENTSIZE_UNKNOWN || size == ZSTD_CONTENTSIZE_ERROR) return std::nullopt;
    return size;
  }

  std::vector<std::uint8_t> decompress(std::span<const std::uint8_t> bytes, std::size_t size) const {
    const std::unique_ptr<ZSTD_DCtx, std::size_t (*)(ZSTD_DCtx*)> context(ZSTD_createDCtx(), ZSTD_freeDCtx);
    if (!context) throw InputError("Zstandard: out of memory");
    std::vector<std::uint8_t> out;
    ZSTD_inBuffer in{bytes.data(), bytes.size(), 0};
    std::size_t written = 0, more = 1;
    while (in.pos < in.size || (more != 0 && written < size)) {
      if (written == out.size() && written < size)
        out.resize(std::min(size, std::max<std::size_t>(2 * written, 1u << 16)));
      ZSTD_outBuffer to{out.data(), out.size(), written};
      const std::size_t before = in.pos;
      more = good(ZSTD_decompressStream(context.get(), &to, &in));
      if (in.pos == before && to.pos == written) break;  // cut, or more than was said
      written = to.pos;
    }
    if (more != 0 || written != size || in.pos != in.size)
      throw InputError(message("Zstandard frame gives ", written, " bytes, or is not whole; must give ", size));
    out.resize(size);
    return out;
  }

 private:
  static std::size_t good(std::size_t result) {
    if (ZSTD_isError(result) != 0) throw InputError(std::string("Zstandard: ") + ZSTD_getErrorName(result));
    return result;
  }
};

static_assert(sense::ChunkCodec<Zstd>);

}  // namespace lumo
