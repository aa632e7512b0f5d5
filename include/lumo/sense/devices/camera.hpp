#pragma once

#include "lumo/sense/devices/frame.hpp"
#include "lumo/sense/devices/stream.hpp"

#include <concepts>
#include <optional>

namespace lumo::sense {

/// A source of frames: live, a video, a folder of images.
/// Laws: `next` gives each frame once, in the order of taking, and nullopt if there is none now; it waits no longer
/// than the model states; the pixels stay valid until the next call; there is no frame unless the state is `open`.
template <class C>
concept Camera = requires(C& camera, const C& view) {
  { camera.next() } -> std::same_as<std::optional<Frame>>;
  { view.state() } -> std::same_as<StreamState>;
};

}  // namespace lumo::sense
