#pragma once

#include "lumo/sense/devices/frame.hpp"

#include <concepts>
#include <cstdint>
#include <span>

namespace lumo::sense {

/// Makes pixels of an image file's bytes.
/// Law: the view holds until the next call; it is empty for what cannot be decoded.
template <class D>
concept PictureDecoder = requires(D& decode, std::span<const std::uint8_t> file) {
  { decode(file) } -> std::same_as<ImageView>;
};

}  // namespace lumo::sense
