#include "console/text.hpp"
#include "report/json.hpp"
#include "sensing/camera_options.hpp"
#include "sensing/pictures.hpp"

#include "lumo/core/stopwatch.hpp"
#include "lumo/sense/profile/finger_view.hpp"
#include "lumo/sense/profile/led_detector.hpp"

namespace lumo::program {

using namespace sense;

std::string watch(const CameraOptions& o, bool as_json) {
  LiveSettings config = settings_of(o);
  config.wait_s = 0.05;
  const auto camera = pictures().live(config);
  LiveCamera& source = *camera;
  MeanImage mean;
  std::int64_t first = 0, last = 0;
  int frames = 0;
  for (const std::int64_t end = steady_ns() + 2'000'000'000; steady_ns() < end && source.state() == StreamState::open;)
    if (const auto f = source.next()) {
      mean.add(f->image);
      if (frames++ == 0) first = f->stamp_ns;
      last = f->stamp_ns;
    }
  if (frames < 2) throw InputError(config.device + ": gives no frames");
  const Image image = mean.image();
  double light = 0.0;
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) light += image.view().green(x, y) / (double(image.width) * image.height);
  const auto leds = LedDetector{}.find(image.view());
  const double rate = 1e9 * (frames - 1) / double(last - first);
  if (as_json)
    return Json{{"device", config.device}, {"width", image.width}, {"height", image.height},
               {"frames_per_s", number(rate)}, {"exposure_s", number(source.exposure_s())},
               {"gain", number(source.gain())}, {"mean_green_DN", number(light)},
               {"leds", leds ? Json(leds->centroid_px.cols()) : Json(0)},
               {"led_residual_px", leds ? number(leds->map.residual_px) : Json(nullptr)}}
               .dump(2) +
           "\n";
  return lumo::message(config.device, ": ", image.width, " x ", image.height, " px, ", cell(rate, 1),
      " frames/s, exposure ", 1e3 * source.exposure_s(), " ms, gain ", source.gain(), ", mean green ", cell(light, 1),
      " DN\n",
      leds ? lumo::message("LEDs found: ", leds->centroid_px.cols(), ", ", cell(leds->map.residual_px, 2),
                 " px off an even row\n")
           : std::string("no row of five LEDs found\n"));
}

}  // namespace lumo::program
