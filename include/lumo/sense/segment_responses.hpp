#pragma once

#include "lumo/core/error.hpp"
#include "lumo/sense/cycle_metrics.hpp"
#include "lumo/sense/decoder.hpp"
#include "lumo/sense/readout.hpp"
#include "lumo/sense/recontact_metrics.hpp"
#include "lumo/sense/session.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <span>
#include <tuple>
#include <utility>
#include <vector>

namespace lumo {

/// Mean response over each hold of a log, ready for metrics and decoders.
struct HoldResponse {
  Segment segment;
  Eigen::VectorXd response;  ///< mean over the segment's profiles, minus the unloaded one that came last before it
  int profiles = 0;
};

/// Responses of all segments of kind "hold" or "cycle" that have profiles. Each is taken against the mean over the last segment of kind "unloaded" that
/// ended before it, because lamps drift between re-contacts; a session without any is an error. Throws InvalidArgument.
inline std::vector<HoldResponse> hold_responses(std::span<const Profile> profiles, const std::vector<Segment>& segments) {
  const auto mean = [&](const Segment& s) {
    std::pair<Eigen::VectorXd, int> m{Eigen::VectorXd(), 0};
    for (const Profile& p : profiles) {
      if (p.stamp_ns < s.from_ns || p.stamp_ns > s.to_ns) continue;
      if (m.second == 0) m.first = Eigen::VectorXd::Zero(p.value.size());
      if (p.value.size() != m.first.size()) throw InvalidArgument(detail::text("profiles have ", m.first.size(), " and ", p.value.size(), " values"));
      m.first += p.value;
      ++m.second;
    }
    if (m.second > 0) m.first /= double(m.second);
    return m;
  };
  std::vector<HoldResponse> list;
  std::map<std::size_t, Eigen::VectorXd> unloaded;
  for (const Segment& s : segments) {
    if (s.kind != "hold" && s.kind != "cycle") continue;
    const Segment* before = nullptr;
    for (const Segment& u : segments)
      if (u.kind == "unloaded" && u.to_ns <= s.from_ns && (!before || u.to_ns > before->to_ns)) before = &u;
    if (!before) throw InvalidArgument(detail::text("the segment that begins at ", s.from_ns, " ns has no unloaded segment before it"));
    auto& reference = unloaded[std::size_t(before - segments.data())];
    if (reference.size() == 0) reference = mean(*before).first;
    const auto [value, count] = mean(s);
    if (count == 0) continue;
    if (reference.size() != value.size()) throw InvalidArgument(detail::text("the unloaded segment that ends at ", before->to_ns, " ns has no profiles"));
    list.push_back({s, value - reference, count});
  }
  return list;
}

/// Slope profiles p_{i,r} over all loads of each re-contact: for each place, channels × re-contacts. Places without re-contacts are left out.
inline std::vector<Eigen::MatrixXd> slope_profiles(const std::vector<HoldResponse>& holds) {
  std::map<int, std::map<int, std::vector<const HoldResponse*>>> by_place;
  for (const HoldResponse& h : holds)
    if (h.segment.kind == "hold" && h.segment.place >= 0 && h.segment.repetition >= 0) by_place[h.segment.place][h.segment.repetition].push_back(&h);
  std::vector<Eigen::MatrixXd> slopes;
  for (const auto& place : by_place) {
    Eigen::MatrixXd m(holds.front().response.size(), Eigen::Index(place.second.size()));
    Eigen::Index column = 0;
    for (const auto& recontact : place.second) {
      Eigen::MatrixXd response(m.rows(), Eigen::Index(recontact.second.size()));
      Eigen::VectorXd load(response.cols());
      for (Eigen::Index k = 0; k < load.size(); ++k) response.col(k) = recontact.second[std::size_t(k)]->response, load[k] = recontact.second[std::size_t(k)]->segment.load_N;
      m.col(column++) = intensity_force_slope(response, load);
    }
    slopes.push_back(std::move(m));
  }
  return slopes;
}

/// The decoder's observations, with the repetition of each as its fold.
struct DecodingTask {
  LabelledResponses data;
  std::vector<int> fold;
};

/// Signed change of response from load to load (paper: from 2 to 5 N), the steps one below the other. `load_N`: at least two. Re-contacts that lack one of
/// them are left out. Throws InvalidArgument when fewer than two places are left.
inline DecodingTask decoding_task(const std::vector<HoldResponse>& holds, const std::vector<double>& load_N) {
  if (load_N.size() < 2) throw InvalidArgument(detail::text("decoding needs at least 2 loads, has ", load_N.size()));
  std::map<std::pair<int, int>, std::vector<const HoldResponse*>> contacts;  // place, repetition
  std::map<int, double> place_m;
  for (const HoldResponse& h : holds) {
    if (h.segment.kind != "hold" || h.segment.place < 0 || h.segment.repetition < 0) continue;
    auto& at = contacts[{h.segment.place, h.segment.repetition}];
    at.resize(load_N.size());
    for (std::size_t k = 0; k < load_N.size(); ++k)
      if (std::abs(h.segment.load_N - load_N[k]) < 1e-6) at[k] = &h;
  }
  std::erase_if(contacts, [](const auto& c) { return std::find(c.second.begin(), c.second.end(), nullptr) != c.second.end(); });
  for (const auto& c : contacts) place_m[c.first.first] = 1e-3 * c.second.front()->segment.y_mm;
  if (place_m.size() < 2) throw InvalidArgument(detail::text("decoding: ", place_m.size(), " places have all the loads, must be at least 2"));
  DecodingTask task;
  const Eigen::Index channels = contacts.begin()->second.front()->response.size(), steps = Eigen::Index(load_N.size()) - 1;
  task.data.response.resize(channels * steps, Eigen::Index(contacts.size()));
  task.data.place_m.resize(Eigen::Index(place_m.size()));
  std::map<int, int> number;
  for (const auto& p : place_m) {
    const int next = int(number.size());
    task.data.place_m[next] = p.second;
    number[p.first] = next;
  }
  Eigen::Index column = 0;
  for (const auto& c : contacts) {
    for (Eigen::Index k = 0; k < steps; ++k)
      task.data.response.block(k * channels, column, channels, 1) = c.second[std::size_t(k) + 1]->response - c.second[std::size_t(k)]->response;
    task.data.place.push_back(number[c.first.first]);
    task.fold.push_back(c.first.second);
    ++column;
  }
  return task;
}

/// Runs of cycles within maintained contact: one for each place, angle and repetition, with its matched loads.
inline std::vector<CycleRun> cycle_runs(const std::vector<HoldResponse>& holds) {
  std::map<std::tuple<int, double, int>, std::map<double, std::vector<const HoldResponse*>>> runs;
  for (const HoldResponse& h : holds)
    if (h.segment.kind == "cycle") runs[{h.segment.place, h.segment.angle_deg, h.segment.repetition}][h.segment.load_N].push_back(&h);
  std::vector<CycleRun> list;
  for (const auto& run : runs) {
    CycleRun r;
    for (const auto& load : run.second) {
      Eigen::MatrixXd m(load.second.front()->response.size(), Eigen::Index(load.second.size()));
      for (Eigen::Index k = 0; k < m.cols(); ++k) m.col(k) = load.second[std::size_t(k)]->response;
      r.load.push_back(std::move(m));
    }
    list.push_back(std::move(r));
  }
  return list;
}

}  // namespace lumo
