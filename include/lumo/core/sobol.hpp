#pragma once

#include "lumo/core/error.hpp"

#include <algorithm>
#include <array>
#include <cstdint>

namespace lumo {

/// Mixes 64 bits; a bijection (Steele, Lea & Flood, "Fast Splittable Pseudorandom Number Generators", 2014).
constexpr std::uint64_t mix64(std::uint64_t x) {
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ull;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebull;
  return x ^ (x >> 31);
}

/// A key for the pair (key, label): counter-based, so that no draw depends on how many came before it.
constexpr std::uint64_t combine(std::uint64_t key, std::uint64_t label) {
  return mix64(key + 0x9e3779b97f4a7c15ull * (label + 1));
}

/// A number in (0, 1) from a key.
constexpr double uniform(std::uint64_t key) { return (double(key >> 11) + 0.5) * 0x1p-53; }

/// By ratio, of `wish` ≤ 2²⁴; counts of points that fill evenly. 1 for less than 1.
inline std::uint32_t nearest_power_of_two(double wish) {
  return std::max(1u, std::bit_floor(std::uint32_t(std::min(double(1 << 24), 1.4142 * wish))));
}

constexpr std::uint32_t reverse_bits(std::uint32_t x) {
  x = ((x >> 1) & 0x55555555u) | ((x & 0x55555555u) << 1);
  x = ((x >> 2) & 0x33333333u) | ((x & 0x33333333u) << 2);
  x = ((x >> 4) & 0x0f0f0f0fu) | ((x & 0x0f0f0f0fu) << 4);
  x = ((x >> 8) & 0x00ff00ffu) | ((x & 0x00ff00ffu) << 8);
  return (x >> 16) | (x << 16);
}

/// Owen's nested uniform scramble by hashing: every bit is flipped by a hash of the higher bits.
/// Source: Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020; the permutation of Laine & Karras (2011)
/// with the constants that Vegdahl found (2021), which are better mixed than the first ones.
constexpr std::uint32_t owen_scramble(std::uint32_t x, std::uint32_t seed) {
  x = reverse_bits(x);
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16) | 1u;
  x ^= x * 0x05526c56u;
  x ^= x * 0x53a22864u;
  return reverse_bits(x);
}

/// Primitive polynomial (degree, inner coefficients) and first direction numbers of one dimension.
struct SobolSeed {
  int degree;
  std::uint32_t polynomial;
  std::array<std::uint32_t, 7> m;
};

/// Dimensions 2 … 32 (the first is van der Corput's). Source: Joe & Kuo, "Constructing Sobol sequences with better
/// two-dimensional projections", SIAM J. Sci. Comput. 30 (2008), set new-joe-kuo-6.
inline constexpr std::array<SobolSeed, 31> sobol_seeds{{
    {1, 0, {1}},
    {2, 1, {1, 3}},
    {3, 1, {1, 3, 1}},
    {3, 2, {1, 1, 1}},
    {4, 1, {1, 1, 3, 3}},
    {4, 4, {1, 3, 5, 13}},
    {5, 2, {1, 1, 5, 5, 17}},
    {5, 4, {1, 1, 5, 5, 5}},
    {5, 7, {1, 1, 7, 11, 19}},
    {5, 11, {1, 1, 5, 1, 1}},
    {5, 13, {1, 1, 1, 3, 11}},
    {5, 14, {1, 3, 5, 5, 31}},
    {6, 1, {1, 3, 3, 9, 7, 49}},
    {6, 13, {1, 1, 1, 15, 21, 21}},
    {6, 16, {1, 3, 1, 13, 27, 49}},
    {6, 19, {1, 1, 1, 15, 7, 5}},
    {6, 22, {1, 3, 1, 15, 13, 25}},
    {6, 25, {1, 1, 5, 5, 19, 61}},
    {7, 1, {1, 3, 7, 11, 23, 15, 103}},
    {7, 4, {1, 3, 7, 13, 13, 15, 69}},
    {7, 7, {1, 1, 3, 13, 7, 35, 63}},
    {7, 8, {1, 3, 5, 9, 1, 25, 53}},
    {7, 14, {1, 3, 1, 13, 9, 35, 107}},
    {7, 19, {1, 3, 1, 5, 27, 61, 31}},
    {7, 21, {1, 1, 5, 11, 19, 41, 61}},
    {7, 28, {1, 3, 5, 3, 3, 13, 69}},
    {7, 31, {1, 1, 7, 13, 1, 19, 1}},
    {7, 32, {1, 3, 7, 5, 13, 19, 59}},
    {7, 37, {1, 1, 3, 9, 25, 29, 41}},
    {7, 41, {1, 3, 5, 13, 23, 1, 55}},
    {7, 42, {1, 3, 7, 3, 13, 59, 17}},
}};

/// A plain array, which a compiler fills faster than std::array.
struct SobolTable {
  std::uint32_t number[32][32];
};

/// Direction numbers, [dimension][bit]. Source: Bratley & Fox, Algorithm 659, ACM TOMS 14 (1988).
constexpr SobolTable make_sobol_table() {
  SobolTable table{};
  auto& v = table.number;
  for (std::uint32_t k = 0; k < 32; ++k) v[0][k] = 1u << (31 - k);
  for (std::size_t d = 1; d < 32; ++d) {
    const SobolSeed& seed = sobol_seeds[d - 1];
    const std::size_t s = std::size_t(seed.degree);
    for (std::size_t k = 0; k < 32; ++k) {
      if (k < s) {
        v[d][k] = seed.m[k] << (31 - k);
        continue;
      }
      v[d][k] = v[d][k - s] ^ (v[d][k - s] >> s);
      for (std::size_t j = 1; j < s; ++j)
        if ((seed.polynomial >> (s - 1 - j)) & 1u) v[d][k] ^= v[d][k - j];
    }
  }
  return table;
}

/// Made by the compiler, and so only where it is used.
inline constexpr SobolTable sobol_table = make_sobol_table();

/// Sobol's low-discrepancy sequence in up to 32 dimensions, in natural order: the first 2^m points are a digital net.
struct Sobol {
  static constexpr int dimensions = 32;

  /// Coordinate `dimension` of point `index` as a 32-bit binary fraction.
  static std::uint32_t bits(std::uint32_t index, int dimension) {
    std::uint32_t x = 0;
    for (std::size_t k = 0; index != 0; ++k, index >>= 1)
      if (index & 1u) x ^= sobol_table.number[dimension][k];
    return x;
  }
};

/// Sobol's sequence under a random Owen scramble per dimension: every point is uniform on [0, 1)^d, nets stay nets, and
/// different seeds are independent. Law: a pure function of (seed, index, dimension). Own code: libraries' generators
/// keep a state and are not scrambled.
struct OwenSobol {
  std::uint64_t seed = 0;

  /// In (0, 1): the middle of a cell of width 2^−32. Unchecked: dimension in [0, 32).
  double operator()(std::uint32_t index, int dimension) const {
    const std::uint32_t key = std::uint32_t(combine(seed, std::uint64_t(dimension)) >> 32);
    return (double(owen_scramble(Sobol::bits(index, dimension), key)) + 0.5) * 0x1p-32;
  }
};

}  // namespace lumo
