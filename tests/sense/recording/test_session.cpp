#include "catch.hpp"

#include "german_locale.hpp"
#include "lumo/support/json.hpp"
#include "sense/synthetic.hpp"
#include "temporary_folder.hpp"

#include <filesystem>
#include <sstream>

using namespace lumo;
using namespace lumo::sense;

namespace {

std::string fault_of(const std::string& json) {
  try {
    session_from_json(json, "s.json");
  } catch (const InputError& e) {
    return e.what();
  }
  return "no error";
}

const std::string head = R"({"format": "lumo-log", "version": 1)";

}  // namespace

TEST_CASE("a session reads back as it was written", "[session]") {
  Session s;
  s.title = "first light \"quoted\" µ";
  s.theta_mm = {5, 10, 10, 6, 3};
  s.video = "video.avi";
  s.distal = {0.0, -1.0};
  s.joint_to_origin_m = 0.0475;
  s.torque_constant_Nm_per_A = {0.91, 0.88};
  s.joint_clock = {1'700'000'000'000'000'001, -0.25, 2e-5, 1e-4};
  s.segments = {
      {1, 9'007'199'254'740'993, SegmentKind::hold, 3, 5.0, 1, -1, 10.0, -30.0, 10.0}, {5, 6, SegmentKind::unloaded}};
  s.segments.push_back({7, 8});
  s.segments.back().set_kind_name("slide");  // a kind of the recording's own keeps its name
  SessionLink link;
  link.link.name = "left \"distal\"";
  link.link.joints = {0, 1};
  link.link.z_clockwise = true;
  link.link.hole_radius_m = 0.0018;
  link.link.hole_m = Eigen::Matrix2Xd(2, 3);
  link.hole_px = Eigen::Matrix2Xd(2, 3);
  link.link.hole_m << -0.022, 0.022, 0.0, -0.004, -0.004, -0.0055;
  link.hole_px << 101, 180.5, 140, 60, 62, 75;
  s.links = {link, link};
  const Session r = session_from_json(to_json(s), "s.json");
  REQUIRE(r.links.size() == 2);
  CHECK(r.links[1].link.name == link.link.name);
  CHECK(r.links[1].link.joints == link.link.joints);
  CHECK(r.links[1].link.z_clockwise);
  CHECK(r.links[1].link.hole_m == link.link.hole_m);
  CHECK(r.links[1].hole_px == link.hole_px);
  CHECK(r.title == s.title);
  CHECK(r.theta_mm == s.theta_mm);
  CHECK(r.video == s.video);
  CHECK(r.distal == s.distal);
  CHECK(r.joint_to_origin_m == Approx(s.joint_to_origin_m).epsilon(1e-15));
  CHECK(r.torque_constant_Nm_per_A == s.torque_constant_Nm_per_A);
  CHECK(r.joint_clock == s.joint_clock);
  CHECK(r.segments == s.segments);
  CHECK(to_json(r) == to_json(s));
  CHECK(session_from_json(head + "}", "s.json").led_count == 5);  // the least there is
}

TEST_CASE("every fault of a session is one line that names file and key", "[session]") {
  CHECK(fault_of("{").starts_with("s.json: is no JSON: "));
  CHECK(fault_of("[]") == "s.json: must be an object");
  CHECK(fault_of("{}") == "s.json.format: must be \"lumo-log\"");
  CHECK(fault_of(R"({"format": "lumo-log", "version": 2})") == "s.json.version: must be 1");
  CHECK(fault_of(head + R"(, "tittle": ""})") == "s.json: key 'tittle' is not known, the nearest is 'title'");
  CHECK(fault_of(head + R"(, "leds": {"pitch": 11}})") ==
        "s.json.leds: key 'pitch' is not known, the nearest is 'pitch_mm'");
  CHECK(fault_of(head + R"(, "leds": {"pitch_mm": "11 mm"}})") == "s.json.leds.pitch_mm: must be a finite number");
  CHECK(fault_of(head + R"(, "leds": {"pitch_mm": -1}})") == "s.json: led pitch is -1 mm, must lie in (0, 1000) mm");
  CHECK(fault_of(head + R"(, "leds": {"depth_mm": -1}})") ==
        "s.json: depth of the LEDs is -1 mm, must lie in [0, 1000] mm");
  CHECK(fault_of(head + R"(, "leds": {"camera_distance_mm": 5}})")
            .starts_with("s.json: distance of the camera is 5 mm, must lie in [10, 100000] mm"));
  CHECK(fault_of(head + R"(, "leds": {"depth_mm": 900, "camera_distance_mm": 20}})")
            .starts_with("s.json: LEDs lie 900 mm deep before a camera at 20 mm"));
  CHECK(fault_of(head + R"(, "joint_to_joint_mm": [0]})") ==
        "s.json: way from joint to joint is 0 mm, must lie in (0, 10000] mm");
  CHECK(fault_of(head + R"(, "leds": {"distal": [1]}})") == "s.json.leds.distal: must be two numbers");
  const std::string holes = R"("joints": [0], "holes_mm": [-22, -4, 22, -4], "holes_px": [10, 20, 90, 20])";
  CHECK(fault_of(head + R"(, "links": [{}]})") == "s.json: link 0: link '': no joint moves it, at least one must");
  CHECK(fault_of(head + R"(, "links": [{"joints": [0.5]}]})") == "s.json.links[0].joints: must be whole numbers");
  CHECK(fault_of(head + R"(, "links": [{"joints": [0], "holes_mm": [1, 2, 3]}]})") ==
        "s.json.links[0].holes_mm: must be pairs y, z");
  CHECK(fault_of(head + R"(, "links": [{"joints": [0], "holes_mm": [1, 2, 3, 4]}]})") ==
        "s.json: link 0: has 2 holes and 0 places of them in the picture, must have as many");
  CHECK(fault_of(head + R"(, "links": [{)" + holes + R"(, "z_clockwise": 1}]})") ==
        "s.json.links[0].z_clockwise: must be true or false");
  CHECK(fault_of(head + R"(, "links": [{)" + holes + R"(, "pad_y_mm": [5, 4]}]})") ==
        "s.json: link 0: length of a link's pad is -1 mm, must lie in [1, 10000] mm");
  CHECK(fault_of(head + R"(, "segments": [{"place": 1.5}]})") ==
        "s.json.segments[0].place: must be a whole number within 1e9");
  CHECK(fault_of(head + R"(, "segments": [{}, {"from_ns": 18446744073709551615}]})") ==
        "s.json.segments[1].from_ns: must be a whole number of 64 bits");
  CHECK(fault_of(head + R"(, "segments": [{"from_ns": 5, "to_ns": 4}]})") ==
        "s.json: segment 0 ends at 4 ns, before it begins at 5 ns");
  CHECK(fault_of(head + R"(, "torque_constant_Nm_per_A": []})") == "s.json: has 0 torque constants, must have 1 to 8");
  CHECK(fault_of(head + R"(, "video": "../x"})") == "s.json: video must be a file name beside session.json");
  CHECK(fault_of(head + R"(, "title": 1e999})").starts_with("s.json: is no JSON"));
  CHECK(fault_of(std::string(100000, '[')) == "s.json: is nested deeper than 64 levels");
  CHECK(fault_of(head + R"(, "title": ")" + "\xff" + "\"}").starts_with("s.json: is no JSON"));
  CHECK(fault_of(head + R"(, "title": "a", "title": "b"})") == "s.json: has the key 'title' twice");
  CHECK(fault_of(head + R"(, "leds": {"count": 5, "count": 6}})") == "s.json: has the key 'count' twice");
  CHECK_THROWS_AS(read_session("/nonexistent/session.json"), InputError);
  CHECK_THROWS_WITH(read_session("/proc/self/mem"), Catch::Contains("cannot be read: Input/output error"));
}

TEST_CASE("numbers do not wrap, and brackets in a text are text", "[session]") {
  CHECK(fault_of(head + R"(, "segments": [{"place": 18446744073709551612}]})") ==
        "s.json.segments[0].place: must be a whole number within 1e9");
  CHECK(session_from_json(head + R"(, "title": ")" + std::string(65, '[') + "\"}", "s.json").title.size() == 65);
  CHECK(
      fault_of(head +
               R"(, "title": "]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]\\" , "theta_mm": )" +
               std::string(70, '[')) == "s.json: is nested deeper than 64 levels");
  CHECK(
      fault_of(head + R"(, "joint_clock": {"offset_s": 1e300}})").starts_with("s.json: offset of a clock is 1e+300 s"));
  CHECK(fault_of(head + R"(, "joint_clock": {"drift": -2}})").starts_with("s.json: drift of a clock"));
  CHECK(fault_of(head + R"(, "torque_constant_Nm_per_A": [0]})").starts_with("s.json: torque constant is 0"));
  CHECK(fault_of(head + R"(, "joint_delay_s": 1e9})").starts_with("s.json: delay is"));
  CHECK(fault_of(head + R"(, "segments": [{"from_ns": -9000000000000000000}]})")
            .starts_with("s.json: stamp -9000000000000000000 ns"));
}

TEST_CASE("what is written can be read: lengths keep their bits, and what could not be read is refused", "[session]") {
  synthetic::Normal draw(3);
  for (int k = 0; k < 2000; ++k) {
    std::ostringstream json;
    json.precision(2 + k % 15);
    json << head << ", \"joint_to_origin_mm\": " << 200.0 * draw.uniform()
         << ", \"leds\": {\"pitch_mm\": " << 1.0 + 30.0 * draw.uniform() << "}}";
    const Session s = session_from_json(json.str(), "s.json"), r = session_from_json(to_json(s), "s.json");
    REQUIRE(r.joint_to_origin_m == s.joint_to_origin_m);
    REQUIRE(r.led_pitch_m == s.led_pitch_m);
  }
  Session s;
  s.title = "\xff";
  CHECK_THROWS_AS(to_json(s), InputError);
  s = {};
  s.segments = {{1, 2}};
  s.segments[0].load_N = std::nan("");
  CHECK_THROWS_AS(to_json(s), InputError);
}

TEST_CASE("a log folder reads back as it was written", "[session]") {
  const TemporaryFolder folder;
  const std::string name = folder.path.string();
  Recording log;
  log.path = name;
  log.session.title = "two frames";
  log.frames = {{1, "a.png", 0.001, 64.0}, {2, "b.png", 0.001, 64.0}};
  log.joints = {{5, JointVector::Zero(1), JointVector::Zero(1), JointVector::Constant(1, 0.5), Effort::current_A}};
  log.wrenches = {{7, Vec3d(0, 0, -2), Vec3d::Zero()}};
  write_log_folder(log);
  const Recording r = read_log_folder(name);
  CHECK(r.session.title == "two frames");
  CHECK(r.frames.size() == 2);
  CHECK(r.frames[1].file == "b.png");
  CHECK(r.joints.at(0).effort[0] == 0.5);
  CHECK(r.wrenches.at(0).force_N.z() == -2.0);
  CHECK(r.markers.empty());
  log.photodiodes = {{3, Eigen::Vector3d(0.5, 0.25, 1.0)}};
  log.wrenches.clear();
  write_log_folder(log);
  const Recording again = read_log_folder(name);
  CHECK(again.photodiodes.at(0).signal_V == Eigen::Vector3d(0.5, 0.25, 1.0));
  CHECK(again.wrenches.empty());  // the earlier table is gone
  Recording bad = log;
  bad.frames[1].file = "b,c.png";
  CHECK_THROWS_AS(write_log_folder(bad), InvalidArgument);
  bad = log;
  bad.frames[1].stamp_ns = bad.frames[0].stamp_ns;
  CHECK_THROWS_AS(write_log_folder(bad), InvalidArgument);
  CHECK(read_log_folder(name).frames.size() == 2);  // and what was there still is
  log.session.torque_constant_Nm_per_A = {1.0, 1.0};
  write_log_folder(log);
  CHECK_THROWS_AS(read_log_folder(name), InputError);  // one joint, two constants
  log.joints[0].unit = Effort::torque_Nm;
  write_log_folder(log);
  CHECK(read_log_folder(name).joints.size() == 1);  // torques need none
  log.path = name + "/none";
  CHECK_THROWS_AS(write_log_folder(log), InputError);
  CHECK_THROWS_AS(read_log_folder(log.path), InputError);
}

TEST_CASE("a log folder has the same bytes under a German locale, and reads back there", "[session]") {
  const TemporaryFolder folder;
  Recording log;
  for (const char* name : {"plain", "german"}) std::filesystem::create_directory(folder.path / name);
  log.path = folder / "plain";
  log.session.title = "one frame";
  log.session.torque_constant_Nm_per_A = {1.25};
  log.frames = {{1234567, "a.png", 0.001, 1064.5}};
  log.joints = {{5, JointVector::Zero(1), JointVector::Zero(1), JointVector::Constant(1, 0.5), Effort::current_A}};
  write_log_folder(log);
  const GermanLocale german;
  log.path = folder / "german";
  write_log_folder(log);
  for (const char* name : {"session.json", "frames.csv", "joint.csv"}) {
    CHECK(folder.read(std::string("german/") + name) == folder.read(std::string("plain/") + name));
    CHECK_FALSE(folder.read(std::string("german/") + name).empty());
  }
  const Recording r = read_log_folder(log.path);
  CHECK(r.session.torque_constant_Nm_per_A == std::vector<double>{1.25});
  CHECK(r.frames.at(0).gain == 1064.5);
  CHECK(r.joints.at(0).effort[0] == 0.5);
}

TEST_CASE("damaged sessions are read or refused in one line, never worse", "[session]") {
  Session s;
  s.segments = {{1, 2, SegmentKind::hold, 3, 5.0, 1, -1, 10.0, -30.0, 10.0}};
  const std::string good = to_json(s);
  synthetic::Normal draw(5);
  int refused = 0;
  for (int k = 0; k < 5000; ++k) {
    std::string bad = good;
    for (int n = 1 + int(3.0 * draw.uniform()); n > 0; --n) {
      const auto at = std::size_t(draw.uniform() * double(bad.size()));
      if (draw.uniform() < 0.5) bad[at] = char(256.0 * draw.uniform());
      else bad.erase(at, std::size_t(6.0 * draw.uniform()));
    }
    const std::string what = fault_of(bad);
    REQUIRE(what.find('\n') == std::string::npos);
    refused += what != "no error";
  }
  CHECK(refused > 3000);
}
