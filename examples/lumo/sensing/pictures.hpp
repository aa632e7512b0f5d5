#pragma once

#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/hand/hand_observer.hpp"
#include "lumo/sense/recording/tables.hpp"

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

/// What the program needs of OpenCV, which with the fifty libraries below it takes a quarter of a second to load. So it
/// is in a module of its own, which is loaded when a picture is needed for the first time.
namespace lumo::program {

using namespace sense;

/// A Camera of any kind; see its concept.
class AnyCamera {
 public:
  virtual ~AnyCamera() = default;
  virtual std::optional<Frame> next() = 0;
  virtual StreamState state() const = 0;
};
static_assert(Camera<AnyCamera>);

template <Camera C> class Held : public AnyCamera {
 public:
  explicit Held(C camera) : camera_(std::move(camera)) {}
  std::optional<Frame> next() override { return camera_.next(); }
  StreamState state() const override { return camera_.state(); }

 private:
  C camera_;
};

/// A live camera, exposure and gain locked.
class LiveCamera : public AnyCamera {
 public:
  virtual double exposure_s() const = 0;  ///< in force
  virtual double gain() const = 0;
};

struct LiveSettings {
  std::string device;
  int width = 640, height = 480;
  double frames_per_s = 30.0, exposure_s = 0.001, gain = 64.0;
  double wait_s = 0.001;  ///< for a frame
};

/// Signed values to be drawn, row by row from the top.
struct FalseColour {
  int columns = 0, rows = 0;
  std::vector<double> values;
  double range = 1.0;  ///< value of the strongest colour
  int decimals = 2;    ///< of the numbers at the colour bar
  std::string title, subtitle, unit;
};

/// All throw InputError for what cannot be read, decoded or written.
class Pictures {
 public:
  virtual ~Pictures() = default;
  virtual std::unique_ptr<AnyCamera> folder(const std::string& path, const std::vector<FrameRecord>& frames) const = 0;
  virtual std::unique_ptr<AnyCamera> video(const std::string& path, const std::vector<FrameRecord>& frames) const = 0;
  virtual std::unique_ptr<LiveCamera> live(const LiveSettings& settings) const = 0;
  /// Makes pixels of an image file's bytes, which hold until the next call; see PictureDecoder.
  using Decode = std::function<ImageView(std::span<const std::uint8_t> file)>;
  virtual Decode decoder() const = 0;
  /// Bytes of an image file in the format of an ending (".png" without loss).
  virtual std::vector<std::uint8_t> encode(const std::string& ending, const ImageView& image) const = 0;
  /// A PNG file.
  virtual std::string false_colour(const FalseColour& values) const = 0;
  virtual std::string hand_overlay(const ImageView& image, const HandObserver& hand, const HandEstimate& e) const = 0;
};

/// Loads the module at the first call. Throws Error where it is not there: the build makes it of libopencv-dev.
const Pictures& pictures();

/// Of the module: null for another version of lumo.
using MakePictures = const Pictures*(const char* version);
inline constexpr const char *pictures_file = "lumo-opencv.so", *pictures_symbol = "lumo_pictures";

/// A PictureDecoder.
class Decoder {
 public:
  ImageView operator()(std::span<const std::uint8_t> file) { return decode_(file); }

 private:
  Pictures::Decode decode_ = pictures().decoder();
};

}  // namespace lumo::program
