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
  CHECK(log_refusal(bytes) ==
        "a.mcap: has joint states on several topics, one must be chosen, or joints by their names: /arm (left, right), "
        "/finger (left, right)");
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
        "a.mcap: topic /x, log time 5 ns: pictures are of encoding '16UC1', read are mono8, bgr8, rgb8, bgra8, rgba8, "
        "yuv422 (uyvy), yuv422_yuy2 (yuyv), 8UC1, 8UC3 and bayer_*8");
  CHECK(one(RosImage{{1, ""}, 2, 2, "mono8", 0, 1, {}}).ends_with("a picture's rows have 1 bytes, must have 2"));
  CHECK(one(RosImage{{1, ""}, 2, 2, "mono8", 0, 4294967295u, {}})
            .ends_with("a picture has 0 bytes, must have 4294967297"));
  CHECK(one(RosImage{{1, ""}, 40000, 2, "mono8", 0, 2, {}})
            .ends_with("a picture has 2 x 40000 px, must have 1 to 32768 each way"));
  CHECK(one(joint_state(3), joint_state(3))
            .ends_with(
                "log time 6 ns: stamp 3 ns does not exceed the one before it, 3 ns; 1 of 2 stamps do not ascend, at "
                "most 5 % are left out"));
  CHECK(one(RosJointState{{1, ""}, {"a"}, {1}, {2, 3}, {1}})
            .ends_with("has 1 joints, 1 positions, 2 velocities and 1 efforts, must have as many"));
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

TEST_CASE("a stream that cannot be read leaves the others as they are", "[mcap]") {
  const std::vector<std::uint8_t> grey = {1, 2};
  const std::string bytes = foreign_mcap([&](McapWriter<>& w) {
    const auto i = channel_of<RosImage>(w, "/image"), j = channel_of<RosJointState>(w, "/joint_states"),
               f = channel_of<RosWrenchStamped>(w, "/ft");
    for (int k = 1; k < 4; ++k) {
      w.write(i, std::uint64_t(100 + k), to_cdr(RosImage{{k, "c"}, 1, 2, "mono8", 0, 2, grey}));
      RosJointState m = joint_state(k);
      if (k == 2) m.name = {"arm", "right"};
      w.write(j, std::uint64_t(100 + k), to_cdr(m));
      w.write(f, std::uint64_t(100 + k), to_cdr(RosWrenchStamped{{k, "f"}, {1, 2, k == 3 ? std::nan("") : 3.0}, {}}));
    }
  });
  ZstdReader r = reader_of(bytes);
  const McapLog m = read_mcap_log(r);
  CHECK(m.log.frames.size() == 3);
  CHECK(m.log.joints.empty());
  CHECK(m.log.wrenches.empty());
  CHECK_NOTHROW(require_readable(m.log, LogStream::frames));
  CHECK(
      m.log.reading[1].fault ==
      "a.mcap: topic /joint_states, log time 102 ns: joints must be chosen by their names: this is of arm, right, the "
      "first of left, right; it names other joints than the messages before it");
  CHECK_THROWS_AS(require_readable(m.log, LogStream::joints), InputError);
  CHECK_THROWS_AS(require_readable(m.log, LogStream::wrenches), InputError);
  CHECK(log_refusal(bytes) == m.log.reading[1].fault);
  CHECK(m.contents ==
        "/ft (geometry_msgs/msg/WrenchStamped, cdr), /image (sensor_msgs/msg/Image, cdr), /joint_states "
        "(sensor_msgs/msg/JointState, cdr)");
}

TEST_CASE("a clock that begins at 0 is one: log times replace stamps only where none is set", "[mcap]") {
  const auto times = [](const std::vector<std::int64_t>& stamps) {
    ZstdReader r = reader_of(foreign_mcap([&](McapWriter<>& w) {
      const auto j = channel_of<RosJointState>(w, "/joint_states");
      std::uint64_t log = 1'790'000'000'000'000'000;
      for (const std::int64_t t : stamps) w.write(j, log++, to_cdr(joint_state(t)));
    }));
    std::vector<std::int64_t> found;
    for (const JointSample& s : read_log_file(r).log.joints) found.push_back(s.stamp_ns);
    return found;
  };
  CHECK(times({0, 4'000'000, 8'000'000}) == std::vector<std::int64_t>{0, 4'000'000, 8'000'000});
  CHECK(times({0, 0, 0}) ==
        std::vector<std::int64_t>{1'790'000'000'000'000'000, 1'790'000'000'000'000'001, 1'790'000'000'000'000'002});
}

TEST_CASE("messages that came twice, late or from the future are left out and counted", "[mcap]") {
  std::vector<std::int64_t> stamps;
  for (int k = 0; k < 100; ++k) stamps.push_back(1000 + 10 * k);
  stamps.insert(stamps.begin() + 50, 1490);       // a row twice
  stamps.insert(stamps.begin() + 70, 1'000'000);  // far ahead: one row goes, not the thirty behind it
  stamps.insert(stamps.begin() + 90, 1005);       // long ago
  ZstdReader r = reader_of(foreign_mcap([&](McapWriter<>& w) {
    const auto j = channel_of<RosJointState>(w, "/joint_states");
    std::uint64_t log = 1;
    for (const std::int64_t t : stamps) {
      RosJointState m = joint_state(t);
      m.position = {double(log), 0.0};
      w.write(j, log++, to_cdr(m));
    }
  }));
  const Recording log = read_log_file(r).log;
  REQUIRE(log.joints.size() == 100);
  for (int k = 0; k < 100; ++k) CHECK(log.joints[std::size_t(k)].stamp_ns == 1000 + 10 * k);
  CHECK(log.joints[49].position_rad[0] == 50.0);  // of rows of one stamp the first
  CHECK(log.joints[50].position_rad[0] == 52.0);
  CHECK(log.reading[1].rows == 103);
  CHECK(log.reading[1].repeated == 1);
  CHECK(log.reading[1].backward == 2);
}

TEST_CASE("ascending rows are as many as possible", "[mcap]") {
  synthetic::Normal draw(5);
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<std::int64_t> stamp;
    for (int k = 0; k < 9; ++k) stamp.push_back(std::int64_t(8.0 * draw.uniform()));
    std::size_t most = 0;
    for (unsigned set = 0; set < 1u << 9; ++set) {  // all subsets
      std::optional<std::int64_t> last;
      std::size_t count = 0;
      bool good = true;
      for (std::size_t k = 0; k < 9; ++k)
        if (set >> k & 1u) {
          good = good && (!last || stamp[k] > *last);
          last = stamp[k];
          ++count;
        }
      if (good) most = std::max(most, count);
    }
    const AscendingRows rows = ascending_rows(stamp);
    CHECK(rows.kept.size() == most);
    CHECK(rows.kept.size() + rows.reading.left_out() == 9);
    for (std::size_t k = 1; k < rows.kept.size(); ++k) CHECK(stamp[rows.kept[k]] > stamp[rows.kept[k - 1]]);
  }
  CHECK(ascending_rows({}).kept.empty());
}

TEST_CASE("joints without velocities get them from their positions", "[mcap]") {
  const auto velocities = [](std::vector<double> given) {
    ZstdReader r = reader_of(foreign_mcap([&](McapWriter<>& w) {
      const auto j = channel_of<RosJointState>(w, "/joint_states");
      for (int k = 1; k < 40; ++k) {
        const double t = 0.004 * k;
        w.write(j, std::uint64_t(k),
            to_cdr(RosJointState{{4'000'000LL * k, ""}, {"a", "b"}, {0.3 * t, -2.0 * t}, given, {1, 2}}));
      }
    }));
    return read_log_file(r).log.joints;
  };
  for (const auto& given : {std::vector<double>{}, std::vector<double>{std::nan(""), 0.0}})
    for (const JointSample& s : velocities(given)) {
      REQUIRE(s.velocity_rad_per_s.size() == 2);
      CHECK(s.velocity_rad_per_s[0] == Approx(0.3));
      CHECK(s.velocity_rad_per_s[1] == Approx(-2.0));
    }
  CHECK(velocities({7.0, 8.0}).front().velocity_rad_per_s == joints_of(7, 8));
  std::vector<JointSample> one = {{5, joints_of(1, 2), {}, joints_of(0, 0), Effort::torque_Nm}};
  find_velocities(one);
  CHECK(one.front().velocity_rad_per_s == joints_of(0, 0));
}

TEST_CASE("joints are taken by their names, whoever else publishes on the topic", "[mcap]") {
  const double nan = std::nan("");
  const auto read = [&](const std::vector<std::string>& names) {
    ZstdReader r = reader_of(foreign_mcap([&](McapWriter<>& w) {
      const auto j = channel_of<RosJointState>(w, "/joint_states");
      std::uint64_t log = 1;
      for (std::int64_t k = 1; k < 6; ++k) {
        const double v = double(k);
        w.write(j, log++, to_cdr(RosJointState{{100 * k, ""}, {"tip", "base"}, {v, 10 * v}, {1, 2}, {3, 4}}));
        std::vector<std::string> arm;
        for (int n = 0; n < 9; ++n) arm.push_back("arm_" + std::to_string(n));
        const std::vector<double> unknown(9, nan);
        w.write(j, log++, to_cdr(RosJointState{{100 * k + 50, ""}, arm, unknown, unknown, unknown}));
        w.write(j, log++, to_cdr(RosJointState{{100 * k + 60, ""}, {"thumb"}, {7 * v}, {0.5}, {nan}}));
      }
    }));
    return read_mcap_log(r, {.joint_names = names}).log;
  };
  const Recording chain = read({"base", "tip"});
  REQUIRE(chain.joints.size() == 5);
  CHECK(chain.joints[2].stamp_ns == 300);
  CHECK(chain.joints[2].position_rad == joints_of(30, 3));
  CHECK(chain.joints[2].velocity_rad_per_s == joints_of(2, 1));
  CHECK(chain.joints[2].effort == joints_of(4, 3));
  CHECK(chain.joint_names == std::vector<std::string>{"base", "tip"});
  CHECK(chain.notes.empty());
  CHECK(read({"tip"}).joints.at(4).position_rad[0] == 5.0);
  CHECK(read({"base", "thumb"}).reading[1].fault.find("numbers must be finite") != std::string::npos);
  CHECK(read({"base", "toe"}).reading[1].fault == "a.mcap: no messages name all of the joints base, toe");
  CHECK(read({}).reading[1].fault.find("must be chosen by their names: this is of arm_0, ") == std::string::npos);
  CHECK(read({}).reading[1].fault.find("has 9 joints") != std::string::npos);
  CHECK_THROWS_AS(read(std::vector<std::string>(9, "x")), InvalidArgument);
}

TEST_CASE("joints of several topics are taken by their names", "[mcap]") {
  const auto bag = [](bool same) {
    return foreign_mcap([&](McapWriter<>& w) {
      const auto a = channel_of<RosJointState>(w, "/arm/joint_states"),
                 f = channel_of<RosJointState>(w, "/finger/joint_states"), t = channel_of<RosJointState>(w, "/tip");
      std::uint64_t log = 1;
      for (std::int64_t k = 1; k < 100; ++k) {
        const double v = double(k);
        w.write(a, log++, to_cdr(RosJointState{{100 * k, ""}, {"shoulder", same ? "base" : "elbow"}, {v, v}, {}, {}}));
        w.write(f, log++, to_cdr(RosJointState{{100 * k + 1, ""}, {"base"}, {10 * v}, {1}, {4}}));
        w.write(t, log++, to_cdr(RosJointState{{100 * k + 2, ""}, {"tip"}, {20 * v}, {}, {}}));  // by parts
        if (k > 2) w.write(t, log++, to_cdr(RosJointState{{100 * k + 3, ""}, {"tip"}, {}, {2}, {5}}));
      }
    });
  };
  ZstdReader r = reader_of(bag(false));
  const Recording log = read_log_file(r, {.joint_names = {"base", "tip"}}).log;
  REQUIRE(log.joints.size() == 96);  // the base's first message comes before the tip's, two before its efforts
  CHECK(log.reading[1].incomplete == 2);
  CHECK(log.joints[0].position_rad == joints_of(40, 60));
  CHECK(log.joints[0].effort == joints_of(4, 5));
  CHECK(log.session.joint_names == std::vector<std::string>{"base", "tip"});
  CHECK(log.notes.empty());
  CHECK(log_refusal(bag(false)) ==
        "a.mcap: has joint states on several topics, one must be chosen, or joints by their names: /arm/joint_states "
        "(elbow, shoulder), /finger/joint_states (base), /tip (tip)");
  CHECK(log_refusal(bag(true), {.joint_names = {"base"}}) ==
        "a.mcap: has joint states on several topics, one must be chosen, or joints by their names: /arm/joint_states "
        "(base, shoulder), /finger/joint_states (base)");
  ZstdReader two = reader_of(bag(true));
  CHECK(read_log_file(two, {.joints = "/finger/joint_states", .joint_names = {"base"}}).log.joints.size() == 99);
}

TEST_CASE("a few messages without a number are left out and counted, many are a fault", "[mcap]") {
  const auto read = [](int each) {
    ZstdReader r = reader_of(foreign_mcap([&](McapWriter<>& w) {
      const auto j = channel_of<RosJointState>(w, "/joint_states");
      for (int k = 1; k <= 200; ++k) {
        RosJointState m = joint_state(k);
        if (k % each == 0) m.effort[1] = std::nan("");
        w.write(j, std::uint64_t(k), to_cdr(m));
      }
    }));
    return read_mcap_log(r).log;
  };
  CHECK(read(50).joints.size() == 196);
  CHECK(read(50).reading[1].incomplete == 4);
  CHECK(read(50).reading[1].rows == 200);
  CHECK(read(10).joints.empty());
  CHECK(read(10).reading[1].fault ==
        "a.mcap: topic /joint_states: numbers must be finite: a position or an effort is not in 20 of 200 messages, at "
        "most 5 % are left out");
}

TEST_CASE("joints keep their names and their currents through a file, in the order that the session states", "[mcap]") {
  Recording log = full_log(Effort::current_A);
  log.joint_names = {"tip", "base"};
  const std::string bytes = mcap_log_of(log, false);
  ZstdReader r = reader_of(bytes);
  const Recording same = read_log_file(r).log;
  CHECK(same.joint_names == log.joint_names);
  CHECK(joint_log_text(same.joints, same.joint_names) == joint_log_text(log.joints, log.joint_names));
  CHECK(same.notes == std::vector<std::string>{"joints from the base to the tip are taken to be tip, base"});

  log.session.joint_names = {"base", "tip"};  // as somebody states
  ZstdReader stated = reader_of(mcap_log_of(log, false));
  const Recording chain = read_log_file(stated).log;
  CHECK(chain.notes.empty());
  REQUIRE(chain.joints.size() == log.joints.size());
  for (std::size_t k = 0; k < chain.joints.size(); ++k) {
    CHECK(chain.joints[k].position_rad == log.joints[k].position_rad.reverse());
    CHECK(chain.joints[k].effort == log.joints[k].effort.reverse());
    CHECK(chain.joints[k].unit == Effort::current_A);
  }
  CHECK(log_refusal(bytes, {.joint_names = {"toe"}}) == "a.mcap: no messages name all of the joints toe");
}

TEST_CASE("wrenches are turned as the sensor is mounted, once", "[mcap]") {
  Recording log = full_log(Effort::current_A);
  log.session.wrench_axes = sensor_axes({"y", "-x", "-z"});
  ZstdReader r = reader_of(mcap_log_of(log, false));
  const Recording turned = read_log_file(r).log;
  REQUIRE(turned.wrenches.size() == 7);
  CHECK(turned.wrenches[2].force_N == Vec3d(0.2, -0.1, 2.0));
  CHECK(turned.wrenches[2].torque_Nm == Vec3d(0.0, -2.0, -1e-9));
  CHECK(turned.session.wrench_axes == SensorAxes{});
  CHECK(
      turned.notes == std::vector<std::string>{"wrenches are turned: the finger's x, y, z are the sensor's y, -x, -z"});
  CHECK(session_from_json(to_json(log.session), "s").wrench_axes == log.session.wrench_axes);
  CHECK(names_of(sensor_axes({"+z", "x", "y"})) == std::vector<std::string>{"z", "x", "y"});
  for (const auto& wrong :
      std::vector<std::vector<std::string>>{{"x", "y"}, {"x", "y", "y"}, {"x", "y", "w"}, {"", "y", "z"}})
    CHECK_THROWS_AS(sensor_axes(wrong), InvalidArgument);
}

TEST_CASE("joints that come by turns, or in another order, keep their places", "[mcap]") {
  ZstdReader r = reader_of(foreign_mcap([&](McapWriter<>& w) {
    const auto j = channel_of<RosJointState>(w, "/joint_states");
    for (std::int64_t k = 1; k < 9; ++k) {
      RosJointState m = joint_state(k);
      if (k % 2 == 0) m = {{k, ""}, {"right", "left"}, {2, 1}, {4, 3}, {6, 5}};
      w.write(j, std::uint64_t(k), to_cdr(m));
    }
  }));
  const std::vector<JointSample> same = read_log_file(r).log.joints;
  REQUIRE(same.size() == 8);
  for (const JointSample& s : same) {
    CHECK(s.position_rad == joints_of(1, 2));
    CHECK(s.effort == joints_of(5, 6));
  }
  ZstdReader turns = reader_of(foreign_mcap([&](McapWriter<>& w) {
    const auto j = channel_of<RosJointState>(w, "/joint_states");
    for (std::int64_t k = 1; k < 9; ++k) {
      const double v = double(k);
      w.write(j, std::uint64_t(2 * k), to_cdr(RosJointState{{2 * k, ""}, {"a"}, {v}, {1}, {v}}));
      w.write(j, std::uint64_t(2 * k + 1), to_cdr(RosJointState{{2 * k, ""}, {"b"}, {10 * v}, {1}, {0}}));
    }
  }));
  const std::vector<JointSample> merged = read_log_file(turns, {.joint_names = {"b", "a"}}).log.joints;
  REQUIRE(merged.size() == 8);  // one for each message of the first joint
  for (std::size_t k = 0; k < 8; ++k) CHECK(merged[k].position_rad == joints_of(10.0 * double(k + 1), double(k + 1)));
}

TEST_CASE("streams on two clocks are joined by the log times, which a note reports", "[mcap]") {
  const auto read = [](std::int64_t joint_shift, std::uint64_t joint_log) {
    const std::vector<std::uint8_t> grey = {1, 2};
    ZstdReader r = reader_of(foreign_mcap([&](McapWriter<>& w) {
      const auto i = channel_of<RosImage>(w, "/image"), j = channel_of<RosJointState>(w, "/joint_states");
      for (int k = 0; k < 20; ++k) {
        const std::int64_t t = 1'790'000'000'000'000'000 + 33'000'000LL * k;
        w.write(i, std::uint64_t(t) + 5'000'000, to_cdr(RosImage{{t, "c"}, 1, 2, "mono8", 0, 2, grey}));
        w.write(j, std::uint64_t(t) + 2'000'000 + joint_log, to_cdr(joint_state(t + joint_shift)));
      }
    }));
    return read_log_file(r).log;
  };
  const Recording same = read(0, 0);
  CHECK(same.notes.size() == 1);  // which joints
  CHECK(same.session.joint_clock == ClockMap{});
  const Recording boot = read(-1'789'996'400'000'000'000, 0);
  CHECK(boot.session.joint_clock.offset_s == Approx(1'789'996'400.0 - 0.003).epsilon(1e-12));
  REQUIRE(boot.notes.size() == 2);
  CHECK(boot.notes[1].find("joint states are stamped on another clock") == 0);
  CHECK_NOTHROW(require_common_time(boot));
  const Recording apart = read(-1'789'996'400'000'000'000, 3'600'000'000'000);  // nor do log times agree
  CHECK(apart.notes.size() == 1);
  CHECK_THROWS_WITH(require_common_time(apart),
      "a.mcap: pictures and joint samples have no time in common: pictures from 1790000000.000 to 1790000000.627 s, "
      "joints from 3600.000 to 3600.627 s; if their clocks differ, joint_clock of session.json must say by how much");
}

TEST_CASE("pixels of each encoding are the same picture", "[mcap]") {
  const Image grey = view_picture(3, PixelFormat::grey), wanted = [] {
    Image image = Image::black(6, 4);
    for (int y = 0; y < 4; ++y)
      for (int x = 0; x < 6; ++x)
        for (int c = 0; c < 3; ++c) image.row(y)[3 * x + c] = std::uint8_t(20 * y + 7 * x + 3 * c);
    return image;
  }();
  const auto shown = [](const std::string& encoding, int width, int bytes, const std::vector<std::uint8_t>& data) {
    RosPixels pixels;
    const RosImage m{{1, "c"}, std::uint32_t(data.size()) / std::uint32_t(width * bytes), std::uint32_t(width),
        encoding, 0, std::uint32_t(width * bytes), data};
    return Image::copy(pixels(m));
  };
  for (const char* name : {"mono8", "8UC1"}) CHECK(shown(name, 5, 1, grey.pixels).pixels == grey.pixels);
  const auto arranged = [&](std::vector<int> places) {  // -1: alpha
    std::vector<std::uint8_t> bytes;
    for (std::size_t p = 0; p < 24; ++p)
      for (const int c : places) bytes.push_back(c < 0 ? 255 : wanted.pixels[3 * p + std::size_t(c)]);
    return bytes;
  };
  CHECK(shown("bgr8", 6, 3, arranged({0, 1, 2})).pixels == wanted.pixels);
  CHECK(shown("8UC3", 6, 3, arranged({0, 1, 2})).pixels == wanted.pixels);
  CHECK(shown("rgb8", 6, 3, arranged({2, 1, 0})).pixels == wanted.pixels);
  CHECK(shown("bgra8", 6, 4, arranged({0, 1, 2, -1})).pixels == wanted.pixels);
  CHECK(shown("rgba8", 6, 4, arranged({2, 1, 0, -1})).pixels == wanted.pixels);
  // Grey light has no colour difference; one step of V is 1.402 of red and -0.714 of green.
  for (const auto& [name, first] : {std::pair("yuv422", 1), {"uyvy", 1}, {"yuv422_yuy2", 0}, {"yuyv", 0}}) {
    std::vector<std::uint8_t> bytes(16, 128);
    for (std::size_t x = 0; x < 8; ++x) bytes[2 * x + std::size_t(first)] = std::uint8_t(30 * x);
    const Image level = shown(name, 4, 2, bytes);
    for (std::size_t p = 0; p < 8; ++p)
      for (std::size_t c = 0; c < 3; ++c) CHECK(level.pixels[3 * p + c] == 30 * p);
    bytes[std::size_t(first == 1 ? 2 : 3)] = 148;  // V of the first two pixels
    const Image red = shown(name, 4, 2, bytes);
    CHECK(red.pixels[3 + 2] == 58);
    CHECK(red.pixels[3 + 1] == 16);
    CHECK(red.pixels[3 * 2 + 2] == 60);
  }
  CHECK_THROWS_WITH(
      shown("yuyv", 3, 2, std::vector<std::uint8_t>(6)), "a picture of encoding 'yuyv' is 3 px wide, must be even");
  // A level colour comes back, whatever the pattern; a lone green pixel spreads to its neighbours of other colours.
  for (const std::string pattern : {"rggb", "bggr", "gbrg", "grbg"}) {
    std::vector<std::uint8_t> bytes;
    for (std::size_t y = 0; y < 4; ++y)
      for (std::size_t x = 0; x < 6; ++x) {
        const char c = pattern[2 * (y % 2) + x % 2];
        bytes.push_back(c == 'b' ? 10 : c == 'g' ? 100 : 200);
      }
    const Image level = shown("bayer_" + pattern + "8", 6, 1, bytes);
    for (std::size_t p = 0; p < 24; ++p)
      CHECK(std::array{level.pixels[3 * p], level.pixels[3 * p + 1], level.pixels[3 * p + 2]} ==
            std::array<std::uint8_t, 3>{10, 100, 200});
  }
}

TEST_CASE("a depth topic, and pictures that are packed again, need not be chosen against", "[mcap]") {
  const std::vector<std::uint8_t> rgb(6, 9), depth(4, 1);
  const auto bag = [&](bool twin, bool second) {
    return foreign_mcap([&](McapWriter<>& w) {
      const auto c = channel_of<RosImage>(w, "/camera/color/image_raw"), d = channel_of<RosImage>(w, "/camera/depth"),
                 p = channel_of<RosCompressedImage>(w, "/camera/color/image_raw/compressed"),
                 o = channel_of<RosImage>(w, "/other");
      for (int k = 1; k < 4; ++k) {
        w.write(c, std::uint64_t(k), to_cdr(RosImage{{k, "c"}, 1, 2, "rgb8", 0, 6, rgb}));
        w.write(d, std::uint64_t(k), to_cdr(RosImage{{k, "c"}, 1, 2, "16UC1", 0, 4, depth}));
        if (twin) w.write(p, std::uint64_t(k), to_cdr(RosCompressedImage{{k, "c"}, "rgb8; jpeg compressed bgr8", {}}));
        if (second) w.write(o, std::uint64_t(k), to_cdr(RosImage{{k, "c"}, 1, 2, "rgb8", 0, 6, rgb}));
      }
    });
  };
  ZstdReader r = reader_of(bag(true, false));
  const McapLog m = read_log_file(r);
  CHECK(m.log.frames.size() == 3);
  CHECK_FALSE(m.pictures.at(0).compressed);
  REQUIRE(m.log.notes.size() == 1);
  CHECK(m.log.notes[0].find("/camera/depth: pictures are of encoding '16UC1'") != std::string::npos);
  CHECK(log_refusal(bag(false, true)) ==
        "a.mcap: has pictures on several topics, one must be chosen: /camera/color/image_raw, /camera/depth, /other");
  CHECK(log_refusal(bag(false, false), {.image = "/camera/depth"}).find("'16UC1'") != std::string::npos);
}

TEST_CASE("packed pictures: WebP is read, a video and depth are refused by name", "[mcap]") {
  const auto packed = [](const std::string& format, const std::vector<std::uint8_t>& data) {
    return foreign_mcap([&](McapWriter<>& w) {
      const auto c = channel_of<RosCompressedImage>(w, "/camera");
      for (int k = 1; k < 4; ++k) w.write(c, std::uint64_t(k), to_cdr(RosCompressedImage{{k, "c"}, format, data}));
    });
  };
  CHECK(log_refusal(packed("h264", {0, 0, 0, 1, 0x65, 7, 7, 7})) ==
        "a.mcap: topic /camera, log time 1 ns: pictures are of format 'h264', read are PNG, JPEG, BMP and WebP of 8 "
        "bits");
  const Image image = view_picture(1);
  const std::vector<std::uint8_t> png = encode_image(".png", image.view());
  CHECK(
      log_refusal(packed("16UC1; compressedDepth png", png)).find("'16UC1; compressedDepth png'") != std::string::npos);
  CHECK(log_refusal(packed("png", {1, 2, 3})).empty());  // damaged: a frame without pixels
  CHECK(log_refusal(packed("", png)).empty());
  // Without loss, and with the header of the lossy form, whose pixels nobody checks here.
  const auto file = std::make_shared<ZstdReader>(reader_of(packed("webp", encode_image(".webp", image.view()))));
  const McapLog m = read_log_file(*file);
  CHECK(m.log.frames.at(0).file == "000000.webp");
  McapCamera camera(file, m.pictures, m.log.frames, ImageDecoder());
  const auto f = camera.next();
  REQUIRE(f);
  CHECK(f->image.width == 5);
  CHECK(f->image.height == 4);
}

TEST_CASE("a bag of several files is one log, and messages may be packed one by one", "[mcap]") {
  const auto part = [](int from, int to, bool zstd) {
    return foreign_mcap([&](McapWriter<>& w) {
      const std::vector<std::uint8_t> grey(2, std::uint8_t(from));
      const auto j = channel_of<RosJointState>(w, "/joint_states"), i = channel_of<RosImage>(w, "/image");
      const auto write = [&](std::uint16_t channel, int k, const std::vector<std::uint8_t>& bytes) {
        w.write(channel, std::uint64_t(k), zstd ? Zstd{}.compress(bytes) : bytes);
      };
      for (int k = from; k < to; ++k) {
        write(j, k, to_cdr(joint_state(k)));
        write(i, k, to_cdr(RosImage{{k, "c"}, 1, 2, "mono8", 0, 2, grey}));
      }
    });
  };
  for (const bool zstd : {false, true}) {
    const McapFiles<Zstd> files = {std::make_shared<ZstdReader>(reader_of(part(1, 5, zstd))),
        std::make_shared<ZstdReader>(reader_of(part(5, 9, zstd)))};
    const McapLog m = read_mcap_log(files);
    REQUIRE(m.log.joints.size() == 8);
    REQUIRE(m.log.frames.size() == 8);
    CHECK(m.log.reading[0].fault.empty());
    CHECK(m.log.frames[7].file == "000007.png");
    McapCamera camera(files, m.pictures, m.log.frames, ImageDecoder());
    for (int k = 1; k < 9; ++k) {
      const auto f = camera.next();
      REQUIRE(f);
      CHECK(f->image.row(0)[0] == (k < 5 ? 1 : 5));
    }
    CHECK(camera.state() == StreamState::ended);
  }
  CHECK_THROWS_AS(read_mcap_log(McapFiles<Zstd>{}), InvalidArgument);
}

TEST_CASE("what is no decoder is none", "[mcap]") {
  STATIC_REQUIRE(PictureDecoder<ImageDecoder>);
  STATIC_REQUIRE_FALSE(PictureDecoder<int>);
  STATIC_REQUIRE_FALSE(RosMessage<RosHeader>);
  STATIC_REQUIRE(Camera<McapCamera<ImageDecoder, Zstd>>);
}
