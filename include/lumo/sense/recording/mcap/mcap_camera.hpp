#pragma once

#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/recording/mcap/mcap_log.hpp"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

namespace lumo::sense {

/// Pictures of an MCAP file, in the order of the log. One that cannot be decoded is a frame without pixels.
template <PictureDecoder Decoder, ChunkCodec... Codecs> class McapCamera {
 public:
  /// `pictures` and `records`: of read_mcap_log(files).
  McapCamera(McapFiles<Codecs...> files, const std::vector<McapPicture>& pictures,
      const std::vector<FrameRecord>& records, Decoder decoder = Decoder())
      : files_(std::move(files)), pictures_(pictures), records_(records), decoder_(std::move(decoder)) {
    if (pictures_.size() != records_.size())
      throw InvalidArgument(
          message("camera has ", pictures_.size(), " pictures and ", records_.size(), " records, must have as many"));
    for (const McapPicture& p : pictures_)
      if (p.file >= files_.size())
        throw InvalidArgument(message("camera has ", files_.size(), " files, a picture is in number ", p.file));
  }
  /// Of a single file.
  McapCamera(std::shared_ptr<McapReader<Codecs...>> file, const std::vector<McapPicture>& pictures,
      const std::vector<FrameRecord>& records, Decoder decoder = Decoder())
      : McapCamera(McapFiles<Codecs...>{std::move(file)}, pictures, records, std::move(decoder)) {}

  std::optional<Frame> next() {
    if (state() != StreamState::open) return std::nullopt;
    const FrameRecord& r = records_[next_];
    try {
      const McapPicture& p = pictures_[next_];
      message_ = files_[p.file]->read(p.at);
      return Frame{p.compressed ? decoder_(from_cdr<RosCompressedImage>(message_.data).data)
                                : pixels_(from_cdr<RosImage>(message_.data)),
          r.stamp_ns, r.exposure_s, r.gain, std::int64_t(next_++)};
    } catch (const InputError&) {  // the file has changed since it was opened
      failed_ = true;
      return std::nullopt;
    }
  }
  StreamState state() const {
    return failed_ ? StreamState::failed : next_ == records_.size() ? StreamState::ended : StreamState::open;
  }

 private:
  McapFiles<Codecs...> files_;
  std::vector<McapPicture> pictures_;
  std::vector<FrameRecord> records_;
  Decoder decoder_;
  McapMessage message_;  ///< owns the bytes of the last frame
  RosPixels pixels_;
  std::size_t next_ = 0;
  bool failed_ = false;
};

}  // namespace lumo::sense
