// Time from a decoded image to place and force, one thread: median, 95 % and 99 %.
//   lumo_sense_latency [frames]
// The finger fills the picture as it would in use: its band is four fifths of the width and a third of the height.
// Frames reach the estimator 20 ms after they were taken, so that 20 torque samples are filtered again for each. "whole
// step" takes a frame and the 33 torque samples that came with it; "readout" is the picture's part of it. Pictures
// rotate through more memory than the caches hold.

#include "lumo/core/sobol.hpp"
#include "lumo/core/statistics.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/force/force_estimator.hpp"
#include "lumo/sense/localize/bayes_localizer.hpp"
#include "lumo/sense/localize/peak_localizer.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

using namespace lumo;
using namespace lumo::sense;

namespace {

constexpr std::int64_t ms = 1'000'000;

double noise(std::uint64_t i) {  // sum of four uniforms, variance 1
  double sum = -2.0;
  for (std::uint64_t k = 0; k < 4; ++k) sum += double(combine(i, k) >> 11) * 0x1p-53;
  return sum * std::sqrt(3.0);
}

/// Streams that hold what the main loop puts into them.
struct FedCamera {
  std::deque<Frame> queue;
  std::optional<Frame> next() {
    if (queue.empty()) return std::nullopt;
    const Frame f = queue.front();
    queue.pop_front();
    return f;
  }
  StreamState state() const { return StreamState::open; }
};
struct FedActuator {
  std::deque<JointSample> queue;
  std::optional<JointSample> next() {
    if (queue.empty()) return std::nullopt;
    const JointSample s = queue.front();
    queue.pop_front();
    return s;
  }
  StreamState state() const { return StreamState::open; }
};

struct Setup {
  int width, height;
  AxisMap map;
  std::vector<Image> touched, untouched;

  Setup(int w, int h) : width(w), height(h) {
    const double px_per_m = 0.8 * w / 0.055, pitch = 3.0 / 180.0 * pi;  // a camera that is three degrees askew
    map.origin_px = {0.5 * w, 0.5 * h};
    map.direction = {std::cos(pitch), std::sin(pitch)};
    map.half_length_px = 0.022 * px_per_m;
    map.coefficients = {0.0, 22.0_mm, 0.0};
    for (int k = 0; k < 24; ++k)
      for (const bool contact : {false, true}) {
        Image image = Image::black(w, h);
        for (int y = 0; y < h; ++y)
          for (int x = 0; x < w; ++x) {
            const double at = map.y_m(map.u_px(Eigen::Vector2d(x, y)));
            const double light =
                90.0 + 500.0 * at + (contact ? 12.0 * std::exp(-0.5 * std::pow((at - 8e-3) / 4e-3, 2)) : 0.0);
            for (int c = 0; c < 3; ++c)
              image.row(y)[3 * x + c] = std::uint8_t(std::clamp(
                  light + 2.5 * noise(std::uint64_t(k) << 40 | std::uint64_t(y) << 20 | std::uint64_t(x)), 0.0, 255.0));
          }
        (contact ? touched : untouched).push_back(std::move(image));
      }
  }
  GreenProfile readout() const {
    return GreenProfile({map, LongitudinalBins::uniform(-27.5_mm, 27.5_mm, 55),
        -0.165 * height * map.scale_m_per_px(0.0), 0.165 * height * map.scale_m_per_px(0.0), width, height});
  }
};

void print(const char* what, const std::vector<double>& microseconds) {
  std::printf("  %-34s p50 %7.1f  p95 %7.1f  p99 %7.1f us\n", what, quantile(microseconds, 0.5),
      quantile(microseconds, 0.95), quantile(microseconds, 0.99));
}

template <class Localizer, class Make> void run(const Setup& setup, const char* what, int frames, Make make) {
  using clock = std::chrono::steady_clock;
  GreenProfile readout = setup.readout();
  UnloadedReference reference;
  Profile p;
  for (const Image& i : setup.untouched) {
    readout.read(Frame{i.view()}, p);
    reference.add(p);
  }
  FedCamera camera;
  FedActuator actuator;
  using Estimator = ForceEstimator<FedCamera, FedActuator, Localizer>;
  Estimator estimator(camera, actuator, {readout, reference}, make(readout.positions_m(), reference), MomentArm{0.05},
      typename Estimator::Config{});
  std::vector<double> whole, reading;
  ForceEstimate e;
  for (int k = 0; k < frames; ++k) {
    const std::int64_t now = std::int64_t(k) * 33 * ms + 20 * ms;
    for (int j = 0; j < 33; ++j) {
      const std::int64_t t = now - (32 - j) * ms;
      const double torque = (k > 30 ? 9.0 * 0.058 : 0.0) + 0.01 * noise(std::uint64_t(t));
      actuator.queue.push_back({t, JointVector::Zero(1), JointVector::Constant(1, 0.001 * noise(std::uint64_t(t) + 1)),
          JointVector::Constant(1, torque)});
    }
    const auto& pictures = k > 30 ? setup.touched : setup.untouched;
    const Frame frame{pictures[std::size_t(k) % pictures.size()].view(), now - 20 * ms};
    const auto a = clock::now();
    readout.read(frame, p);
    const auto b = clock::now();
    camera.queue.push_back(
        {pictures[std::size_t(k + 12) % pictures.size()].view(), now - 20 * ms});  // another one than was just read
    const auto c = clock::now();
    e = estimator.step(now);
    const auto d = clock::now();
    if (k < 60) continue;
    reading.push_back(1e6 * std::chrono::duration<double>(b - a).count());
    whole.push_back(1e6 * std::chrono::duration<double>(d - c).count());
  }
  std::printf(" %s: y = %.2f mm, F = %.2f N, %s\n", what, 1e3 * e.contact[0].y_m.value_or(0.0),
      e.contact[0].force_N.value_or(0.0), to_string(e.state));
  print("readout", reading);
  print("whole step (frame + 33 samples)", whole);
}

/// Thirty pictures a second, stamped as they come, and a thousand torque samples, read by a loop that wakes once a
/// millisecond as a controller's does: from a picture's stamp to the first estimate that contains it.
void paced(const Setup& setup, int frames) {
  using clock = std::chrono::steady_clock;
  GreenProfile readout = setup.readout();
  UnloadedReference reference;
  Profile p;
  for (const Image& i : setup.untouched) {
    readout.read(Frame{i.view()}, p);
    reference.add(p);
  }
  BayesLocalizer::Config c;
  c.position_m = readout.positions_m();
  c.noise = reference.noise();
  c.unloaded = reference.mean();
  FedCamera camera;
  FedActuator actuator;
  using Estimator = ForceEstimator<FedCamera, FedActuator, BayesLocalizer>;
  Estimator estimator(
      camera, actuator, {readout, reference}, BayesLocalizer(c), MomentArm{0.05}, typename Estimator::Config{});
  std::mutex lock;
  std::deque<Frame> arriving;
  const auto begin = clock::now();
  const auto stamp = [&] { return std::chrono::duration_cast<std::chrono::nanoseconds>(clock::now() - begin).count(); };
  std::thread source([&] {
    for (int k = 0; k < frames; ++k) {
      std::this_thread::sleep_until(begin + std::chrono::microseconds(33333) * k);
      const std::lock_guard hold(lock);
      const auto& pictures = k > 30 ? setup.touched : setup.untouched;
      arriving.push_back({pictures[std::size_t(k) % pictures.size()].view(), stamp(), 0.0, 0.0, k});
    }
  });
  std::vector<double> microseconds;
  for (std::int64_t tick = 0; int(microseconds.size()) < frames; ++tick) {
    std::this_thread::sleep_until(begin + std::chrono::milliseconds(tick));
    std::vector<std::int64_t> taken;
    {
      const std::lock_guard hold(lock);
      for (; !arriving.empty(); arriving.pop_front()) {
        taken.push_back(arriving.front().stamp_ns);
        camera.queue.push_back(arriving.front());
      }
    }
    const std::int64_t now = stamp();
    actuator.queue.push_back({now, JointVector::Zero(1), JointVector::Zero(1),
        JointVector::Constant(1, 0.5 + 0.01 * noise(std::uint64_t(tick)))});
    estimator.step(now);
    for (const std::int64_t t : taken) microseconds.push_back(1e-3 * double(stamp() - t));
  }
  source.join();
  print("stamp to estimate, 1 kHz loop", microseconds);
}

}  // namespace

int main(int argc, char** argv) {
  const int frames = argc > 1 ? std::max(100, std::atoi(argv[1])) : 3000;
  for (const auto& [w, h] : {std::pair(640, 480), std::pair(1280, 720)}) {
    const Setup setup(w, h);
    std::printf("%d x %d, %d frames\n", w, h, frames);
    run<PeakLocalizer>(setup, "peak localiser", frames, [](const Eigen::VectorXd& at, const UnloadedReference& r) {
      return PeakLocalizer({at, r.noise()});
    });
    run<BayesLocalizer>(
        setup, "probabilistic localiser", frames, [](const Eigen::VectorXd& at, const UnloadedReference& r) {
          BayesLocalizer::Config c;
          c.position_m = at;
          c.noise = r.noise();
          c.unloaded = r.mean();
          return BayesLocalizer(c);
        });
    paced(setup, std::min(frames, 600));
  }
}
