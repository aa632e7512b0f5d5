// 07 Decode: from a log's pictures to which place was touched, and how far apart places are. Reads the log of example
// 06, or any other.
#include "lumo/sense/decode/decoder.hpp"
#include "lumo/sense/decode/linear_decoder.hpp"
#include "lumo/sense/decode/nearest_template.hpp"
#include "lumo/sense/decode/segment_responses.hpp"
#include "lumo/sense/profile/finger_view.hpp"
#include "lumo/support/json.hpp"
#include "lumo/support/opencv.hpp"

#include <cstdio>

int main(int argc, char** argv) {
  using namespace lumo;
  using namespace lumo::sense;
  const Recording log = read_log_folder(argc > 1 ? argv[1] : "lab_log");
  const auto camera = [&] { return FolderCamera(log.path + "/frames", log.frames); };

  // The finger in the picture: its five LEDs and their known pitch give the map, what is lit about them the band.
  FolderCamera first = camera();
  const FingerView view =
      view_finger(first, log.session, UnloadedStretch::of(log.session, log.frames.front().stamp_ns), log.path);
  std::printf("LEDs %.2f px off an even row; band %.1f to %.1f mm\n", view.leds.map.residual_px, 1e3 * view.band_low_m,
      1e3 * view.band_high_m);

  // Green of 11 regions, minus the unloaded picture before each contact; a hold is the mean over its frames.
  GreenProfile regions = view.readout(LongitudinalBins::regions());
  FolderCamera all = camera();
  const auto holds = hold_responses(read_profiles(all, regions), log.session.segments);

  const RecontactQuality q = recontact_quality(slope_profiles(holds));
  std::printf("D_neighbor %.3f, W_recontact %.3f DN/N, Q %.1f (%.1f to %.1f)\n", q.metrics.D_neighbor,
      q.metrics.W_recontact, *q.metrics.Q, q.Q_low, q.Q_high);

  const DecodingTask task =
      decoding_task(holds, {2.0, 5.0});  // the paper's: signed change from 2 to 5 N, one repetition left out
  const DecodingReport nearest = cross_validate(NearestTemplate{}, task.data, task.fold);
  const DecodingReport linear = cross_validate(LinearDecoder{}, task.data, task.fold);
  for (const auto& [name, r] : {std::pair("nearest template", &nearest), std::pair("regularised linear", &linear)})
    std::printf("%-18s %3.0f %% of %zu right (95 %% from %.0f to %.0f %%)\n", name, 100 * r->accuracy.value,
        r->predictions.size(), 100 * r->accuracy.low, 100 * r->accuracy.high);
  return nearest.accuracy.low > 0.5 ? 0 : 1;  // five places: chance is 20 %
}
