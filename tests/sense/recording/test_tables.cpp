#include "catch.hpp"

#include "lumo/sense/recording/alignment.hpp"
#include "lumo/sense/recording/log_truth.hpp"
#include "lumo/sense/recording/recording.hpp"
#include "lumo/sense/recording/tables.hpp"
#include "sense/synthetic.hpp"

#include <functional>
#include <limits>
#include <sstream>

using namespace lumo;
using namespace lumo::sense;

namespace {

template <class Read> auto from(const std::string& text, Read read) {
  std::istringstream in(text);
  return read(in, "t.csv");
}

std::string fault_of(const std::function<void()>& f) {
  try {
    f();
  } catch (const InputError& e) {
    return e.what();
  }
  return "no error";
}

const auto joints = [](std::istream& in, const std::string& name) { return read_joint_log(in, name); };
const auto frames = [](std::istream& in, const std::string& name) { return read_frame_log(in, name); };
const auto wrenches = [](std::istream& in, const std::string& name) { return read_wrench_log(in, name); };

}  // namespace

TEST_CASE("tables read back as they were written, to the bit", "[log]") {
  synthetic::Normal normal(2);
  std::vector<JointSample> samples;
  std::vector<FrameRecord> records;
  std::vector<WrenchSample> wrench;
  std::vector<MarkerSample> marker;
  std::vector<PhotodiodeSample> light;
  for (int i = 0; i < 40; ++i) {
    JointVector a(2), b(2), c(2);
    a << normal(), 1e-17 * normal();
    b << -0.0, 1e300;
    c << normal(), 5e-324;
    const std::int64_t t = -5 + i * 1'000'003LL;
    samples.push_back({t, a, b, c, Effort::torque_Nm});
    records.push_back({t, "f" + std::to_string(i) + ".png", 0.001, 64.0});
    wrench.push_back({t, Vec3d(normal(), normal(), normal()), Vec3d(normal(), 0, 1)});
    marker.push_back({t, normal()});
    light.push_back({t, Eigen::VectorXd::Constant(3, normal())});
  }
  const auto s = from(joint_log_text(samples), joints);
  const auto r = from(frame_log_text(records), frames);
  const auto w = from(wrench_log_text(wrench), wrenches);
  const auto m =
      from(marker_log_text(marker), [](std::istream& in, const std::string& n) { return read_marker_log(in, n); });
  const auto l = from(
      photodiode_log_text(light), [](std::istream& in, const std::string& n) { return read_photodiode_log(in, n); });
  REQUIRE(s.size() == 40);
  for (std::size_t i = 0; i < 40; ++i) {
    CHECK((s[i].stamp_ns == samples[i].stamp_ns && s[i].position_rad == samples[i].position_rad &&
           s[i].velocity_rad_per_s == samples[i].velocity_rad_per_s && s[i].effort == samples[i].effort));
    CHECK((r[i].stamp_ns == records[i].stamp_ns && r[i].file == records[i].file && r[i].exposure_s == 0.001 &&
           r[i].gain == 64.0));
    CHECK((w[i].force_N == wrench[i].force_N && w[i].torque_Nm == wrench[i].torque_Nm));
    CHECK(m[i].displacement_m == marker[i].displacement_m);
    CHECK(l[i].signal_V == light[i].signal_V);
  }
  CHECK(s[0].unit == Effort::torque_Nm);
  samples[3].effort[0] = std::numeric_limits<double>::quiet_NaN();
  CHECK_THROWS_AS(joint_log_text(samples), InvalidArgument);
}

TEST_CASE("what a student writes by hand is read: any order, spaces, seconds, other line ends", "[log]") {
  const auto s = from(
      "\xef\xbb\xbf"
      "current_A_0, time_s , velocity_rad_per_s_0,position_rad_0\r\n0.5, 0.001,0,1\r\n 0.6 ,0.002,-1e-1,2\r\n\r\n",
      joints);
  REQUIRE(s.size() == 2);
  CHECK(s[1].stamp_ns == 2'000'000);
  CHECK(s[1].effort[0] == 0.6);
  CHECK(s[1].velocity_rad_per_s[0] == -0.1);
  CHECK(s[0].unit == Effort::current_A);
  CHECK(from("stamp_ns,file\n1,a/b.png", frames).at(0).exposure_s == 0.0);
  CHECK(from("stamp_ns,force_x_N,force_y_N,force_z_N\n1,2,3,4\n", wrenches).at(0).torque_Nm == Vec3d::Zero());
}

TEST_CASE("every fault of a table is one line with file, line and column", "[log]") {
  const auto joint = [](const std::string& t) { return fault_of([&] { from(t, joints); }); };
  const auto frame = [](const std::string& t) { return fault_of([&] { from(t, frames); }); };
  const std::string head = "stamp_ns,position_rad_0,velocity_rad_per_s_0,current_A_0\n";
  CHECK(joint("") == "t.csv: is empty, must begin with a line of column names");
  CHECK(joint("position_rad_0\n") == "t.csv:1: column 'stamp_ns' (or 'time_s') is missing");
  CHECK(joint("stamp_ns,position_rad_0,velocity_rad_per_s_0\n") == "t.csv:1: column 'torque_Nm_0' is missing");
  CHECK(joint("stamp_ns,position_rad_\x1a,velocity_rad_per_s_\x1a\n") == "t.csv:1: column 'torque_Nm_?' is missing");
  CHECK(joint("stamp_ns,position_deg_0\n") == "t.csv:1: column 'position_rad_0' is missing");
  CHECK(joint("stamp_ns,position_rad_0,velocity_rad_per_s_0,current_A_0,note\n") ==
        "t.csv:1: column 'note' is not known");
  CHECK(joint("stamp_ns,position_rad_0,velocity_rad_per_s_0,current_A_0,torque_Nm_0\n") ==
        "t.csv:1: column 'torque_Nm_0' is not known");
  CHECK(joint("stamp_ns,stamp_ns\n") == "t.csv:1: column 'stamp_ns' is there twice");
  CHECK(joint("stamp_ns,,x\n") == "t.csv:1: column 2 has no name");
  CHECK(joint(head + "1,2,3\n") == "t.csv:2: has 3 fields, the header 4");
  CHECK(joint(head + "1,2,3,4\n2,2,x3,4\n") == "t.csv:3: column velocity_rad_per_s_0: 'x3' is no finite number");
  CHECK(joint(head + "1,2,3,nan\n") == "t.csv:2: column current_A_0: 'nan' is no finite number");
  CHECK(joint(head + "1,2,3,1e999\n") == "t.csv:2: column current_A_0: '1e999' is no finite number");
  CHECK(joint(head + "1,2,3,4,\n") == "t.csv:2: has 5 fields, the header 4");
  CHECK(joint(head + "1.5,2,3,4\n") == "t.csv:2: column stamp_ns: '1.5' is no whole number of 64 bits");
  CHECK(joint(head + "99999999999999999999,2,3,4\n") ==
        "t.csv:2: column stamp_ns: '99999999999999999999' is no whole number of 64 bits");
  CHECK(joint(head + "5,2,3,4\n5,2,3,4\n") == "t.csv:3: column stamp_ns: '5' does not exceed the stamp before it");
  CHECK(joint(head + "5,2,3,4\n\n6,2,3,4\n") == "t.csv:3: is empty, only the end of the file may be");
  CHECK(joint(head + "5,\"2\",3,4\n") == "t.csv:2: holds a quote at byte 3, fields are not quoted");
  CHECK(joint(head + std::string("5,2\0,3,4\n", 9)) == "t.csv:2: holds a zero byte, is no text");
  CHECK(joint(head + std::string(100000, '1')) == "t.csv:2: is longer than 65536 bytes");
  CHECK(joint("time_s,position_rad_0,velocity_rad_per_s_0,current_A_0\n1e30,0,0,0\n") ==
        "t.csv:2: column time_s: '1e30' s is beyond the range of stamps");
  CHECK(frame("stamp_ns,file\n1,../x.png\n") == "t.csv:2: column file: '../x.png' is no path below frames/");
  CHECK(frame("stamp_ns,file\n1,/etc/x\n") == "t.csv:2: column file: '/etc/x' is no path below frames/");
  CHECK(frame("stamp_ns,file,exposure_s\n1,a.png,-1\n") == "t.csv:2: column exposure_s: '-1' s is negative");
  CHECK(frame("stamp_ns,file,gain\n1,a.png,x\n") == "t.csv:2: column gain: 'x' is no finite number");
  CHECK(frame("stamp_ns,file\n1,a\x01.png\n") == "t.csv:2: column file: 'a?.png' is no path below frames/");
  CHECK(fault_of([] { open_text("/nonexistent/joint.csv"); }) == "/nonexistent/joint.csv: cannot be opened");
}

TEST_CASE("clocks: offset and drift are found again, the residual is the jitter", "[log]") {
  synthetic::Normal normal(8);
  std::vector<std::int64_t> a, b;
  const std::int64_t base = 1'700'000'000'000'000'000;  // as a wall clock's: doubles alone would lose 128 ns
  for (int i = 0; i < 500; ++i) {
    const std::int64_t t = base + i * 100'000'000LL;
    a.push_back(t);
    b.push_back(t - base + 3'000'000 + std::llround(20e-6 * double(t - base) + 50e3 * normal()));
  }
  const ClockMap map = ClockMap::fit(a, b);
  CHECK(map.drift == Approx(20e-6).epsilon(0.05));
  CHECK(map.residual_s == Approx(50e-6).epsilon(0.1));
  CHECK(std::abs(map(base + 10'000'000'000) - (10'000'000'000 + 3'000'000 + 200'000)) < 20'000);
  const std::vector<std::int64_t> x{100}, y{250};
  CHECK(ClockMap::fit(x, y)(1000) == 1150);
  CHECK_THROWS_AS(ClockMap::fit(a, x), InvalidArgument);
}

TEST_CASE("interpolation is exact on lines, silent in gaps, and its residual is that of the noise", "[log]") {
  Eigen::MatrixXd value(1, 4);
  value << 0.0, 10.0, 20.0, 100.0;
  const TimeSeries line({0, 10, 20, 100}, value);
  CHECK(line.at(13, 1.0)->coeff(0) == Approx(13.0));
  CHECK(line.at(20, 1e-9)->coeff(0) == 20.0);
  CHECK_FALSE(line.at(50, 50e-9));
  CHECK_FALSE(line.at(-1, 1.0));
  CHECK_FALSE(line.at(101, 1.0));
  CHECK(line.interpolation_residual()[0] == Approx(0.0).margin(1e-12));
  CHECK(line.largest_gap_s() == Approx(80e-9));
  synthetic::Normal normal(5);
  std::vector<std::int64_t> stamp;
  Eigen::MatrixXd noise(1, 20000);
  for (int i = 0; i < 20000; ++i) {
    stamp.push_back(i);
    noise(0, i) = 0.3 * normal();
  }
  CHECK(TimeSeries(stamp, noise).interpolation_residual()[0] == Approx(std::sqrt(1.5) * 0.3).epsilon(0.02));
  CHECK_THROWS_AS(TimeSeries({0, 0}, Eigen::MatrixXd::Zero(1, 2)), InvalidArgument);
}

TEST_CASE("damaged tables are read or refused in one line, never worse", "[log]") {
  const std::string good =
      "stamp_ns,position_rad_0,velocity_rad_per_s_0,current_A_0\n1,0.5,-1e-3,2\n2,0.25,0,3.5\n900,1,1,1\n";
  synthetic::Normal draw(3);
  int read = 0, refused = 0;
  for (int k = 0; k < 20000; ++k) {
    std::string bad = good;
    for (int n = 1 + int(4.0 * draw.uniform()); n > 0; --n) {
      const auto at = std::size_t(draw.uniform() * double(bad.size()));
      switch (int(4.0 * draw.uniform())) {
        case 0: bad[at] = char(256.0 * draw.uniform()); break;
        case 1: bad.erase(at, std::size_t(8.0 * draw.uniform())); break;
        case 2: bad.insert(at, bad.substr(std::size_t(draw.uniform() * double(bad.size())), 9)); break;
        default: bad.insert(at, 1, ",\n\r-e.9"[int(7.0 * draw.uniform())]);
      }
      if (bad.empty()) bad = "x";
    }
    try {
      for (const JointSample& s : from(bad, joints))
        REQUIRE((s.effort.allFinite() && s.position_rad.allFinite() && s.velocity_rad_per_s.allFinite()));
      ++read;
    } catch (const InputError& e) {
      REQUIRE(std::string(e.what()).find('\n') == std::string::npos);
      ++refused;
    }
  }
  CHECK(read > 200);
  CHECK(refused > 5000);
}

TEST_CASE("stamps at the ends of 64 bits overflow nothing", "[log]") {
  const std::int64_t limit = stamp_limit_ns;
  for (const std::int64_t from : {-limit, std::int64_t(0), limit})
    for (const double offset : {-1e300, -4e9, 0.0, 4e9, 1e300}) {
      const ClockMap map{-from, offset, 0.1, 0.0};
      CHECK(map(from) >= -limit);
      CHECK(map(from) <= limit);
    }
  CHECK(ClockMap{limit - 5, 0.25, 0.0, 0.0}(limit - 1'000'000'000) == limit - 750'000'000);
  std::istringstream far("stamp_ns,displacement_m\n9223372036854775807,0\n");
  CHECK_THROWS_WITH(read_marker_log(far, "m.csv"),
      Catch::Contains("m.csv:2: column stamp_ns") && Catch::Contains("beyond the range"));
  CHECK_THROWS_AS(marker_log_text({{std::numeric_limits<std::int64_t>::min(), 0.0}}), InvalidArgument);
  CHECK_THROWS_AS(marker_log_text({{5, 0.0}, {5, 0.1}}), InvalidArgument);
  CHECK_THROWS_AS(
      TimeSeries({0, std::numeric_limits<std::int64_t>::max()}, Eigen::MatrixXd::Zero(1, 2)), InvalidArgument);
}

TEST_CASE(
    "normal force over time: positive where the finger is pressed, tared, on the clock that is asked for", "[log]") {
  // The sensor's clock is 2 s behind and runs 1e-6 too slow; it reads 0.5 N too much, and the object presses with 3 N
  // at 1 s.
  Session session;
  session.wrench_clock = {0, 2.0, 1e-6, 0.0};
  std::vector<WrenchSample> samples;
  for (int k = 0; k <= 40; ++k) {
    const std::int64_t t = k * 50'000'000LL;
    if (k != 30)
      samples.push_back({t, Vec3d(9.0, -7.0, -(0.5 + (k == 20 ? 3.0 : 0.0))), Vec3d(1, 2, 3)});  // one is lost
  }
  const TimeSeries raw = normal_force(samples);
  CHECK((*raw.at(1'000'000'000, 0.1))[0] == 3.5);
  CHECK((*raw.at(975'000'000, 0.1))[0] == Approx(2.0));
  CHECK((*normal_force(samples, session.wrench_clock, 0.5).at(session.wrench_clock(1'000'000'000), 0.1))[0] == 3.0);

  const auto second = [&](double s) { return session.wrench_clock(std::int64_t(1e9 * s)); };
  session.segments = {{second(0.0), second(0.5), SegmentKind::unloaded},
      {second(0.9), second(1.1), SegmentKind::hold, 1, -15.0, 0},
      {second(1.8), second(3.0), SegmentKind::hold, 2, -5.0, 0}};
  session.segments.back().load_N = 4.0;
  const LogTruth truth = LogTruth::from_log(session, samples);
  CHECK(*truth.at(second(1.0)).force_N == Approx(3.0));
  CHECK(*truth.at(second(1.0)).y_m == Approx(-15e-3));
  CHECK(*truth.at(second(0.975)).force_N ==
        Approx(1.5).epsilon(1e-3));  // halfway up; the clock is off by 1 µs within a second
  CHECK_FALSE(truth.at(second(0.6)).y_m);
  CHECK(*truth.at(second(0.6)).force_N == Approx(0.0).margin(1e-12));
  CHECK_FALSE(truth.at(second(1.48)).force_N);   // where a sample is lost
  CHECK(*truth.at(second(2.5)).force_N == 4.0);  // after the sensor's end: as the segment says
  CHECK_FALSE(truth.at(second(3.5)).force_N);

  session.wrench_clock.drift = -0.1;
  CHECK_THROWS_AS(LogTruth::from_log(session, {{0}, {1}, {2}, {3}, {4}, {5}, {6}}),
      InvalidArgument);  // two of them come to the same nanosecond
}

TEST_CASE("joints of a table have numbers or names, and are taken by them", "[log]") {
  const auto read = [](const std::string& text, const std::vector<std::string>& wanted = {},
                        StreamReading* reading = nullptr) {
    std::istringstream in(text);
    return read_joint_table(in, "t.csv", reading, wanted);
  };
  const std::string alphabetical =
      "time_s,position_rad_distal,torque_Nm_distal,position_rad_palm,torque_Nm_palm,position_rad_wrist,current_A_"
      "wrist\n"
      "0,1,2,3,4,nan,\n0.1,5,6,7,8,nan,\n";
  const JointTable chain = read(alphabetical, {"palm", "distal"});
  CHECK(chain.names == std::vector<std::string>{"palm", "distal"});
  REQUIRE(chain.samples.size() == 2);
  CHECK(chain.samples[0].position_rad == Eigen::Vector2d(3, 1));
  CHECK(chain.samples[1].effort == Eigen::Vector2d(8, 6));
  CHECK(read(joint_log_text(chain.samples, chain.names)).names == chain.names);
  CHECK(fault_of([&] {
    read(alphabetical, {"palm", "toe"});
  }) == "t.csv:1: has no joint 'toe', but distal, palm, wrist");
  CHECK(fault_of([&] { read(alphabetical, {"wrist"}); }) ==
        "t.csv:2: column position_rad_wrist: 'nan' is no finite number");
  CHECK(fault_of([&] { read(alphabetical); }) == "t.csv:1: column 'torque_Nm_wrist' is missing");
  const std::string numbers = "time_s,position_rad_0,torque_Nm_0,position_rad_1,torque_Nm_1\n0,1,2,3,4\n";
  CHECK(read(numbers, {"palm", "distal"}).names == std::vector<std::string>{"palm", "distal"});
  CHECK(read(numbers, {"palm", "distal"}).samples[0].effort == Eigen::Vector2d(2, 4));
  CHECK(read(numbers, {"1"}).samples[0].effort == Eigen::VectorXd::Constant(1, 4.0));
  CHECK(fault_of([&] { read(numbers, {"palm"}); }) == "t.csv:1: has 2 joints by numbers, chosen by name are 1, palm");
  CHECK_THROWS_AS(joint_log_text(chain.samples, {"a,b", "c"}), InvalidArgument);
  CHECK_THROWS_AS(joint_log_text(chain.samples, {"a"}), InvalidArgument);
}

TEST_CASE("rows of joints without a number are left out, velocities without one follow from the positions", "[log]") {
  const auto table = [](int each) {
    std::string text = "time_s,position_rad_0,velocity_rad_per_s_0,current_A_0\n";
    for (int k = 0; k < 100; ++k)
      text += std::to_string(0.01 * k) + ',' + std::to_string(0.02 * k) + (k % 2 == 0 ? ",NaN," : ",2,") +
              (k % each == 1 ? "nan\n" : "1\n");
    return text;
  };
  const auto read = [](const std::string& text, StreamReading& reading) {
    std::istringstream in(text);
    return read_joint_log(in, "t.csv", &reading);
  };
  StreamReading reading;
  const auto list = read(table(50), reading);
  REQUIRE(list.size() == 98);
  CHECK(reading.rows == 100);
  CHECK(reading.incomplete == 2);
  for (const JointSample& s : list) CHECK(s.velocity_rad_per_s[0] == Approx(2.0));
  CHECK(fault_of([&] { read(table(10), reading); }) ==
        "t.csv:3: column current_A_0: 'nan' is no finite number, as are some of 10 of 100 rows, at most 5 % are left "
        "out");
}

TEST_CASE("tables as spreadsheets write them", "[log]") {
  const std::string plain = "time_s,position_rad_0,velocity_rad_per_s_0,current_A_0\n0.5,1.25,-0.5,1e-3\n1.5,2,0,3\n";
  const auto wanted = joint_log_text(from(plain, joints));
  const std::string german =
      "\xef\xbb\xbftime_s;position_rad_0;velocity_rad_per_s_0;current_A_0\r\n0,5;1,25;-0,5;1e-3\r\n1,5;2;0;3\r\n";
  CHECK(joint_log_text(from(german, joints)) == wanted);
  CHECK(joint_log_text(from("sep=;\n" + german.substr(3), joints)) == wanted);
  CHECK(joint_log_text(from("time_s;position_rad_0;velocity_rad_per_s_0;current_A_0\n0.5;1.25;-0.5;1e-3\n1.5;2;0;3\n",
            joints)) == wanted);
  CHECK(
      joint_log_text(from("time_s\tposition_rad_0\tvelocity_rad_per_s_0\tcurrent_A_0\n0,5\t1,25\t-0,5\t1e-3\n1,5\t2\t0"
                          "\t3\n",
          joints)) == wanted);
  const auto refused = [](const std::string& text) { return fault_of([&] { from(text, wrenches); }); };
  CHECK(refused("time_s;force_x_N;force_y_N;force_z_N\n1;1.234,5;0;0\n") ==
        "t.csv:2: column force_x_N: '1.234,5' is no finite number");
  CHECK(refused("stamp_ns;force_x_N;force_y_N;force_z_N\n1,79E+18;1;0;0\n") ==
        "t.csv:2: column stamp_ns: '1,79E+18' is no whole number of 64 bits");
  CHECK(refused(std::string("\xff\xfet\0i\0", 6)) == "t.csv:1: holds a zero byte, is UTF-16 and not UTF-8");
}

TEST_CASE("rows whose stamps do not ascend are left out and counted, up to a share", "[log]") {
  std::string text = "stamp_ns,force_x_N,force_y_N,force_z_N\n";
  for (int k = 0; k < 50; ++k) text += std::to_string(10 * k) + ",0,0," + std::to_string(k) + '\n';
  const std::string twice = text + "490,0,0,50\n";
  const auto read = [](const std::string& table, StreamReading& r) {
    return from(table, [&](std::istream& in, const std::string& name) { return read_wrench_log(in, name, &r); });
  };
  StreamReading r;
  CHECK(wrench_log_text(read(twice, r)) == wrench_log_text(from(text, wrenches)));
  CHECK(r == StreamReading{"", 51, 1, 0});
  CHECK(wrench_log_text(read(text, r)) == wrench_log_text(from(text, wrenches)));
  CHECK(r == StreamReading{"", 50, 0, 0});
  CHECK(fault_of([&] { from(twice, wrenches); }) ==
        "t.csv:52: column stamp_ns: '490' does not exceed the stamp before it");
  CHECK(fault_of([&] { read(twice + "1,0,0,0\n2,0,0,0\n3,0,0,0\n", r); }) ==
        "t.csv:52: column stamp_ns does not exceed the stamp before it, and so do 4 of 54 rows, at most 5 % are left "
        "out");
}

TEST_CASE("a table without velocities gives them by the positions", "[log]") {
  std::string text = "time_s,position_rad_0,torque_Nm_0\n";
  for (int k = 0; k < 30; ++k) text += "0." + std::to_string(100 + k) + ',' + std::to_string(0.002 * k) + ",1\n";
  for (const JointSample& s : from(text, joints)) CHECK(s.velocity_rad_per_s[0] == Approx(2.0));
  CHECK(fault_of([] {
    from("time_s,position_rad_0,velocity_rad_per_s_0,torque_Nm_0,position_rad_1,torque_Nm_1\n", joints);
  }) == "t.csv:1: column 'velocity_rad_per_s_1' is missing");
}

TEST_CASE("a log's table that cannot be read is a fault of its stream alone", "[log]") {
  const Recording good;
  CHECK_NOTHROW(require_readable(good));
  Recording bad;
  bad.reading[std::size_t(LogStream::wrenches)].fault = "wrench.csv:1: is empty";
  CHECK_NOTHROW(require_readable(bad, LogStream::joints));
  CHECK_THROWS_WITH(require_readable(bad), "wrench.csv:1: is empty");
}

TEST_CASE("a stream's period is the mean, and a pause does not make it longer", "[log]") {
  std::vector<MarkerSample> even, paused;
  for (int k = 0; k < 101; ++k) even.push_back({1'000'000LL * k + (k % 2) * 50'000, 0.0});
  CHECK(stream_period_s(even) == 1e-9 * double(even.back().stamp_ns - even.front().stamp_ns) / 100.0);
  for (int k = 0; k < 101; ++k) paused.push_back({1'000'000LL * k + (k > 50 ? 3'000'000'000 : 0), 0.0});
  CHECK(stream_period_s(paused) == Approx(1e-3));
}

TEST_CASE("a stretch of time is written in seconds", "[log]") {
  CHECK(to_string(Stretch{12'500'000'000, 1'790'000'000'000'000'001}) == "12.500 to 1790000000.000 s");
  CHECK(to_string(Stretch{-500'000'000, 0}) == "-0.500 to 0.000 s");
  CHECK(to_string(Stretch{-1'002'000'000, 7'000'000}) == "-1.002 to 0.007 s");
  CHECK(Stretch{0, 10}.meets({10, 20}));
  CHECK_FALSE(Stretch{0, 10}.meets({11, 20}));
  CHECK_FALSE(Stretch::of(std::vector<MarkerSample>{}));
}
