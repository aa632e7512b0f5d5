#pragma once

#include "lumo/core/error.hpp"
#include "lumo/sense/decode/decoder.hpp"
#include "lumo/sense/decode/recontact_metrics.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/recording/session.hpp"

#include <cmath>
#include <map>
#include <span>
#include <utility>
#include <vector>

namespace lumo::sense {

/// Mean response over each hold of a log, ready for metrics and decoders.
struct HoldResponse {
  Segment segment;
  Eigen::VectorXd response;  ///< mean over the segment's profiles, minus the unloaded one that came last before it
  int profiles = 0;
  double load_N = 0.0;  ///< that pressed: the segment's, or what a force sensor measured
};

/// Responses of all segments of kind `hold` that have profiles. Each is taken against the mean over the last
/// segment of kind `unloaded` that ended before it, because lamps drift between re-contacts; a session without any is
/// an error. Throws InvalidArgument.
inline std::vector<HoldResponse> hold_responses(
    const std::span<const Profile>& profiles, const std::vector<Segment>& segments) {
  const auto mean = [&](const Segment& s) {
    std::pair<Eigen::VectorXd, int> m{Eigen::VectorXd(), 0};
    for (const Profile& p : profiles) {
      if (p.stamp_ns < s.from_ns || p.stamp_ns > s.to_ns) continue;
      if (m.second == 0) m.first = Eigen::VectorXd::Zero(p.value.size());
      if (p.value.size() != m.first.size())
        throw InvalidArgument(message("profiles have ", m.first.size(), " and ", p.value.size(), " values"));
      m.first += p.value;
      ++m.second;
    }
    if (m.second > 0) m.first /= double(m.second);
    return m;
  };
  std::vector<HoldResponse> list;
  std::map<std::size_t, Eigen::VectorXd> unloaded;
  for (const Segment& s : segments) {
    if (s.kind != SegmentKind::hold) continue;
    const Segment* before = nullptr;
    for (const Segment& u : segments)
      if (u.kind == SegmentKind::unloaded && u.to_ns <= s.from_ns && (!before || u.to_ns > before->to_ns)) before = &u;
    if (!before)
      throw InvalidArgument(message("the segment that begins at ", s.from_ns, " ns has no unloaded segment before it"));
    auto& reference = unloaded[std::size_t(before - segments.data())];
    if (reference.size() == 0) reference = mean(*before).first;
    const auto [value, count] = mean(s);
    if (count == 0) continue;
    if (reference.size() != value.size())
      throw InvalidArgument(message("the unloaded segment that ends at ", before->to_ns, " ns has no profiles"));
    list.push_back({s, value - reference, count, s.load_N});
  }
  return list;
}

/// Those holds of one indenter at one approach angle: places are compared under the same contact only.
inline std::vector<HoldResponse> responses_of(
    const std::vector<HoldResponse>& holds, double diameter_mm, double angle_deg) {
  std::vector<HoldResponse> list;
  for (const HoldResponse& h : holds)
    if (h.segment.diameter_mm == diameter_mm && h.segment.angle_deg == angle_deg) list.push_back(h);
  return list;
}

namespace detail {

/// Holds by place, re-contact and load. Throws InvalidArgument unless one indenter at one angle made them all, each
/// load of a re-contact is held once, and places, numbered along the finger, ascend in y.
inline std::map<int, std::map<int, std::map<double, const HoldResponse*>>> recontacts(
    const std::vector<HoldResponse>& holds) {
  std::map<int, std::map<int, std::map<double, const HoldResponse*>>> by_place;
  const Segment* first = nullptr;
  for (const HoldResponse& h : holds) {
    const Segment& s = h.segment;
    if (s.place < 0 || s.repetition < 0) continue;
    if (!first) first = &s;
    if (s.diameter_mm != first->diameter_mm || s.angle_deg != first->angle_deg)
      throw InvalidArgument(message("holds are of indenters of ", first->diameter_mm, " mm at ", first->angle_deg,
          "° and of ", s.diameter_mm, " mm at ", s.angle_deg, "°, must be of one: take each by itself"));
    if (!by_place[s.place][s.repetition].emplace(s.load_N, &h).second)
      throw InvalidArgument(
          message("place ", s.place, ", re-contact ", s.repetition, " has two holds at ", s.load_N, " N"));
  }
  const Segment* before = nullptr;
  for (const auto& place : by_place) {
    const Segment& s = place.second.begin()->second.begin()->second->segment;
    for (const auto& recontact : place.second)
      for (const auto& hold : recontact.second)
        if (hold.second->segment.y_mm != s.y_mm)
          throw InvalidArgument(
              message("place ", s.place, " lies at y = ", s.y_mm, " and at ", hold.second->segment.y_mm, " mm"));
    if (before && !(s.y_mm > before->y_mm))
      throw InvalidArgument(message("place ", s.place, " lies at y = ", s.y_mm, " mm, must exceed that of place ",
          before->place, ", ", before->y_mm, " mm"));
    before = &s;
  }
  return by_place;
}

}  // namespace detail

/// Slope profiles p_{i,r} over the loads of each re-contact: for each place along the finger, channels ×
/// re-contacts. All holds of a re-contact that stand on one unloaded segment share its profile, which drops out.
/// Throws InvalidArgument where more than one indenter or angle is among the holds, a load is held twice, or a place
/// between two others is missing: its neighbours are none of each other.
inline std::vector<Eigen::MatrixXd> slope_profiles(const std::vector<HoldResponse>& holds) {
  std::vector<Eigen::MatrixXd> slopes;
  int next = -1;
  for (const auto& place : detail::recontacts(holds)) {
    if (next >= 0 && place.first != next)
      throw InvalidArgument(message("place ", next, " has no re-contacts, but places before and after it have"));
    next = place.first + 1;
    Eigen::MatrixXd m(holds.front().response.size(), Eigen::Index(place.second.size()));
    Eigen::Index column = 0;
    for (const auto& recontact : place.second) {
      Eigen::MatrixXd response(m.rows(), Eigen::Index(recontact.second.size()));
      Eigen::VectorXd load(response.cols());
      Eigen::Index k = 0;
      for (const auto& hold : recontact.second) {
        response.col(k) = hold.second->response;
        load[k++] = hold.second->load_N;
      }
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

/// Loads [N] of at least `least_N` at which every re-contact was held, ascending. Throws InvalidArgument as
/// slope_profiles does.
inline std::vector<double> common_loads(const std::vector<HoldResponse>& holds, double least_N) {
  std::map<double, int> count;
  int recontacts = 0;
  for (const auto& place : detail::recontacts(holds))
    for (const auto& recontact : place.second) {
      ++recontacts;
      for (const auto& hold : recontact.second) ++count[hold.first];
    }
  std::vector<double> loads;
  for (const auto& [load, times] : count)
    if (times == recontacts && load >= least_N) loads.push_back(load);
  return loads;
}

/// Signed change of response from load to load (paper: from 2 to 5 N), the steps one below the other. `load_N`: at
/// least two. Re-contacts that lack one of them are left out. Throws InvalidArgument when fewer than two places are
/// left, and as slope_profiles does for holds that are not of one kind.
inline DecodingTask decoding_task(const std::vector<HoldResponse>& holds, const std::vector<double>& load_N) {
  if (load_N.size() < 2) throw InvalidArgument(message("decoding needs at least 2 loads, has ", load_N.size()));
  struct Contact {
    int place, repetition;
    std::vector<const HoldResponse*> at;  // the loads
  };
  std::vector<Contact> contacts;
  std::map<int, double> place_m;
  for (const auto& place : detail::recontacts(holds))
    for (const auto& recontact : place.second) {
      Contact c{place.first, recontact.first, {}};
      for (const double load : load_N)
        for (const auto& hold : recontact.second)
          if (std::abs(hold.first - load) < 1e-6) c.at.push_back(hold.second);
      if (c.at.size() != load_N.size()) continue;
      place_m[c.place] = 1e-3 * c.at.front()->segment.y_mm;
      contacts.push_back(std::move(c));
    }
  if (place_m.size() < 2)
    throw InvalidArgument(message("decoding: ", place_m.size(), " places have all the loads, must be at least 2"));
  DecodingTask task;
  const Eigen::Index channels = contacts.front().at.front()->response.size(), steps = Eigen::Index(load_N.size()) - 1;
  task.data.response.resize(channels * steps, Eigen::Index(contacts.size()));
  task.data.place_m.resize(Eigen::Index(place_m.size()));
  std::map<int, int> number;
  for (const auto& p : place_m) {
    const int next = int(number.size());
    task.data.place_m[next] = p.second;
    number[p.first] = next;
  }
  for (std::size_t i = 0; i < contacts.size(); ++i) {
    const Contact& c = contacts[i];
    for (Eigen::Index k = 0; k < steps; ++k)
      task.data.response.block(k * channels, Eigen::Index(i), channels, 1) =
          c.at[std::size_t(k) + 1]->response - c.at[std::size_t(k)]->response;
    task.data.place.push_back(number[c.place]);
    task.fold.push_back(c.repetition);
  }
  return task;
}

}  // namespace lumo::sense
