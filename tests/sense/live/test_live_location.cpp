#include "catch.hpp"

#include "lumo/sense/live/live.hpp"
#include "lumo/sense/localize/peak_localizer.hpp"
#include "sense/synthetic.hpp"

#include <cmath>
#include <optional>

using namespace lumo;
using namespace lumo::sense;

namespace {

/// A camera that has nothing at every other call, loses a picture, sees nothing in another, and is touched from one and
/// a half seconds on.
class LiveScene {
 public:
  explicit LiveScene(int frames, bool with_leds = true) : frames_(frames), with_leds_(with_leds) {}

  std::optional<Frame> next() {
    if (state() != StreamState::open || (waits_ = !waits_)) return std::nullopt;
    const int k = next_++;
    image_ = synthetic::paint(
        {320, 240, {160.0, 120.0}, 0.05, 4700.0, 1.5},
        [&](double y, double across) {
          return (with_leds_ ? synthetic::leds(y, across, 90.0) : 60.0) +
                 (k < 45 ? 0.0 : 14.0 * std::exp(-0.5 * std::pow((y - place(k)) / 4.5e-3, 2)));
        },
        2.0, 300 + std::uint64_t(k));
    if (k == 70) image_ = Image::black(320, 240, PixelFormat::bgr);
    return Frame{k == 60 ? ImageView{} : image_.view(), stamp(k), 0.0, 0.0, k};
  }
  StreamState state() const { return next_ == frames_ ? StreamState::failed : StreamState::open; }
  static std::int64_t stamp(int k) { return 7'000'000'000 + 33'333'333LL * k; }
  static double place(int k) { return -10e-3 + 0.3e-3 * (k - 45); }

 private:
  int frames_;
  bool with_leds_, waits_ = false;
  int next_ = 0;
  Image image_;
};

static_assert(Camera<LiveScene>);

const FingerModel<> finger = finger_model({});

/// A clock that stands still: pictures' stamps end the rest, however slowly they are painted.
const LiveWait unhurried{.now_ns = [] { return std::int64_t{0}; }};

}  // namespace

TEST_CASE("a finger before a live camera is located picture by picture, until the camera goes", "[localizer]") {
  LiveScene camera(100);
  int reported = 0;
  locate_live(
      camera, finger, peak_localizer,
      [&](std::int64_t stamp_ns, const std::optional<LocationEstimate>& e, Faults faults) {
        const int k = int(std::lround(double(stamp_ns - LiveScene::stamp(0)) / 33'333'333.0));
        ++reported;
        INFO("picture " << k << " " << to_string(faults));
        CHECK(e.has_value() == (k != 60 && k != 70));
        if (k == 60) CHECK(faults.has(Fault::frame_corrupt));
        if (k == 70) CHECK(faults.has(Fault::frame_black));
        if (e) CHECK(e->contacts == (k < 45 ? 0 : 1));
        if (e && k > 48) CHECK(e->contact[0].y_m == Approx(LiveScene::place(k)).margin(1.5e-3));
        return true;
      },
      unhurried);
  CHECK(reported == 100 - 31);  // the first second is rest
}

TEST_CASE("a report may end the run, and a camera that shows no finger is refused", "[localizer]") {
  LiveScene camera(100), nothing(100, false), none(0), one(1);
  int count = 0;
  locate_live(
      camera, finger, peak_localizer,
      [&](std::int64_t, const std::optional<LocationEstimate>&, Faults) { return ++count < 5; }, unhurried);
  CHECK(count == 5);
  CHECK(camera.state() == StreamState::open);
  const auto refused = [&](auto& scene) {
    try {
      locate_live(scene, finger, peak_localizer,
          [](std::int64_t, const std::optional<LocationEstimate>&, Faults) { return true; },
          {.name = "the camera", .patience_s = 0.2});
    } catch (const InputError& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  CHECK(refused(nothing).starts_with("the camera: no row of 5 LEDs"));
  CHECK(refused(none) == "the camera: gives no pictures");
  CHECK(refused(one).starts_with("the camera: 1 pictures"));
  struct {
    std::optional<Frame> next() { return std::nullopt; }
    StreamState state() const { return StreamState::open; }
  } silent;
  CHECK(refused(silent) == "the camera: has given no picture for 0.2 s");  // and does not wait for ever
}
