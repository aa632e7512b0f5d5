#pragma once

#include "lumo/optimize/design_sampler.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <concepts>
#include <cstdint>
#include <functional>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

namespace lumo {

/// The input of a source of candidates.
struct CandidateRequest {
  const DesignSampler& sampler;
  const DesignSet& taken;            ///< never to be proposed
  const std::vector<Design>& front;  ///< observed designs that no other dominates, by falling first objective
  std::uint64_t key;
};

/// Utility of designs (columns), larger is better; may be −∞.
using Score = std::function<Eigen::VectorXd(const Eigen::MatrixXd&)>;

/// Searches a space for the design of highest score. Laws: the design is feasible and not taken; nullopt only if no
/// such design is found; a pure function of request and scores.
template <class S>
concept CandidateSource = requires(const S& source, const CandidateRequest& request, const Score& score) {
  { source.best(request, score) } -> std::convertible_to<std::optional<Design>>;
};

/// Designs as the columns of a matrix of `rows` variables.
inline Eigen::MatrixXd design_columns(const std::vector<Design>& designs, std::size_t rows) {
  Eigen::MatrixXd x(Eigen::Index(rows), Eigen::Index(designs.size()));
  for (std::size_t i = 0; i < designs.size(); ++i)
    x.col(Eigen::Index(i)) = Eigen::Map<const Eigen::VectorXd>(designs[i].data(), Eigen::Index(rows));
  return x;
}

/// The paper's: a number of fresh feasible designs, the best of them.
struct FreshCandidates {
  std::size_t count = 256;

  std::optional<Design> best(const CandidateRequest& request, const Score& score) const {
    const auto pool = request.sampler.fresh(count, request.key, request.taken);
    if (pool.empty()) return std::nullopt;
    Eigen::Index top = 0;
    score(design_columns(pool, request.sampler.dimensions())).maxCoeff(&top);
    return pool[std::size_t(top)];
  }
};

/// Fresh designs and moves from the current front, and from the best of those uphill by pattern search, until no move
/// on the finest lattice helps. This is a discrete local search on a lattice; steps are halved elsewhere. Source: Hooke
/// & Jeeves, J. ACM 8 (1961).
struct LocalSearchCandidates {
  std::size_t fresh = 256;
  std::size_t from_front = 256;  ///< at most
  std::size_t climbers = 6;      ///< places that are searched from
  double reach = 0.08;           ///< first move, relative to a variable's range
  int random_moves = 12;         ///< per climber and round, besides those along axes
  int rounds = 25;

  std::optional<Design> best(const CandidateRequest& request, const Score& score) const {
    const std::vector<Design> designs = pool(request);
    if (designs.empty()) return std::nullopt;
    std::vector<Climber> team = best_of(designs, request, score);
    for (int round = 0; round < rounds; ++round)
      if (!climb(team, round, request, score)) break;
    return std::max_element(team.begin(), team.end(), [](const Climber& a, const Climber& b) {
      return a.score < b.score;
    })->x;
  }

 private:
  struct Climber {
    Design x;
    double score;
    double reach;
    bool stuck = false;
  };
  // Fresh designs, and moves from the front: a random choice of them if the front is long.
  std::vector<Design> pool(const CandidateRequest& request) const {
    const DesignSampler& sampler = request.sampler;
    std::vector<Design> all = sampler.fresh(fresh, request.key, request.taken);
    DesignSet seen(all.begin(), all.end());
    std::vector<Design> near;
    for (std::size_t i = 0; i < request.front.size(); ++i)
      for (const double r : {0.25 * reach, reach})
        for (Design& x : sampler.moves(request.front[i], r, random_moves, combine(combine(request.key, 1), i)))
          if (!request.taken.contains(x) && seen.insert(x).second) near.push_back(std::move(x));
    for (std::size_t i = 0; i < near.size() && i < from_front; ++i)
      std::swap(near[i], near[i + combine(combine(request.key, 2), i) % (near.size() - i)]);
    if (near.size() > from_front) near.resize(from_front);
    all.insert(all.end(), near.begin(), near.end());
    return all;
  }
  std::vector<Climber> best_of(
      const std::vector<Design>& designs, const CandidateRequest& request, const Score& score) const {
    const Eigen::VectorXd scores = score(design_columns(designs, request.sampler.dimensions()));
    std::vector<std::size_t> order(designs.size());
    std::iota(order.begin(), order.end(), std::size_t(0));
    std::stable_sort(order.begin(), order.end(),
        [&](std::size_t a, std::size_t b) { return scores[Eigen::Index(a)] > scores[Eigen::Index(b)]; });
    std::vector<Climber> team;
    for (std::size_t i = 0; i < order.size() && team.size() < climbers; ++i)
      team.push_back({designs[order[i]], scores[Eigen::Index(order[i])], reach});
    return team;
  }
  // Moves each climber to the best of its moves, or halves its reach. False: all are stuck.
  bool climb(std::vector<Climber>& team, int round, const CandidateRequest& request, const Score& score) const {
    const DesignSampler& sampler = request.sampler;
    std::vector<Design> moves;
    std::vector<std::size_t> owner;
    for (std::size_t c = 0; c < team.size(); ++c) {
      if (team[c].stuck) continue;
      for (Design& x : sampler.moves(
               team[c].x, team[c].reach, random_moves, combine(combine(request.key, 3 + std::uint64_t(round)), c)))
        if (!request.taken.contains(x)) {
          moves.push_back(std::move(x));
          owner.push_back(c);
        }
    }
    std::vector<Climber> next = team;
    if (!moves.empty()) {
      const Eigen::VectorXd values = score(design_columns(moves, sampler.dimensions()));
      for (std::size_t i = 0; i < moves.size(); ++i)
        if (values[Eigen::Index(i)] > next[owner[i]].score)
          next[owner[i]] = {moves[i], values[Eigen::Index(i)], team[owner[i]].reach};
    }
    bool all_stuck = true;
    for (std::size_t c = 0; c < team.size(); ++c) {
      if (!next[c].stuck && next[c].x == team[c].x) {
        next[c].stuck = sampler.finest(team[c].reach);
        next[c].reach *= 0.5;
      }
      for (std::size_t b = 0; b < c; ++b)
        next[c].stuck = next[c].stuck || next[c].x == next[b].x;  // two on one place: one is enough
      all_stuck = all_stuck && next[c].stuck;
    }
    team = std::move(next);
    return !all_stuck;
  }
};

static_assert(CandidateSource<FreshCandidates>);
static_assert(CandidateSource<LocalSearchCandidates>);

}  // namespace lumo
