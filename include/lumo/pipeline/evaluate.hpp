#pragma once

#include "lumo/morphology/finger.hpp"
#include "lumo/pipeline/observe.hpp"
#include "lumo/pipeline/scores.hpp"

#include <tuple>
#include <vector>

namespace lumo {

/// A finger to evaluate: θ, the silicone that it is cast of, and how it is built.
struct Finger {
  FingerDesign design;
  Silicone silicone;
  FingerOptions options = {};
};

/// θ → finger → mesh → press → light → objectives: the paper's two.
/// Throws InfeasibleDesign before anything is computed, MeshError for a body that cannot be meshed, InvalidArgument.
template <class P, Executor E> Evaluation evaluate(const Finger& wanted, const Ensemble& ensemble, const P& pipeline,
    const E& executor, const ProgressReport& progress = {}) {
  const Body body = finger(wanted.design, wanted.silicone, wanted.options);
  const auto pressed = press(body, ensemble.scenarios(), pipeline, executor, progress);
  return score(observe(body, pressed, pipeline, executor, progress), pipeline);
}

/// Body → mesh → press → light → objectives, for any body, tool and objectives (ObservedObjective). Mirror images are
/// solved once; scenarios run side by side. Throws MeshError for a body that cannot be meshed, InvalidArgument.
template <class P, Indenter Tool, Executor E, ObservedObjective... Objectives> Scores evaluate(const Body& body,
    const std::vector<Scenario<Tool>>& scenarios, const P& pipeline, const E& executor,
    const std::tuple<Objectives...>& objectives, const ProgressReport& progress = {}) {
  const auto pressed = press(body, scenarios, pipeline, executor, progress);
  return score(observe(body, pressed, pipeline, executor, progress), pipeline, objectives);
}

}  // namespace lumo
