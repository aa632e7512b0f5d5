#pragma once

// One include for the benchmarks, whichever of Catch2 version 2 and 3 is there, and how they are named.
#if __has_include(<catch2/catch_all.hpp>)
#include <catch2/catch_all.hpp>
#else
#include <catch2/catch.hpp>
#endif

#include "lumo/core/error.hpp"
#include "lumo/core/sobol.hpp"
#include "lumo/core/types.hpp"

#include <string>
#include <vector>

namespace lumo::micro {

/// A benchmark's name as table.py takes it apart: what is done, on how much, and by which of several ways. The input's
/// first number is a count, and the table also gives the time for one. Benchmarks with the same kernel and input are
/// compared with the first of them.
inline std::string named(const std::string& kernel, const std::string& input, const std::string& way = "") {
  return kernel + " | " + input + " | " + way;
}

/// Points of a scrambled Sobol sequence in [low, high]³, the same in every run.
inline std::vector<Vec3d> points_in(const Vec3d& low, const Vec3d& high, std::uint32_t count, std::uint64_t seed) {
  const OwenSobol u{seed};
  std::vector<Vec3d> points;
  for (std::uint32_t i = 0; i < count; ++i)
    points.push_back(low + (high - low).cwiseProduct(Vec3d(u(i, 0), u(i, 1), u(i, 2))));
  return points;
}

}  // namespace lumo::micro
