#include "lumo/support/lz4.hpp"

#include "version.hpp"

int main() {
  const std::vector<std::uint8_t> bytes(100000, 7);
  const auto packed = lumo::Lz4{}.compress(bytes);
  return packed.size() < 1000 && lumo::Lz4{}.decompress(packed, bytes.size()) == bytes && is_wanted_version() ? 0 : 1;
}
