#include "lumo/support/opencv.hpp"

#include "version.hpp"

int main() {
  lumo::sense::Image image = lumo::sense::Image::black(4, 3);
  image.row(1)[5] = 200;
  lumo::write_image("components_opencv.png", image.view());
  const lumo::sense::Image again = lumo::read_image("components_opencv.png");
  return again.view().width == 4 && again.view().height == 3 && again.view().row(1)[5] == 200 && is_wanted_version()
             ? 0
             : 1;
}
