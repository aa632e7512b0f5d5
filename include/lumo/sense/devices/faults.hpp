#pragma once

#include <array>
#include <cstdint>
#include <string>

namespace lumo::sense {

/// What can be wrong with a finger's two streams. The first block concerns frames, the second joint samples.
enum class Fault : std::uint32_t {
  frame_dropped,   ///< a frame is missing between two
  frames_missing,  ///< none for longer than the limit
  frame_repeated,  ///< the same picture or the same stamp again
  frame_late,      ///< older than allowed when it came
  frame_time,      ///< its stamp runs backwards or lies in the future
  frame_corrupt,   ///< wrong size or format, or light that no contact makes
  frame_black,
  frame_saturated,
  led_dead,          ///< dark about one LED
  exposure_changed,  ///< by its metadata, or all lights together
  response_unknown,  ///< light that is neither no contact nor any that the localiser knows (TemplateLocalizer)
  camera_lost,       ///< the source has failed
  joint_dropped,
  joint_missing,
  joint_time,
  joint_not_finite,  ///< a value is not a number, or the number of joints is another
  torque_stuck,      ///< the very same effort for too long
  torque_spike,
  torque_saturated,  ///< beyond the motor's range, or at the end of its driver's
  position_jump,     ///< faster, or farther, than the joint can turn
  actuator_lost,
  count
};

/// A set of faults.
class Faults {
 public:
  void add(Fault f) { bits_ |= 1u << unsigned(f); }
  bool has(Fault f) const { return bits_ >> unsigned(f) & 1u; }
  bool any() const { return bits_ != 0; }
  Faults& operator|=(Faults o) {
    bits_ |= o.bits_;
    return *this;
  }
  bool operator==(const Faults&) const = default;

 private:
  std::uint32_t bits_ = 0;
};

/// Names, separated by spaces.
inline std::string to_string(Faults faults) {
  static constexpr std::array<const char*, std::size_t(Fault::count)> names{"frame_dropped", "frames_missing",
      "frame_repeated", "frame_late", "frame_time", "frame_corrupt", "frame_black", "frame_saturated", "led_dead",
      "exposure_changed", "response_unknown", "camera_lost", "joint_dropped", "joint_missing", "joint_time",
      "joint_not_finite", "torque_stuck", "torque_spike", "torque_saturated", "position_jump", "actuator_lost"};
  std::string text;
  for (std::size_t i = 0; i < names.size(); ++i)
    if (faults.has(Fault(i))) text += (text.empty() ? "" : " ") + std::string(names[i]);
  return text;
}

}  // namespace lumo::sense
