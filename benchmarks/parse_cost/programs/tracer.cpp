#include "lumo/optics/tracer.hpp"

lumo::Response trace(const lumo::Body& body, const lumo::TetMesh& mesh) {
  return lumo::Tracer<lumo::BeerLambert>{}.trace(body, mesh);
}

int main() {}
