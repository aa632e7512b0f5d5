#include "computing/picture.hpp"

#include "computing/press.hpp"
#include "computing/tools.hpp"
#include "computing/viewpoint.hpp"
#include "lumo/lab/rig.hpp"

#include <algorithm>
#include <utility>

namespace lumo::program {

namespace {

/// Of replicates × pixels, summed over colours.
Eigen::MatrixXd one_colour(const ViewLight& light, std::size_t pixels) {
  Eigen::MatrixXd sum = light.replicates.leftCols(Eigen::Index(pixels));
  for (Eigen::Index from = Eigen::Index(pixels); from < light.replicates.cols(); from += Eigen::Index(pixels))
    sum += light.replicates.middleCols(from, Eigen::Index(pixels));
  return sum / light.ledger.emitted;
}

std::vector<double> mean(const Eigen::MatrixXd& m) {
  const Eigen::RowVectorXd row = m.colwise().mean();
  return {row.data(), row.data() + row.size()};
}

}  // namespace

RenderResult make_render(const Configuration& o, int threads, Progress& progress) {
  const Stopwatch watch;
  const Body body = body_of(o);
  const PinholeCamera camera =
      side_view(o.camera).picture(side_geometry(body), o.camera.focal_px, o.camera.columns, o.camera.rows);
  // Faces that are looked at show the noise of what they send; a picture's lines take far longer than that.
  constexpr double more_rays = 8.0;
  const auto light = pipeline_for(o).tracer.refined(more_rays);
  PressResult press = make_press(o, progress);
  RenderResult result;
  result.columns = o.camera.columns;
  result.rows = o.camera.rows;
  result.nodes = press.seen.nodes;
  result.elements = press.seen.elements;
  result.press = press.seen.scenarios.front();
  result.seconds = watch.seconds();
  if (!is_scored(press.states.back().status, true)) return result;

  progress.stage("picture", int(press.states.size()) + 1);
  const std::size_t pixels = std::size_t(camera.pixels());
  const TbbExecutor executor{threads};
  const ViewEffort effort{.samples = o.camera.samples};
  Eigen::MatrixXd unloaded;
  for (std::size_t k = 0; k <= press.states.size(); ++k) {
    const MechanicalState* const state = k == 0 ? nullptr : &press.states[k - 1];
    const SurfaceState surface = state == nullptr ? SurfaceState{}
                                                  : SurfaceState{state->displacement, state->contact_field,
                                                        state->tool_slopes, state->carrier_slopes};
    const Symmetry symmetry = state == nullptr ? symmetry_of(body, press.mesh)
                                               : symmetry_of(body, press.mesh, scenario_of(o.touch), state->status);
    const ViewLight seen = light.look(body, press.mesh, {surface, symmetry}, camera, effort, executor);
    const Eigen::MatrixXd values = one_colour(seen, pixels);
    if (k == 0) unloaded = values;
    const Eigen::MatrixXd change = values - unloaded;
    result.pictures.push_back({state == nullptr ? 0.0 : state->load_N, mean(values), standard_error(values),
        mean(change), standard_error(change)});
    if (k == 0 || seen.ledger.imbalance() > result.ledger.imbalance()) result.ledger = seen.ledger;
    progress.step();
  }
  result.seconds = watch.seconds();
  return result;
}

double numbers_per_radiance(const CameraSettings& camera) {
  constexpr double baseline = 0.054;  // mean radiance of the built baseline's side per emitted power [1/(m² sr)]
  const CameraRig rig;
  return rig.level_DN / baseline * 1e-3 * camera.exposure_ms * camera.gain / (rig.exposure_s * rig.gain);
}

double digital_number(const CameraSettings& camera, double radiance) {
  const CameraRig rig;
  return std::clamp(rig.black_DN + numbers_per_radiance(camera) * radiance, 0.0, rig.full_DN);
}

}  // namespace lumo::program
