#include "kernel.hpp"

#include "lumo/sense/profile/led_detector.hpp"
#include "sense/hand/hand_scene.hpp"
#include "sense/synthetic.hpp"

using namespace lumo;
using namespace lumo::sense;
using namespace lumo::micro;

TEST_CASE("sense: LEDs of a finger", "[sense]") {
  synthetic::View view;
  view.angle_rad = 0.2;
  const Image image = synthetic::paint(
      view, [](double y, double across) { return synthetic::leds(y, across); }, 2.0, 4);
  LedDetector detector;
  detector.distal = view.direction();
  const auto found = detector.find(image.view());
  REQUIRE(found);
  REQUIRE((found->centroid_px.col(2) - view.pixel(0.0)).norm() < 0.5);
  BENCHMARK(named("row of LEDs found", "1 picture of 640 x 480")) { return detector.find(image.view()); };
}

TEST_CASE("sense: contacts of a hand", "[sense]") {
  HandObserver hand = synthetic::practised_hand();  // four links, 25 pictures of reference
  synthetic::HandScene scene;
  scene.seed = 900;
  const Image bare = scene.paint();
  scene.touches = {{1, 5.0, 25.0}, {3, -8.0, 25.0}};
  scene.seed = 901;
  const Image touched = scene.paint();
  const JointVector joints = scene.sample();
  std::int64_t stamp = 0;
  const auto observe = [&](const Image& picture) {
    return hand.observe(stamp += synthetic::ms, joints, picture.view()).contacts.size();
  };
  REQUIRE(observe(bare) == 0);
  REQUIRE(observe(touched) == 2);
  const std::string input = "4 links in a picture of 640 x 480";
  BENCHMARK(named("contacts of a hand", input, "nothing touched")) { return observe(bare); };
  BENCHMARK(named("contacts of a hand", input, "two links touched")) { return observe(touched); };
}
