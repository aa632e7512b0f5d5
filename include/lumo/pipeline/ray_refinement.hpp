#pragma once

namespace lumo {

/// Rays of a round of refinement, in those of round 0: 1, 1, 2, 2, 4, 4, 4, …
constexpr int rays_of(int round) { return round < 4 ? 1 << (round / 2) : 4; }

/// Rays of all rounds up to this one: 1, 2, 4, 6, 10, 14, 18, …
constexpr int rays_up_to(int round) {
  int all = 0;
  for (int r = 0; r <= round; ++r) all += rays_of(r);
  return all;
}

/// How the states that decide J_obs are known better than the others: each round traces those that undecided_states()
/// names with new rays, at first half as many as they have had (and the unloaded bodies on their meshes, too), until
/// there are none. What is still undecided then shows in the error.
struct RayRefinement {
  double tolerance = 0.015;  ///< wanted standard error of J_obs, and of all that might be less, as a fraction
  int rounds = 17;           ///< at most this many: rays_up_to(17) = 62; 0: everything is traced once
  double focus_m = 14e-3;    ///< the new rays' density falls by e over this distance from the contact's place
};

}  // namespace lumo
