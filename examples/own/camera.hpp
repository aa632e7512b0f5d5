#pragma once

#include "lumo/sense/devices/device.hpp"

#include <fstream>
#include <string>
#include <utility>

namespace own {

//! [camera]
/// Grey pictures in a folder, 0.pgm, 1.pgm … (binary Netpbm, at most 255 levels), one each period.
/// No library is needed to read them.
class PgmCamera {
 public:
  PgmCamera(std::string folder, double period_s) : folder_(std::move(folder)), period_s_(period_s) {}

  std::optional<lumo::sense::Frame> next() {
    if (state_ != lumo::sense::StreamState::open) return std::nullopt;
    std::ifstream in(folder_ + "/" + std::to_string(index_) + ".pgm", std::ios::binary);
    if (!in) return end(lumo::sense::StreamState::ended);  // no such picture: the recording is over
    std::string magic;
    int width = 0, height = 0, levels = 0;
    in >> magic >> width >> height >> levels;
    in.get();
    const bool good = in && magic == "P5" && width >= 1 && width <= 32768 && height >= 1 && height <= 32768;
    if (!good || levels < 1 || levels > 255) return end(lumo::sense::StreamState::failed);
    image_ = lumo::sense::Image::black(width, height, lumo::sense::PixelFormat::grey);
    in.read(reinterpret_cast<char*>(image_.pixels.data()), std::streamsize(image_.pixels.size()));
    if (!in) return end(lumo::sense::StreamState::failed);
    lumo::sense::Frame frame;
    frame.image = image_.view();  // valid until the next call
    frame.stamp_ns = std::int64_t(1e9 * period_s_ * double(index_));
    frame.index = index_++;
    return frame;
  }
  lumo::sense::StreamState state() const { return state_; }

 private:
  std::nullopt_t end(lumo::sense::StreamState how) { return state_ = how, std::nullopt; }

  std::string folder_;
  double period_s_;
  std::int64_t index_ = 0;
  lumo::sense::Image image_;
  lumo::sense::StreamState state_ = lumo::sense::StreamState::open;
};

static_assert(lumo::sense::Camera<PgmCamera>);
//! [camera]

}  // namespace own
