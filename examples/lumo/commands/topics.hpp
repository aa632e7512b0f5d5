#pragma once

#include "options/options.hpp"

#include "lumo/sense/recording/mcap/mcap_log.hpp"

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

namespace lumo::program {

/// What of a log to read, and how: --image-topic, --joint-topic, --wrench-topic, --joint-names, --wrench-axes.
inline void add_topics(CLI::App& app, lumo::sense::McapTopics& topics) {
  add_text(app, "--image-topic", topics.image, "TOPIC", "Topic of the pictures, where LOG is a bag that has several");
  add_text(app, "--joint-topic", topics.joints, "TOPIC", "Topic of the joint states, where it has several");
  add_text(app, "--wrench-topic", topics.wrench, "TOPIC", "Topic of the wrenches, where it has several");
  const auto parts = [](const std::string& typed) {
    std::vector<std::string> list;
    for (std::size_t from = 0; from <= typed.size();) {
      const std::size_t to = std::min(typed.find(',', from), typed.size());
      list.push_back(typed.substr(from, to - from));
      from = to + 1;
    }
    return list;
  };
  add_value(app, "--wrench-axes", "X,Y,Z",
      "The force sensor's axes that lie along the finger's x, y and z, such as x,-y,-z; -x,-y,-z where it reports the "
      "finger's force on the object; default: as the session states",
      [&topics, parts](const std::string& typed) {
        try {
          topics.wrench_axes = lumo::sense::sensor_axes(parts(typed));
        } catch (const InvalidArgument& e) {
          throw UsageError(std::string("--wrench-axes: ") + e.what());
        }
      });
  add_value(app, "--joint-names", "A,B",
      "The finger's joints from the base to the tip, by the names that joint.csv or a bag has; default: as the session "
      "states",
      [&topics, parts](const std::string& typed) {
        topics.joint_names = parts(typed);
        if (!lumo::sense::are_column_names(topics.joint_names) &&
            !std::all_of(topics.joint_names.begin(), topics.joint_names.end(), lumo::sense::is_joint_number))
          throw UsageError("--joint-names is '" + typed + "', must be names, each once, with commas between them");
        if (topics.joint_names.size() > std::size_t(lumo::sense::max_joints))
          throw UsageError("--joint-names has " + std::to_string(topics.joint_names.size()) +
                           " names, must have at most " + std::to_string(lumo::sense::max_joints));
      });
}

}  // namespace lumo::program
