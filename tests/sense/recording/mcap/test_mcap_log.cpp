#include "catch.hpp"
#include "sense/recording/full_log.hpp"

#include "lumo/sense/recording/mcap/mcap_camera.hpp"
#include "lumo/sense/recording/mcap/mcap_log_writer.hpp"
#include "lumo/support/json.hpp"
#include "lumo/support/opencv.hpp"
#include "lumo/support/zstd.hpp"
#include "sense/synthetic.hpp"

#include <cstring>
#include <sstream>
#include <string>

using namespace lumo;
using namespace lumo::sense;

namespace {

using ZstdReader = McapReader<Zstd>;

ZstdReader reader_of(const std::string& bytes) {
  return ZstdReader(std::make_unique<std::istringstream>(bytes), "a.mcap");
}

std::string log_refusal(const std::string& bytes, const McapTopics& topics = {}) {
  try {
    ZstdReader r = reader_of(bytes);
    read_log_file(r, topics);
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

Image view_picture(std::size_t k, PixelFormat format = PixelFormat::bgr) {
  Image image = Image::black(5, 4, format);
  for (std::size_t i = 0; i < image.pixels.size(); ++i) image.pixels[i] = std::uint8_t(31 * k + 7 * i);
  return image;
}

bool same_pixels(const ImageView& a, const Image& b) {
  if (a.width != b.width || a.height != b.height || a.format != b.format) return false;
  for (int y = 0; y < a.height; ++y)
    if (std::memcmp(a.row(y), b.view().row(y), std::size_t(a.width * channels(a.format))) != 0) return false;
  return true;
}

template <class Codec = Zstd>
std::string mcap_log_of(const Recording& log, bool raw, PixelFormat format = PixelFormat::bgr) {
  std::ostringstream out;
  Image image;
  write_mcap_log(
      out, log, to_json(log.session),
      [&](std::size_t k) {
        McapPictureData p;
        image = view_picture(k, format);
        p.width = image.width;
        p.height = image.height;
        if (raw) p.pixels = image.view();
        else {
          p.format = "png";
          p.file = encode_image(".png", image.view());
        }
        if (k == 3) {
          p.file.clear();
          p.pixels = {};
        }  // a camera's failure
        return p;
      },
      Codec{});
  return out.str();
}

/// Tables as the folder has them.
std::string all_tables(const Recording& l) {
  return frame_log_text(l.frames) + joint_log_text(l.joints) + wrench_log_text(l.wrenches) +
         marker_log_text(l.markers) + photodiode_log_text(l.photodiodes) + to_json(l.session);
}

/// A file of another program: `fill(writer)`.
template <class Fill> std::string foreign_mcap(Fill fill) {
  std::ostringstream out;
  McapWriter w(out);
  fill(w);
  w.finish();
  return out.str();
}

template <class M> std::uint16_t channel_of(McapWriter<>& w, const char* topic) {
  return w.add_channel(w.add_schema(M::type, "ros2msg", M::definition()), topic, "cdr");
}

RosJointState joint_state(std::int64_t t) { return {{t, ""}, {"left", "right"}, {1, 2}, {3, 4}, {5, 6}}; }

}  // namespace

TEST_CASE("a log in an MCAP file reads back as it was, in every bit of its tables", "[mcap]") {
  for (const Effort unit : {Effort::current_A, Effort::torque_Nm})
    for (const bool raw : {false, true}) {
      const Recording log = full_log(unit);
      ZstdReader r = reader_of(mcap_log_of(log, raw));
      const McapLog m = read_log_file(r);
      CHECK(all_tables(m.log) == all_tables(log));
      CHECK(std::is_sorted(r.messages().begin(), r.messages().end(),
          [](const McapEntry& a, const McapEntry& b) { return a.log_ns < b.log_ns; }));
      REQUIRE(m.camera);
      CHECK(m.camera->width == 5);
      CHECK(m.camera->height == 4);
    }
  const Recording none;
  ZstdReader r = reader_of(mcap_log_of<Uncompressed>(none, false));
  CHECK(all_tables(read_log_file(r).log) == all_tables(none));
}

TEST_CASE("pictures come back to the bit, as files and as pixels, grey and in colour", "[mcap]") {
  const Recording log = full_log(Effort::torque_Nm);
  for (const bool raw : {false, true})
    for (const PixelFormat format : {PixelFormat::bgr, PixelFormat::grey}) {
      const auto file = std::make_shared<ZstdReader>(reader_of(mcap_log_of(log, raw, format)));
      const McapLog m = read_log_file(*file);
      McapCamera camera(file, m.pictures, m.log.frames, ImageDecoder(format));
      for (std::size_t k = 0; k < 7; ++k) {
        const auto f = camera.next();
        REQUIRE(f);
        CHECK(f->stamp_ns == log.frames[k].stamp_ns);
        CHECK(f->exposure_s == log.frames[k].exposure_s);
        CHECK(f->gain == log.frames[k].gain);
        if (k == 3) CHECK(f->image.empty());
        else CHECK(same_pixels(f->image, view_picture(k, format)));
      }
      CHECK(camera.state() == StreamState::ended);
      CHECK_FALSE(camera.next());
    }
}

TEST_CASE("what could not be read again is not written", "[mcap]") {
  const auto refuses = [](auto change) {
    Recording log = full_log(Effort::current_A);
    change(log);
    CHECK_THROWS_AS(mcap_log_of(log, true), InvalidArgument);
  };
  refuses([](Recording& l) { l.frames[1].stamp_ns = l.frames[0].stamp_ns; });
  refuses([](Recording& l) { l.wrenches[0].stamp_ns = -1; });
  refuses([](Recording& l) { l.session.joint_clock.offset_s = -2e9; });  // log times count from 0
  refuses([](Recording& l) { l.markers.back().stamp_ns = 2'147'483'648'000'000'000; });
  refuses([](Recording& l) { l.joints[2].effort[0] = std::nan(""); });
  refuses([](Recording& l) { l.joints[2].unit = Effort::torque_Nm; });
  refuses([](Recording& l) { l.frames[2].gain = -1.0; });
  refuses([](Recording& l) { l.photodiodes[2].signal_V.resize(2); });
  std::ostringstream out;
  const auto mixed = [](std::size_t k) {
    McapPictureData p;
    if (k > 0) p.format = "png";
    return p;
  };
  CHECK_THROWS_AS(write_mcap_log(out, full_log(Effort::current_A), "", mixed), InvalidArgument);
}

TEST_CASE("files of other programs: no session, no stamps, rows with gaps, red first", "[mcap]") {
  std::vector<std::uint8_t> rows = {1, 2, 3, 4, 5, 6, 0, 0, 7, 8, 9, 10, 11, 12, 0, 0};
  const std::string bytes = foreign_mcap([&](McapWriter<>& w) {
    const auto i = channel_of<RosImage>(w, "/image"), j = channel_of<RosJointState>(w, "/joint_states"),
               f = channel_of<RosWrenchStamped>(w, "/ft");
    const auto again = channel_of<RosJointState>(w, "/joint_states");  // a second publisher of the topic
    for (int k = 0; k < 3; ++k) {
      w.write(i, std::uint64_t(100 + k), to_cdr(RosImage{{0, "c"}, 2, 2, "rgb8", 0, 8, rows}, ByteOrder::big));
      w.write(k == 1 ? again : j, std::uint64_t(100 + k), to_cdr(joint_state(1000 + k), ByteOrder::big));
      w.write(f, std::uint64_t(100 + k), to_cdr(RosWrenchStamped{{50 + k, "f"}, {1, 2, 3}, {4, 5, 6}}));
    }
    w.write(w.add_channel(0, "/other", "json"), 7, {});
  });
  const auto file = std::make_shared<ZstdReader>(reader_of(bytes));
  const McapLog m = read_log_file(*file);
  CHECK(m.session_json.empty());
  CHECK(m.log.session.led_count == 5);
  REQUIRE(m.log.joints.size() == 3);
  CHECK(m.log.joints[1].unit == Effort::torque_Nm);
  CHECK(m.log.joints[1].effort == joints_of(5, 6));
  CHECK(m.log.joints[1].stamp_ns == 1001);
  CHECK(m.log.wrenches.at(2).torque_Nm == Vec3d(4, 5, 6));
  CHECK(m.log.frames.at(2).stamp_ns == 102);  // by the log: the header has none
  McapCamera camera(file, m.pictures, m.log.frames, ImageDecoder());
  const auto f = camera.next();
  REQUIRE(f);
  REQUIRE(f->image.width == 2);
  CHECK(f->image.row(1)[0] == 9);
  CHECK(f->image.row(1)[2] == 7);
  CHECK(f->image.green(1, 1) == 11);
}

TEST_CASE("of several topics one must be chosen", "[mcap]") {
  const std::string bytes = foreign_mcap([&](McapWriter<>& w) {
    const auto a = channel_of<RosJointState>(w, "/arm"), b = channel_of<RosJointState>(w, "/finger");
    channel_of<RosJointState>(w, "/silent");
    w.write(a, 1, to_cdr(joint_state(1)));
    w.write(b, 2, to_cdr(joint_state(2)));
  });
  CHECK(log_refusal(bytes) == "a.mcap: has joint states on several topics, one must be chosen: /arm, /finger");
  CHECK(
      log_refusal(bytes, {.joints = "/hand"}) == "a.mcap: has no joint states on topic '/hand', but on /arm, /finger");
  CHECK(log_refusal(bytes, {.image = "/image"}) == "a.mcap: has no pictures on topic '/image'");
  ZstdReader r = reader_of(bytes);
  CHECK(read_log_file(r, {.joints = "/finger"}).log.joints.at(0).stamp_ns == 2);
}

TEST_CASE("messages with impossible contents are refused with topic and time", "[mcap]") {
  const auto one = [](const auto&... messages) {
    return log_refusal(foreign_mcap([&](McapWriter<>& w) {
      std::uint64_t t = 5;
      const auto write = [&]<class M>(const M& m) { w.write(channel_of<M>(w, "/x"), t++, to_cdr(m)); };
      (write(messages), ...);
    }));
  };
  CHECK(one(RosImage{{1, ""}, 1, 1, "16UC1", 0, 2, {}}) ==
        "a.mcap: topic /x, log time 5 ns: pictures are of encoding '16UC1', read are mono8, bgr8 and rgb8");
  CHECK(one(RosImage{{1, ""}, 2, 2, "mono8", 0, 1, {}}).ends_with("a picture's rows have 1 bytes, must have 2"));
  CHECK(one(RosImage{{1, ""}, 2, 2, "mono8", 0, 4294967295u, {}})
            .ends_with("a picture has 0 bytes, must have 4294967297"));
  CHECK(one(RosImage{{1, ""}, 40000, 2, "mono8", 0, 2, {}})
            .ends_with("a picture has 2 x 40000 px, must have 1 to 32768 each way"));
  CHECK(one(joint_state(3), joint_state(3))
            .ends_with("log time 6 ns: stamp 3 ns does not exceed the one before it, 3 ns"));
  CHECK(one(RosJointState{{1, ""}, {"a"}, {1}, {}, {1}})
            .ends_with("has 1 joints, 1 positions, 0 velocities and 1 efforts, must have as many"));
  CHECK(one(RosJointState{{1, ""}, {}, {}, {}, {}}).ends_with("has 0 joints, must have 1 to 8"));
  CHECK(one(RosJointState{{1, ""}, {"a"}, {1}, {1}, {}}) == "a.mcap: joints at 1 ns have neither efforts nor currents");
  CHECK(one(joint_state(3), RosJointState{{4, ""}, {"left", "x"}, {1, 2}, {3, 4}, {5, 6}})
            .ends_with("names other joints than the messages before it"));
  CHECK(one(RosWrenchStamped{{1, ""}, {1, 2, std::nan("")}, {}}).ends_with("numbers must be finite"));
  CHECK(one(FrameExposure{{1, ""}, -1, 0}).ends_with("must not be negative"));
  CHECK(one(PhotodiodeSignals{{1, ""}, {}}).ends_with("all messages must have as many diodes, at least 1"));
  CHECK(log_refusal(foreign_mcap([](McapWriter<>& w) {
    w.write(w.add_channel(w.add_schema(RosJointState::type, "ros1msg", ""), "/x", "ros1"), 1, {});
  })) == "a.mcap: topic /x, log time 1 ns: messages are of encoding 'ros1', read is cdr");
  CHECK(log_refusal(foreign_mcap([](McapWriter<>& w) {
    w.write(channel_of<RosJointState>(w, "/x"), 1, std::vector<std::uint8_t>{0, 1, 0, 0, 9});
  })).find("topic /x, log time 1 ns: CDR byte 4: ") != std::string::npos);
  const std::string json = "{\"format\": \"lumo-log\"}";
  CHECK(log_refusal(foreign_mcap([&](McapWriter<>& w) {
    w.attach("session.json", "application/json", 0, {reinterpret_cast<const std::uint8_t*>(json.data()), json.size()});
  })) == "a.mcap: session.json.version: must be 1");
}

TEST_CASE("a cut log keeps its session and what came before the cut, damaged ones are refused in one line or read",
    "[mcap]") {
  Recording log = full_log(Effort::current_A);
  std::ostringstream out;
  write_mcap_log(
      out, log, to_json(log.session), [](std::size_t) { return McapPictureData{}; }, Uncompressed{});
  const std::string whole = out.str();
  for (const std::size_t n : {whole.size() - 1, whole.size() * 3 / 4, whole.size() / 2}) {
    ZstdReader r = reader_of(whole.substr(0, n));
    CHECK_FALSE(r.fault().empty());
    CHECK(read_log_file(r).log.session.title == log.session.title);
  }
  // Damage within messages, behind checksums that fit: what is fuzzed here is how messages are read.
  synthetic::Normal draw(2);
  const auto payload = to_cdr(joint_state(5));
  int refused = 0;
  for (int k = 0; k < 3000; ++k) {
    auto bad = payload;
    for (int n = 0; n < 2; ++n)
      bad[std::size_t(double(bad.size()) * draw.uniform())] = std::uint8_t(256.0 * draw.uniform());
    const std::string why =
        log_refusal(foreign_mcap([&](McapWriter<>& w) { w.write(channel_of<RosJointState>(w, "/x"), 1, bad); }));
    refused += !why.empty();
    if (why.find('\n') != std::string::npos) FAIL(why);
  }
  CHECK(refused > 300);
}

TEST_CASE("what is no decoder is none", "[mcap]") {
  STATIC_REQUIRE(PictureDecoder<ImageDecoder>);
  STATIC_REQUIRE_FALSE(PictureDecoder<int>);
  STATIC_REQUIRE_FALSE(RosMessage<RosHeader>);
  STATIC_REQUIRE(Camera<McapCamera<ImageDecoder, Zstd>>);
}
