#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/optics/tracer.hpp"
#include "lumo/pipeline/observe.hpp"

template <lumo::Mesher M>
lumo::Observations observe_with(const lumo::Body& body) {
  using Simulator = lumo::Simulator<lumo::NeoHookean, lumo::SDFContact>;
  const lumo::Pipeline<M, Simulator, lumo::Tracer<lumo::BeerLambert>> pipeline{{}, {lumo::NeoHookean{}}, {}};
  return lumo::observe(body, std::vector<lumo::Scenario<lumo::Sphere>>(1), pipeline, lumo::Serial{});
}

struct Filler {  // somewhere else
  lumo::LinearTets fill(const lumo::MeshInput& input) const;
};
template lumo::Observations observe_with<Filler>(const lumo::Body& body);

int main() {}
