#pragma once

// The sensing half, in the order in which data flows: devices → recordings → profiles → location → force → decoders →
// hand. Needs Eigen only.

#include "lumo/version.hpp"

#include "lumo/sense/devices/mini_cheetah.hpp"
#include "lumo/sense/devices/replay.hpp"

#include "lumo/sense/recording/log_truth.hpp"
#include "lumo/sense/recording/wrench_drift.hpp"

#include "lumo/sense/recording/mcap/bag_metadata.hpp"
#include "lumo/sense/recording/mcap/mcap_log.hpp"
#include "lumo/sense/recording/mcap/mcap_log_writer.hpp"

#include "lumo/sense/profile/bright_rows.hpp"
#include "lumo/sense/profile/led_detector.hpp"

#include "lumo/sense/localize/bayes_localizer.hpp"
#include "lumo/sense/localize/paper_localizer.hpp"
#include "lumo/sense/localize/peak_localizer.hpp"
#include "lumo/sense/localize/sensibility.hpp"
#include "lumo/sense/localize/template_localizer.hpp"

#include "lumo/sense/joints/effort_check.hpp"
#include "lumo/sense/joints/planar_finger.hpp"
#include "lumo/sense/joints/serial_chain.hpp"

#include "lumo/sense/estimate.hpp"
#include "lumo/sense/force/calibration.hpp"
#include "lumo/sense/force/force_baselines.hpp"
#include "lumo/sense/force/force_estimator.hpp"
#include "lumo/sense/force/latency.hpp"
#include "lumo/sense/force/stream_checks.hpp"

#include "lumo/sense/decode/bayes_decoder.hpp"
#include "lumo/sense/decode/constraint_gain.hpp"
#include "lumo/sense/decode/decoder.hpp"
#include "lumo/sense/decode/gaussian_process_decoder.hpp"
#include "lumo/sense/decode/measured_loads.hpp"
#include "lumo/sense/decode/nearest_template.hpp"
#include "lumo/sense/decode/segment_responses.hpp"

#include "lumo/sense/hand/hand_log.hpp"

#include "lumo/sense/live/live.hpp"
#include "lumo/sense/live/log_recorder.hpp"
