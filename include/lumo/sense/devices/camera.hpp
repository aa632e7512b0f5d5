#pragma once

#include "lumo/sense/devices/frame.hpp"
#include "lumo/sense/devices/stream.hpp"

#include <concepts>
#include <optional>

namespace lumo::sense {

/// A source of frames: live, a video, a folder of images.
/// Laws: `next` gives each frame once, in the order of taking, and nothing when there is none now; it does not wait for
/// a frame longer than the model says; the pixels stay valid until the next call; while the state is not `open`, there
/// is no frame.
template <class C>
concept Camera = requires(C& camera, const C& view) {
  { camera.next() } -> std::same_as<std::optional<Frame>>;
  { view.state() } -> std::same_as<StreamState>;
};

}  // namespace lumo::sense
