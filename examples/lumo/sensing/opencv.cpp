// The module: the only source that uses OpenCV.
#include "charts/false_colour.hpp"
#include "charts/hand_overlay.hpp"
#include "sensing/pictures.hpp"

#include "lumo/support/opencv.hpp"

#include <string_view>

namespace lumo::program {

using namespace sense;

namespace {

class V4l2 : public LiveCamera {
 public:
  explicit V4l2(const V4l2Camera::Config& config) : camera_(config) {}
  std::optional<Frame> next() override { return camera_.next(); }
  StreamState state() const override { return camera_.state(); }
  double exposure_s() const override { return camera_.exposure_s(); }
  double gain() const override { return camera_.gain(); }

 private:
  V4l2Camera camera_;
};

class OpenCvPictures : public Pictures {
 public:
  std::unique_ptr<AnyCamera> folder(const std::string& path, const std::vector<FrameRecord>& frames) const override {
    return std::make_unique<Held<FolderCamera>>(FolderCamera(path, frames));
  }
  std::unique_ptr<AnyCamera> video(const std::string& path, const std::vector<FrameRecord>& frames) const override {
    return std::make_unique<Held<VideoCamera>>(VideoCamera(path, frames));
  }
  std::unique_ptr<LiveCamera> live(const LiveSettings& s) const override {
    V4l2Camera::Config c;
    c.device = s.device;
    c.width = s.width;
    c.height = s.height;
    c.frames_per_s = s.frames_per_s;
    c.exposure_s = s.exposure_s;
    c.gain = s.gain;
    c.wait_s = s.wait_s;
    return std::make_unique<V4l2>(c);
  }
  Decode decoder() const override {
    return [decode = ImageDecoder()](std::span<const std::uint8_t> file) mutable { return decode(file); };
  }
  std::vector<std::uint8_t> encode(const std::string& ending, const ImageView& image) const override {
    return encode_image(ending, image);
  }
  std::string false_colour(const FalseColour& values) const override { return false_colour_png(values); }
  std::string hand_overlay(const ImageView& image, const HandObserver& hand, const HandEstimate& e) const override {
    return hand_overlay_png(image, hand, e);
  }
};

}  // namespace

}  // namespace lumo::program

extern "C" __attribute__((visibility("default"))) const lumo::program::Pictures* lumo_pictures(const char* version) {
  static const lumo::program::OpenCvPictures made;
  return std::string_view(version) == LUMO_PROGRAM_VERSION ? &made : nullptr;
}
