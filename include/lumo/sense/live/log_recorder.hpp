#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/files.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/live/live.hpp"
#include "lumo/sense/recording/tables.hpp"

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <exception>
#include <fstream>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

namespace lumo::sense {

/// Writes a log's folder while it happens: pictures by a thread of its own, tables row by row, so that what was taken
/// is there when the program or the power ends. Stamps count from the first picture's. What comes before it or goes
/// back in time is left out and counted, as are samples that the motor's range has cut off. `encode(ImageView)` gives
/// the bytes of an image file, a std::vector<std::uint8_t>; the recorder's thread calls it.
template <class Encode> class LogRecorder {
 public:
  static constexpr std::size_t most_waiting = 64;        ///< pictures that the disk is behind; more are left out
  static constexpr std::size_t most_unflushed = 16384;   ///< bytes of joint rows that a crash may lose
  static constexpr std::int64_t flush_ns = 200'000'000;  ///< the same in time

  /// `folder` and `folder`/frames are there. `session_json` is written as it is. Throws InputError.
  LogRecorder(std::string folder, std::string_view session_json, Encode encode)
      : folder_(std::move(folder)), encode_(std::move(encode)) {
    write_whole(folder_ + "/session.json", session_json);
    open(frames_, "frames.csv");
    append(frames_, frame_header(false), "frames.csv");
    writer_ = std::thread([this] { write(); });
  }
  ~LogRecorder() {
    try {
      finish();
    } catch (const Error&) {
    }
  }
  LogRecorder(const LogRecorder&) = delete;
  LogRecorder& operator=(const LogRecorder&) = delete;

  /// Copies the picture. Throws InputError where an earlier one could not be written.
  void add(const Frame& f) {
    if (!begin_) begin_ = f.stamp_ns;
    const std::int64_t stamp = f.stamp_ns - *begin_;
    std::unique_lock lock(mutex_);
    if (!fault_.empty()) throw InputError(fault_);
    if (waiting_.size() >= most_waiting || f.image.empty() || (last_frame_ && stamp <= *last_frame_))
      return void(++lost_frames_);
    lock.unlock();
    Image copy = Image::copy(f.image);
    lock.lock();
    last_frame_ = stamp;
    waiting_.push_back({{stamp, frame_file(count_++), f.exposure_s, f.gain}, std::move(copy)});
    there_.notify_one();
  }

  /// Throws InputError where it cannot be written, or joints or kind of effort change.
  void add(const JointSample& s) {
    if (!begin_ || s.stamp_ns < *begin_ || s.saturated || !s.effort.allFinite() || !s.position_rad.allFinite() ||
        !s.velocity_rad_per_s.allFinite())
      return void(++lost_samples_);
    JointSample shifted = s;
    shifted.stamp_ns -= *begin_;
    if (last_joint_ && shifted.stamp_ns <= *last_joint_) return void(++lost_samples_);
    if (samples_ == 0) {
      joints_of_ = s.effort.size();
      unit_ = s.unit;
    }
    if (s.effort.size() != joints_of_ || s.position_rad.size() != joints_of_ ||
        s.velocity_rad_per_s.size() != joints_of_ || s.unit != unit_)
      throw InputError(folder_ + "/joint.csv: the motors have other joints than before");
    if (samples_++ == 0) {
      open(joints_, "joint.csv");
      append(joints_, joint_header(int(joints_of_), unit_), "joint.csv");
    }
    joint_rows_ += joint_row(shifted, last_joint_);
    if (joint_rows_.size() > most_unflushed || shifted.stamp_ns - flushed_ns_ > flush_ns) {
      flushed_ns_ = shifted.stamp_ns;
      flush_joints();
    }
  }

  /// Waits until all is written. Throws InputError.
  void finish() {
    stop();
    if (!joint_rows_.empty()) flush_joints();
    if (!fault_.empty()) throw InputError(fault_);
  }

  std::size_t frames() const { return count_; }
  /// Stamp of the newest picture that was taken, in the log; 0 without any.
  std::int64_t end_ns() const { return last_frame_.value_or(0); }
  std::size_t samples() const { return samples_; }
  std::size_t lost_frames() const { return lost_frames_; }
  std::size_t lost_samples() const { return lost_samples_; }

 private:
  struct Picture {
    FrameRecord record;
    Image image;
  };

  void open(std::ofstream& out, const char* file) const {
    out.open(folder_ + '/' + file, std::ios::binary);
    if (!out) throw InputError(message(folder_, '/', file, ": cannot be written"));
  }
  /// Whole rows at once, so that a table that is cut ends with a row.
  void append(std::ofstream& out, const std::string& rows, const char* file) const {
    out.write(rows.data(), std::streamsize(rows.size())).flush();
    if (!out) throw InputError(message(folder_, '/', file, ": cannot be written"));
  }
  void flush_joints() {
    append(joints_, joint_rows_, "joint.csv");
    joint_rows_.clear();
  }
  void write() {
    std::optional<std::int64_t> last;
    std::unique_lock lock(mutex_);
    while (true) {
      there_.wait(lock, [this] { return stop_ || !waiting_.empty(); });
      if (waiting_.empty()) return;
      Picture p = std::move(waiting_.front());
      waiting_.pop_front();
      lock.unlock();
      std::string fault;
      try {
        const auto bytes = encode_(p.image.view());
        write_whole(folder_ + "/frames/" + p.record.file, {reinterpret_cast<const char*>(bytes.data()), bytes.size()},
            Durability::memory);
        append(frames_, frame_row(p.record, false, last), "frames.csv");  // after its picture
      } catch (const std::exception& e) {
        fault = e.what();
      } catch (...) {
        fault = folder_ + "/frames: a picture cannot be encoded";
      }
      lock.lock();
      if (!fault.empty()) {
        fault_ = std::move(fault);
        waiting_.clear();
        return;
      }
    }
  }
  void stop() {
    {
      const std::lock_guard lock(mutex_);
      stop_ = true;
    }
    there_.notify_one();
    if (writer_.joinable()) writer_.join();
  }

  std::string folder_;
  Encode encode_;
  std::ofstream frames_, joints_;
  std::string joint_rows_;
  std::optional<std::int64_t> begin_, last_frame_, last_joint_;
  std::int64_t flushed_ns_ = 0;
  Eigen::Index joints_of_ = 0;
  Effort unit_ = Effort::torque_Nm;
  std::size_t count_ = 0, samples_ = 0, lost_frames_ = 0, lost_samples_ = 0;
  std::mutex mutex_;  ///< of what follows
  std::condition_variable there_;
  std::deque<Picture> waiting_;
  std::string fault_;
  bool stop_ = false;
  std::thread writer_;
};

/// Records camera and motors until the camera ends or `going_on(seconds)`, called at each picture with the time since
/// the first, returns false. Throws InputError where no picture comes for `wait.patience_s`.
template <Camera C, Actuator A, class Recorder, class GoingOn>
void record_live(C& camera, A& actuator, Recorder& recorder, GoingOn going_on, const LiveWait& wait = {}) {
  validate(wait);
  const auto drain = [&] {
    for (auto s = actuator.next(); s; s = actuator.next()) recorder.add(*s);
  };
  auto frame = next_picture(camera, wait, drain);
  if (!frame) throw InputError(wait.name + ": gives no pictures");
  for (const std::int64_t first = frame->stamp_ns; frame; frame = next_picture(camera, wait, drain)) {
    if (!going_on(1e-9 * double(frame->stamp_ns - first))) break;
    recorder.add(*frame);
    drain();
  }
}

/// Stands for motors where there are none.
struct NoActuator {
  std::optional<JointSample> next() { return std::nullopt; }
  StreamState state() const { return StreamState::ended; }
};

static_assert(Actuator<NoActuator>);

}  // namespace lumo::sense
