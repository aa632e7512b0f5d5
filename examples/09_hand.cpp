// 09 Hand: contacts on the four links of two fingers at once, without labels. Reads the hand's log of example 06.
#include "lumo/sense/hand/hand_log.hpp"
#include "lumo/support/json.hpp"
#include "lumo/support/opencv.hpp"

#include <cstdio>
#include <fstream>

int main(int argc, char** argv) {
  using namespace lumo;
  using namespace lumo::sense;
  const Recording log = read_log_folder(argc > 1 ? argv[1] : "lab_log_hand");

  // The session states each link's mounting holes and roughly where they are in the first picture. From then on they
  // are followed.
  HandObserver hand = hand_observer(log.session);
  FolderCamera camera(log.path + "/frames", log.frames);
  std::vector<HandEstimate> estimates;
  const int references = observe_hand(
      camera, hand, joint_positions(log.joints, log.session), log.session, [&](const auto& estimate, const ImageView&) {
        if (estimate) estimates.push_back(*estimate);  // all other pictures show the unloaded hand
      });
  std::printf("%d pictures of the unloaded hand, %zu others\n", references, estimates.size());

  std::ifstream table(log.path + "/truth.csv");  // opened now that all estimates are made
  const HandTouches truth = HandTouches::from_table(table, "truth.csv");
  HandScore score;
  std::size_t most = 1;
  for (const HandEstimate& e : estimates) {
    score.add(e, truth.at(e.stamp_ns));
    if (e.contacts.size() <= most) continue;
    most = e.contacts.size();
    for (const HandContact& c : e.contacts)
      std::printf(
          "%s %5.1f mm, %3.0f mm²   ", hand.links()[std::size_t(c.link)].name.c_str(), 1e3 * c.y_m, 1e6 * c.area_m2);
    std::printf("\n");
  }
  std::printf("%d of %d touches found, mean error %.2f mm, %d contacts where nothing touches\n", score.found,
      score.touches, 1e3 * score.mae_m, score.unfounded);
  return score.found > 0.9 * score.touches && score.unfounded < 0.1 * score.contacts ? 0 : 1;
}
