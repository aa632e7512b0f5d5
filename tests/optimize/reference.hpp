#pragma once

#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include <fstream>

/// What benchmarks/optimize/make_reference.py wrote.
inline const nlohmann::json& reference() {
  static const nlohmann::json all = nlohmann::json::parse(std::ifstream(LUMO_TEST_DATA "/reference/botorch.json"));
  return all;
}

inline Eigen::VectorXd vector(const nlohmann::json& j) {
  const auto v = j.get<std::vector<double>>();
  return Eigen::Map<const Eigen::VectorXd>(v.data(), Eigen::Index(v.size()));
}

/// Rows of the file are columns here.
inline Eigen::MatrixXd columns(const nlohmann::json& j, Eigen::Index rows) {
  Eigen::MatrixXd m(rows, Eigen::Index(j.size()));
  for (std::size_t i = 0; i < j.size(); ++i) m.col(Eigen::Index(i)) = vector(j[i]);
  return m;
}
