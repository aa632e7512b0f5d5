#include "lumo/support/tetgen.hpp"

#include "version.hpp"

int main() {
  const lumo::TetgenMesher mesher;
  const lumo::MeshInput corner{
      {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {{{0, 2, 1}, 0}, {{0, 1, 3}, 0}, {{0, 3, 2}, 0}, {{1, 2, 3}, 0}}},
      {}};
  return mesher.fill(corner).tets.size() >= 1 && is_wanted_version() ? 0 : 1;
}
