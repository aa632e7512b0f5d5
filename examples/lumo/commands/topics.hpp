#pragma once

#include "options/options.hpp"

#include "lumo/sense/recording/mcap/mcap_log.hpp"

namespace lumo::program {

/// Which topics of a bag to read: --image-topic, --joint-topic, --wrench-topic.
inline void add_topics(CLI::App& app, lumo::sense::McapTopics& topics) {
  add_text(app, "--image-topic", topics.image, "TOPIC", "Topic of the pictures, where LOG is a bag that has several");
  add_text(app, "--joint-topic", topics.joints, "TOPIC", "Topic of the joint states, where it has several");
  add_text(app, "--wrench-topic", topics.wrench, "TOPIC", "Topic of the wrenches, where it has several");
}

}  // namespace lumo::program
