#pragma once

#include "console/progress.hpp"
#include "sensing/log.hpp"

#include "lumo/sense/decode/measured_loads.hpp"
#include "lumo/sense/force/latency.hpp"
#include "lumo/sense/force/stream_checks.hpp"
#include "lumo/sense/joints/effort_check.hpp"

#include <optional>
#include <span>
#include <vector>

/// Notes of what a log's streams say against each other, or against what they are taken for.
namespace lumo::program {

using namespace sense;

/// What the start of the pictures shows is not what an unloaded finger does.
void tell_reference(const SensedLog& s, const CheckedReference& checked, Progress& progress);

/// Efforts that no driver reports, and velocities that do not fit the positions. Throws InputError where efforts never
/// change.
void tell_joints(const OpenLog& log, Progress& progress);

/// Torques that do not fit the contacts that the pictures see, and a force sensor that does not.
void tell_torques(const SensedLog& s, std::span<const FrameEstimate> estimates, const FingerModel<>& finger,
    double noise_Nm, Progress& progress);

/// Takes a force sensor's drift out of the log, and says so.
void tell_wrenches(OpenLog& log, Progress& progress);

/// Where joints were learnt from, unless somebody stated it, and what of it looks like contact.
void tell_learnt(const SensedLog& s, const UnloadedStretch& learnt, const JointReference& joints, Progress& progress);

/// By how much joint samples are stamped later than pictures, as the log shows it; noted where that is none of chance.
/// `moved_s`: by how much they were moved back already.
std::optional<Latency> tell_latency(
    const SensedLog& s, const FingerModel<>& finger, double moved_s, Progress& progress);

/// A force sensor that does not fit the loads of the holds.
LoadCheck tell_loads(const OpenLog& log, Progress& progress);

/// The log's holds with the loads that its force sensor measured, where it follows the nominal ones; what it says of
/// them is noted.
std::vector<HoldResponse> measured_holds(const SensedLog& s, Progress& progress);

}  // namespace lumo::program
