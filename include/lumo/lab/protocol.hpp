#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/lab/side_camera.hpp"
#include "lumo/sense/recording/session.hpp"

#include <array>
#include <string>
#include <vector>

namespace lumo {

/// One load of a contact: reached evenly, then held.
struct LoadStep {
  double load_N = 0.0;
  double ramp_s = 0.3;
  double hold_s = 1.0;
  /// Of the hold's segment. Steps of kind `cycle` with one number share a segment, ramps included.
  sense::SegmentKind kind = sense::SegmentKind::hold;
  int cycle = -1;
};

/// One contact from first touch to leaving.
struct LabContact {
  int place = 0;
  double y_m = 0.0;  ///< of the jig
  int repetition = 0;
  std::vector<LoadStep> steps;
  double angle_rad = 0.0;  ///< of approach, small
  double rest_s = 1.0;     ///< without contact before it
  int view = 0;            ///< of LabPlan::views
};

/// A camera's place and the room's and lamps' light, as an experiment sets them on purpose.
struct LabView {
  CameraPlace place;
  double room = 1.0;   ///< ambient light, times the rig's
  double lamps = 1.0;  ///< 0: off
};

/// What is done in one log.
struct LabPlan {
  std::string title;
  double free_run_s = 0.0;  ///< the joint sweeps without contact, to get to know its friction and weight
  std::vector<LabContact> contacts;
  std::vector<LabView> views{LabView{}};
  double frames_per_s = 0.0;  ///< that are recorded; 0: all of the camera's
};

inline constexpr std::array<double, 6> lab_places_m{-25e-3, -15e-3, -5e-3, 5e-3, 15e-3, 25e-3};
/// Places 1, 3 and 5 of those, numbered along the finger without gaps in their own logs, where they are each other's
/// neighbours.
inline constexpr std::array<double, 3> lab_odd_places_m{lab_places_m[0], lab_places_m[2], lab_places_m[4]};

inline std::vector<LoadStep> lab_holds(const std::vector<double>& loads_N, double ramp_s, double hold_s) {
  std::vector<LoadStep> steps;
  for (const double f : loads_N) steps.push_back({f, ramp_s, hold_s});
  return steps;
}

/// Six places 10 mm apart, `repetitions` independent re-contacts each, 2, 5, 10, 15 N held 1 s, unloaded in between
/// (paper, re-contact evaluation).
inline LabPlan recontact_plan(int repetitions = 5) {
  require_in_range("repetitions", repetitions, 1, 1000, "");
  LabPlan plan{"re-contacts at six places", 0.0, {}};
  for (int r = 0; r < repetitions; ++r)
    for (int p = 0; p < 6; ++p)
      plan.contacts.push_back({p, lab_places_m[std::size_t(p)], r, lab_holds({2, 5, 10, 15}, 0.3, 1.0)});
  return plan;
}

/// Two conditioning and five measured cycles between 2 and 15 N in one contact, at places 1, 3 and 5, three runs, each
/// with re-contacts for the other metrics. 1 N/s, 1 s at both ends, five frames a second. Source: paper, contact
/// cycling; conditioning, rate, dwell and frames from the authors' public code (dokkev/fingertip-design-framework,
/// force_trajectory.py). Their approach angles of ±30° are not among them: the lab's angles are small.
inline LabPlan cycle_plan(int runs = 3) {
  require_in_range("runs", runs, 1, 1000, "");
  constexpr double low_N = 2.0, high_N = 15.0, rate_N_per_s = 1.0, dwell_s = 1.0, rest_s = 2.0;
  constexpr int conditioning = 2, measured = 5;
  constexpr double ramp_s = (high_N - low_N) / rate_N_per_s;
  LabPlan plan{"cycles within contact at three places", 0.0, {}};
  plan.frames_per_s = 5.0;
  for (int r = 0; r < runs; ++r)
    for (int p = 0; p < 3; ++p) {
      const double y = lab_odd_places_m[std::size_t(p)];
      LabContact c{p, y, r, {{low_N, low_N / rate_N_per_s, dwell_s, sense::SegmentKind::approach}}, 0.0, rest_s};
      for (int k = -conditioning; k < measured; ++k)
        for (const double f : {high_N, low_N}) c.steps.push_back({f, ramp_s, dwell_s, sense::SegmentKind::cycle, k});
      plan.contacts.push_back(std::move(c));
      // The same contact anew: one hold at each load, for W_recontact and D_neighbor of these runs.
      plan.contacts.push_back({p, y, r, lab_holds({2, 5, 10, 15}, 0.3, 1.0), 0.0, rest_s});
    }
  return plan;
}

/// Places 1, 3 and 5 up to 20 N under other camera heights and pitches, other room light, and with the LEDs off (paper,
/// imaging variation).
inline LabPlan imaging_plan() {
  LabPlan plan{"imaging variation", 0.0, {}, {}};
  plan.views = {
      {}, {{0, 0, 0, 0, 1.5_mm}}, {{0, 0, 0, 0, -1.5_mm}}, {{0, 6.0_deg}}, {{0, -6.0_deg}}, {{}, 4.0}, {{}, 1.0, 0.0}};
  for (int v = 0; v < int(plan.views.size()); ++v)
    for (int p = 0; p < 3; ++p)
      plan.contacts.push_back(
          {p, lab_odd_places_m[std::size_t(p)], v, lab_holds({2, 5, 10, 15, 20}, 0.3, 0.5), 0.0, 1.0, v});
  return plan;
}

/// An unloaded sweep of the joint, then six sequences of 2, 5, 10, 15, 20 N, one for each place (paper, force
/// estimation).
inline LabPlan force_plan() {
  LabPlan plan{"location and force at six places", 9.0, {}};
  for (int p = 0; p < 6; ++p)
    plan.contacts.push_back({p, lab_places_m[std::size_t(p)], 0, lab_holds({2, 5, 10, 15, 20}, 0.3, 0.9), 0.0, 1.5});
  return plan;
}

/// How far the built finger's places lie from those of the plans: its open proximal end gives way under 15 N at
/// y = −26 mm. Its places are then y = 26 mm − x, x = 0 … 50 mm the stages' travel from the distal one, which the
/// authors' rig leaves open by some millimetres.
inline constexpr double built_finger_shift_m = 1e-3;

/// The plan with every place moved along the finger.
inline LabPlan moved(LabPlan plan, double by_m) {
  for (LabContact& c : plan.contacts) c.y_m += by_m;
  return plan;
}

/// The plan without loads above one that the pad bears.
inline LabPlan up_to(LabPlan plan, double load_N) {
  for (LabContact& c : plan.contacts) std::erase_if(c.steps, [&](const LoadStep& s) { return s.load_N > load_N; });
  return plan;
}

}  // namespace lumo
