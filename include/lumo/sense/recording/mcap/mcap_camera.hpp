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
  /// `log`: of read_mcap_log(*file).
  McapCamera(std::shared_ptr<McapReader<Codecs...>> file, const std::vector<McapPicture>& pictures,
      const std::vector<FrameRecord>& records, Decoder decoder = Decoder())
      : file_(std::move(file)), pictures_(pictures), records_(records), decoder_(std::move(decoder)) {
    if (pictures_.size() != records_.size())
      throw InvalidArgument(
          message("camera has ", pictures_.size(), " pictures and ", records_.size(), " records, must have as many"));
  }

  std::optional<Frame> next() {
    if (state() != StreamState::open) return std::nullopt;
    const FrameRecord& r = records_[next_];
    try {
      message_ = file_->read(pictures_[next_].at);
      return Frame{pictures_[next_].compressed ? decoder_(from_cdr<RosCompressedImage>(message_.data).data)
                                               : pixels(from_cdr<RosImage>(message_.data)),
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
  ImageView pixels(const RosImage& m) {
    const ImageView v = view_of(m);
    if (v.empty() || m.encoding != "rgb8") return v;
    image_ = Image::black(v.width, v.height);
    for (int y = 0; y < v.height; ++y)
      for (int x = 0; x < v.width; ++x)
        for (int c = 0; c < 3; ++c) image_.row(y)[3 * x + c] = v.row(y)[3 * x + 2 - c];
    return image_.view();
  }

  std::shared_ptr<McapReader<Codecs...>> file_;
  std::vector<McapPicture> pictures_;
  std::vector<FrameRecord> records_;
  Decoder decoder_;
  McapMessage message_;  ///< owns the bytes of the last frame
  Image image_;
  std::size_t next_ = 0;
  bool failed_ = false;
};

}  // namespace lumo::sense
