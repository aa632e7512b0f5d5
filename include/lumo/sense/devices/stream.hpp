#pragma once

namespace lumo::sense {

/// What a source of frames or samples can still give.
enum class StreamState {
  open,   ///< there may be more
  ended,  ///< a recording has been read to its end
  failed  ///< unplugged or unreadable; what it gave before remains good
};

}  // namespace lumo::sense
