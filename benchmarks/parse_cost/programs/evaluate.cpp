#include "lumo/pipeline/evaluate.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/optics/tracer.hpp"

template <lumo::Mesher M> lumo::Evaluation evaluate_with() {
  const lumo::Pipeline<M, lumo::Simulator<lumo::NeoHookean, lumo::SDFContact>, lumo::Tracer<lumo::BeerLambert>>
      pipeline{{}, {lumo::NeoHookean{}}, {}};
  return lumo::evaluate({lumo::built_baseline(), lumo::dragon_skin()}, lumo::flat_ensemble(), pipeline, lumo::Serial{});
}

struct Filler {  // somewhere else
  lumo::LinearTets fill(const lumo::MeshInput& input) const;
};
template lumo::Evaluation evaluate_with<Filler>();

int main() {}
