#pragma once

#include "lumo/core/error.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace lumo::sense {

/// Bytes of a pixel: one of grey, or blue, green, red.
enum class PixelFormat { grey, bgr };

constexpr int channels(PixelFormat f) { return f == PixelFormat::grey ? 1 : 3; }

/// A view of 8-bit pixels that something else owns. Rows run from the top, columns from the left.
struct ImageView {
  const std::uint8_t* data = nullptr;
  int width = 0;
  int height = 0;
  std::ptrdiff_t stride = 0;  ///< bytes from a row to the next
  PixelFormat format = PixelFormat::bgr;
  int lit = 1;  ///< the channel that is measured: 0 blue, 1 green, 2 red; grey has one

  const std::uint8_t* row(int y) const { return data + y * stride; }
  /// Value of the measured channel, green unless `lit` says otherwise, or the grey one. Unchecked.
  std::uint8_t green(int x, int y) const { return format == PixelFormat::grey ? row(y)[x] : row(y)[3 * x + lit]; }
  bool empty() const { return !data || width <= 0 || height <= 0; }
};

inline constexpr int max_image_side = 32768;                 ///< [px]
inline constexpr std::int64_t max_image_area = 100'000'000;  ///< [px]

/// Whether an image from outside may be this large [px].
constexpr bool is_image_size(std::int64_t width, std::int64_t height) {
  return width >= 1 && height >= 1 && width <= max_image_side && height <= max_image_side &&
         width * height <= max_image_area;
}

/// An image that owns its pixels; rows without padding.
struct Image {
  int width = 0;
  int height = 0;
  PixelFormat format = PixelFormat::bgr;
  std::vector<std::uint8_t> pixels;

  /// Black. Throws InvalidArgument for sizes outside 1 … max_image_side.
  static Image black(int width, int height, PixelFormat format = PixelFormat::bgr) {
    require_in_range("image width", width, 1, max_image_side, "px");
    require_in_range("image height", height, 1, max_image_side, "px");
    return {width, height, format,
        std::vector<std::uint8_t>(std::size_t(width) * std::size_t(height) * std::size_t(channels(format)))};
  }
  /// Copies the pixels. Throws InvalidArgument for an empty view.
  static Image copy(const ImageView& v) {
    Image image = black(v.width, v.height, v.format);
    for (int y = 0; y < v.height; ++y)
      std::copy_n(v.row(y), std::size_t(v.width) * std::size_t(channels(v.format)), image.row(y));
    return image;
  }
  ImageView view() const { return {pixels.data(), width, height, std::ptrdiff_t(width) * channels(format), format}; }
  std::uint8_t* row(int y) { return pixels.data() + std::ptrdiff_t(y) * width * channels(format); }
};

/// One picture of a camera and how it was taken.
struct Frame {
  ImageView image;
  /// The source's stamp on the session's clock: the middle of the exposure plus the session's frame delay.
  std::int64_t stamp_ns = 0;
  double exposure_s = 0.0;  ///< 0: unknown
  double gain = 0.0;        ///< linear factor, or else the driver's own number; 0: unknown
  std::int64_t index = 0;   ///< counted by the source
};

/// What a source of frames or samples can still give.
enum class StreamState {
  open,   ///< there may be more
  ended,  ///< a recording has been read to its end
  failed  ///< unplugged or unreadable; what it gave before remains good
};

/// A source of frames: live, a video, a folder of images.
/// Laws: `next` gives each frame once, in the order of taking, and nullopt if there is none now; it waits no longer
/// than the model states; the pixels stay valid until the next call; there is no frame unless the state is `open`.
template <class C>
concept Camera = requires(C& camera, const C& view) {
  { camera.next() } -> std::same_as<std::optional<Frame>>;
  { view.state() } -> std::same_as<StreamState>;
};

/// A finger or hand has at most this many joints; vectors of joints need no heap.
inline constexpr int max_joints = 8;

using JointVector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, max_joints, 1>;

/// Quantity of a motor driver's effort. The torque model's constants turn a current into a torque.
enum class Effort { current_A, torque_Nm };

/// State of all joints at one time.
struct JointSample {
  std::int64_t stamp_ns = 0;  ///< on the clock that the session names
  JointVector position_rad;
  JointVector velocity_rad_per_s;
  JointVector effort;  ///< of the motor on the joint, positive along the joint's axis
  Effort unit = Effort::current_A;
  bool saturated = false;  ///< a value stands at the end of the driver's range: it may be more
};

/// A source of joint samples: live motors or a recording.
/// Laws: `next` gives each sample once, in the order of arrival, and nullopt if there is none now; it never waits; all
/// samples have the same number of joints, in the same order; there is no sample unless the state is `open`.
template <class A>
concept Actuator = requires(A& actuator, const A& view) {
  { actuator.next() } -> std::same_as<std::optional<JointSample>>;
  { view.state() } -> std::same_as<StreamState>;
};

/// Light along the finger at one time.
struct Profile {
  std::int64_t stamp_ns = 0;
  Eigen::VectorXd value;  ///< one for each position of the readout; its unit is the readout's
  /// Share of the raw values at the top of their range: profile values there are lower bounds.
  double saturated = 0.0;
  double nearly_saturated = 0.0;  ///< share of 250 and more, where the readout counts them
};

/// Turns one raw sample (a camera's frame, a row of photodiodes) into a longitudinal profile.
/// Laws: linear in the light unless a value saturates; value i belongs to `positions_m()[i]` on the finger's y axis,
/// ascending; a sample of another size or kind gives false and leaves the profile as it was; no memory is allocated
/// after the first call.
template <class R>
concept Readout = requires(R& readout, const R& view, const typename R::Sample& sample, Profile& profile) {
  { readout.read(sample, profile) } -> std::same_as<bool>;
  { view.positions_m() } -> std::convertible_to<const Eigen::VectorXd&>;
};

/// Makes pixels of an image file's bytes.
/// Law: the view holds until the next call; it is empty for what cannot be decoded.
template <class D>
concept PictureDecoder = requires(D& decode, std::span<const std::uint8_t> file) {
  { decode(file) } -> std::same_as<ImageView>;
};

}  // namespace lumo::sense
