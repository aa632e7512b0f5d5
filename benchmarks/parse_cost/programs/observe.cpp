#include "lumo/pipeline/observe.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/optics/tracer.hpp"

struct Filler {  // somewhere else
  lumo::LinearTets fill(const lumo::MeshInput& input) const;
};
using Tools =
    lumo::Pipeline<Filler, lumo::Simulator<lumo::NeoHookean, lumo::SDFContact>, lumo::Tracer<lumo::BeerLambert>>;
using Presses = lumo::Pressed<lumo::PadOf<Tools>, lumo::Sphere>;

lumo::Observations observe(const lumo::Body& body, const Presses& presses, const Tools& tools) {
  return lumo::observe(body, presses, tools, lumo::Serial{});
}

int main() {}
