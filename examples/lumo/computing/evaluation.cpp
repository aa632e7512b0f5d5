#include "computing/evaluation.hpp"

#include "computing/contacts.hpp"
#include "computing/tools.hpp"

namespace lumo::program {

Evaluation make_evaluation(const EvaluationRequest& r, int threads, Progress& progress) {
  const auto pipeline = pipeline_for(r.material, r.mechanics, r.ray_error_percent);
  return evaluate({FingerDesign::from(r.theta_mm), silicone(r.material), finger_options(r.mechanics)},
      contacts(r.ensemble), pipeline, TbbExecutor{threads}, shown_in(progress));
}

std::vector<double> make_depths(
    const Pad& pad, const Mechanics& mechanics, const lumo::Ensemble& ensemble, int threads, Progress& progress) {
  const auto pipeline = pipeline_for(pad.material, mechanics);
  Body body = body_of(pad, mechanics);
  body.regions = 0;
  std::vector<double> depths;
  const auto observed = observe(body, ensemble.scenarios(), pipeline, TbbExecutor{threads}, shown_in(progress));
  for (const ScenarioRecord& s : observed.scenarios)
    depths.push_back(is_scored(s.status, mechanics.holds()) ? 1e3 * s.states.back().depth_m : undefined);
  return depths;
}

}  // namespace lumo::program
