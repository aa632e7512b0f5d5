#include "catch.hpp"

#include "lumo/sense/recording/mcap/bag_metadata.hpp"

#include <string>
#include <vector>

using namespace lumo;
using namespace lumo::sense;

using BagFiles = std::vector<std::string>;

TEST_CASE("metadata.yaml of a bag names its files, in block and in flow style", "[mcap]") {
  const BagMetadata m = bag_metadata(
      "rosbag2_bagfile_information:\n"
      "  version: 9\r\n"
      "  storage_identifier: mcap\n"
      "  relative_file_paths:\n"
      "    - a_0.mcap\n"
      "    - \"a_1.mcap\"   # the second\n"
      "    - 'a 2.mcap.zstd'\n"
      "  duration:\n"
      "    nanoseconds: 5\n"
      "  topics_with_message_count:\n"
      "    - topic_metadata:\n"
      "        name: /camera\n"
      "  files:\n"
      "    - path: a_0.mcap\n",
      "metadata.yaml");
  CHECK(m.storage == "mcap");
  CHECK(m.files == BagFiles{"a_0.mcap", "a_1.mcap", "a 2.mcap.zstd"});
  CHECK(bag_metadata("relative_file_paths:\n- a.mcap\n- b.mcap\nx: 1", "m").files == BagFiles{"a.mcap", "b.mcap"});
  CHECK(bag_metadata("relative_file_paths: [a.mcap, \"b.mcap\"]\n", "m").files == BagFiles{"a.mcap", "b.mcap"});
}

TEST_CASE("metadata.yaml without files, or with files elsewhere, is refused", "[mcap]") {
  CHECK_THROWS_WITH(bag_metadata("", "m.yaml"), "m.yaml: names no files (relative_file_paths)");
  CHECK_THROWS_WITH(
      bag_metadata("relative_file_paths: []\nx: 1\n", "m.yaml"), "m.yaml: names no files (relative_file_paths)");
  for (const std::string bad : {"../a.mcap", "/a.mcap"})
    CHECK_THROWS_WITH(bag_metadata("relative_file_paths:\n - " + bad + "\n", "m.yaml"),
        "m.yaml: file '" + bad + "' does not lie below the folder");
}

TEST_CASE("files of a bag without metadata.yaml follow the numbers in their names", "[mcap]") {
  BagFiles files = {"a_10.mcap", "a_9.mcap", "a_0.mcap", "a_009.mcap"};
  sort_by_number(files);
  CHECK(files == BagFiles{"a_0.mcap", "a_009.mcap", "a_9.mcap", "a_10.mcap"});
}
