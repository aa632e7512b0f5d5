#pragma once

#include "options/options.hpp"

#include "lumo/sense/recording/mcap/mcap_log.hpp"

#include <algorithm>
#include <cstddef>
#include <string>

namespace lumo::program {

/// What of a bag to read: --image-topic, --joint-topic, --wrench-topic, --joint-names.
inline void add_topics(CLI::App& app, lumo::sense::McapTopics& topics) {
  add_text(app, "--image-topic", topics.image, "TOPIC", "Topic of the pictures, where LOG is a bag that has several");
  add_text(app, "--joint-topic", topics.joints, "TOPIC", "Topic of the joint states, where it has several");
  add_text(app, "--wrench-topic", topics.wrench, "TOPIC", "Topic of the wrenches, where it has several");
  add_value(app, "--joint-names", "A,B", "The finger's joints from the base to the tip, by the names that a bag has",
      [&topics](const std::string& typed) {
        topics.joint_names.clear();
        for (std::size_t from = 0; from <= typed.size();) {
          const std::size_t to = std::min(typed.find(',', from), typed.size());
          if (to == from) throw UsageError("--joint-names is '" + typed + "', must be names with commas between them");
          topics.joint_names.push_back(typed.substr(from, to - from));
          from = to + 1;
        }
        if (topics.joint_names.size() > std::size_t(lumo::sense::max_joints))
          throw UsageError("--joint-names has " + std::to_string(topics.joint_names.size()) +
                           " names, must have at most " + std::to_string(lumo::sense::max_joints));
      });
}

}  // namespace lumo::program
