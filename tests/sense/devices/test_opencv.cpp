#include "catch.hpp"

#include "lumo/support/opencv.hpp"
#include "sense/synthetic.hpp"
#include "temporary_folder.hpp"

#include <csignal>
#include <fstream>
#include <stdexcept>

#include <unistd.h>

using namespace lumo;
using namespace lumo::sense;

namespace {

Image picture(int which, PixelFormat format = PixelFormat::bgr) {
  synthetic::View v;
  v.width = 64;
  v.height = 48;
  return synthetic::paint(
      v, [&](double, double) { return 40.0 + 20.0 * which; }, 10.0, std::uint64_t(which), format);
}

bool same(const ImageView& a, const Image& b) {
  if (a.width != b.width || a.height != b.height || a.format != b.format) return false;
  for (int y = 0; y < a.height; ++y)
    if (std::memcmp(a.row(y), b.view().row(y), std::size_t(a.width) * std::size_t(channels(a.format))) != 0)
      return false;
  return true;
}

}  // namespace

TEST_CASE("images survive a PNG to the bit, in colour and grey", "[opencv]") {
  const TemporaryFolder folder;
  for (const PixelFormat format : {PixelFormat::bgr, PixelFormat::grey}) {
    const Image image = picture(1, format);
    write_image(folder / "a.png", image.view());
    CHECK(same(read_image(folder / "a.png", format).view(), image));
  }
  CHECK_THROWS_AS(read_image(folder / "none.png"), InputError);
  CHECK_THROWS_AS(write_image(folder / "no/such/folder.png", picture(1).view()), InputError);
  CHECK_THROWS_AS(write_image(folder / "a.unknown", picture(1).view()), InputError);
  std::ofstream(folder / "text.png") << "no image";
  CHECK_THROWS_AS(read_image(folder / "text.png"), InputError);
}

TEST_CASE("a folder of images is a camera, a damaged file is a frame without pixels", "[opencv]") {
  const TemporaryFolder folder;
  for (int k = 0; k < 3; ++k) write_image(folder / ("f" + std::to_string(k) + ".png"), picture(k).view());
  std::ofstream(folder / "bad.png") << "\x89PNG broken";
  FolderCamera camera(
      folder.path.string(), {{10, "f1.png", 0.001, 64.0}, {20, "bad.png"}, {30, "gone.png"}, {40, "f0.png"}});
  auto f = camera.next();
  REQUIRE(f);
  CHECK(same(f->image, picture(1)));
  CHECK(f->exposure_s == 0.001);
  CHECK(camera.next()->image.empty());
  CHECK(camera.next()->image.empty());
  f = camera.next();
  CHECK(f->stamp_ns == 40);
  CHECK(same(f->image, picture(0)));
  CHECK(camera.state() == StreamState::ended);
  CHECK_FALSE(camera.next());

  FolderCamera named = FolderCamera::by_name(folder.path.string(), 25.0);
  CHECK(named.next()->image.empty());  // bad.png comes first
  CHECK(named.next()->stamp_ns == 40'000'000);
  CHECK_THROWS_AS(FolderCamera(folder / "none", {}), InputError);
  CHECK_THROWS_AS(FolderCamera::by_name(folder / "none", 25.0), InputError);
}

TEST_CASE("a video file is a camera, with the table's stamps or its own rate", "[opencv]") {
  const TemporaryFolder folder;
  const std::string path = folder / "video.avi";
  {
    cv::VideoWriter writer(path, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 20.0, {64, 48});
    REQUIRE(writer.isOpened());
    for (int k = 0; k < 4; ++k) {
      const Image i = picture(k);
      writer.write(cv::Mat(48, 64, CV_8UC3, const_cast<std::uint8_t*>(i.pixels.data())));
    }
  }
  VideoCamera own(path);
  int count = 0;
  for (auto f = own.next(); f; f = own.next(), ++count) {
    CHECK(f->stamp_ns == count * 50'000'000LL);
    double mean = 0.0;
    for (int y = 0; y < 48; ++y)
      for (int x = 0; x < 64; ++x) mean += f->image.green(x, y) / (48.0 * 64.0);
    CHECK(mean == Approx(40.0 + 20.0 * count).margin(2.0));
  }
  CHECK(count == 4);
  CHECK(own.state() == StreamState::ended);
  VideoCamera timed(path, {{7, "", 0.002, 3.0}, {9, "", 0.002, 3.0}});
  CHECK(timed.next()->stamp_ns == 7);
  CHECK(timed.next()->gain == 3.0);
  CHECK_FALSE(timed.next());
  CHECK(timed.state() == StreamState::failed);  // two frames more than rows: nobody knows when
  VideoCamera whole(path, {{7, ""}, {9, ""}, {11, ""}, {13, ""}});
  for (int k = 0; k < 4; ++k) CHECK(whole.next());
  CHECK_FALSE(whole.next());
  CHECK(whole.state() == StreamState::ended);
  VideoCamera cut(path, std::vector<FrameRecord>(6));
  for (int k = 0; k < 4; ++k) CHECK(cut.next());
  CHECK_FALSE(cut.next());
  CHECK(cut.state() == StreamState::failed);
  std::ofstream(folder / "text.avi") << "no video";
  CHECK_THROWS_AS(VideoCamera(folder / "text.avi"), InputError);
  CHECK_THROWS_AS(VideoCamera(folder / "none.avi"), InputError);
}

namespace {

/// Decoders that misbehave at their third frame, and none at all.
struct Bad {
  enum Way { good, hangs, crashes, throws, eats, lies } way = good;
  int count = 0;
  Image image = Image::black(8, 6, PixelFormat::grey);

  std::optional<double> open(const std::string& path) {
    if (path == "none") return std::nullopt;
    if (path == "crash") std::raise(SIGSEGV);
    while (path == "hang") ::pause();
    return 25.0;
  }
  std::optional<ImageView> next() {
    if (++count == 5) return std::nullopt;
    image.pixels.assign(48, std::uint8_t(count));
    if (count < 3) return image.view();
    while (way == hangs) ::pause();
    if (way == crashes) std::raise(SIGSEGV);
    if (way == throws) throw std::runtime_error("no");
    for (std::vector<std::vector<char>> hoard; way == eats;) hoard.emplace_back(std::size_t{1} << 24, 'x');
    ImageView view = image.view();
    if (way == lies) {
      view.width = 30000;
      view.height = 30000;
    }
    return view;
  }
};

}  // namespace

TEST_CASE("a video's decoder may hang, crash or eat memory: the camera fails, and nothing is left behind", "[opencv]") {
  const VideoProcess::Limits limits{0.5, 0.5, std::uint64_t{256} << 20};
  for (const char* path : {"none", "crash", "hang"}) {
    const VideoProcess video(Bad{}, path, limits);
    CHECK_FALSE(video.is_open());
    CHECK(video.pid() == -1);
  }
  for (const Bad::Way way : {Bad::good, Bad::hangs, Bad::crashes, Bad::throws, Bad::eats, Bad::lies}) {
    INFO("way " << int(way));
    if (way == Bad::eats && !limit_address_space) continue;
    Image image;
    int pid = 0;
    {
      VideoProcess video(Bad{way}, "good", limits);
      REQUIRE(video.is_open());
      CHECK(video.rate() == 25.0);
      pid = video.pid();
      for (int k = 1; k <= 2; ++k) {
        REQUIRE(video.next(image) == VideoProcess::Got::frame);
        CHECK((image.width == 8 && image.height == 6 && image.format == PixelFormat::grey));
        CHECK(image.pixels == std::vector<std::uint8_t>(48, std::uint8_t(k)));
      }
      if (way == Bad::good) {
        CHECK(video.next(image) == VideoProcess::Got::frame);
        CHECK(video.next(image) == VideoProcess::Got::frame);
        CHECK(video.next(image) == VideoProcess::Got::end);
      } else {
        CHECK(video.next(image) == VideoProcess::Got::failed);
        CHECK(video.next(image) == VideoProcess::Got::failed);
        CHECK_FALSE(video.is_open());
      }
    }
    CHECK(::kill(pid, 0) == -1);  // gone, and reaped
  }
}

TEST_CASE("what is no camera is not opened", "[opencv]") {
  const TemporaryFolder folder;
  std::ofstream(folder / "file") << "x";
  CHECK_THROWS_AS(V4l2Camera({"/dev/video97"}), InputError);
  CHECK_THROWS_AS(V4l2Camera({.device = "/dev/video97", .exposure_s = 4e-5}), InvalidArgument);  // would become none
  CHECK_THROWS_AS(V4l2Camera({.device = "/dev/video97", .width = 0}), InvalidArgument);
  CHECK_THROWS_AS(V4l2Camera({folder / "file"}), InputError);
  CHECK_THROWS_AS(V4l2Camera({"/dev/null"}), InputError);
}
