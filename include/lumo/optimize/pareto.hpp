#pragma once

#include "lumo/core/types.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <numeric>
#include <vector>

namespace lumo {

/// Does `a` dominate `b`: at least as good everywhere, better somewhere? All objectives are maximised.
template <class A, class B> bool dominates(const Eigen::DenseBase<A>& a, const Eigen::DenseBase<B>& b) {
  return (a.derived().array() >= b.derived().array()).all() && (a.derived().array() > b.derived().array()).any();
}

/// Columns of `y` (objectives × points, maximised) that no other dominates, by falling first objective, equal ones by
/// index.
inline std::vector<Eigen::Index> pareto_front(const Eigen::MatrixXd& y) {
  std::vector<Eigen::Index> order(std::size_t(y.cols()));
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](Eigen::Index i, Eigen::Index k) {
    for (Eigen::Index j = 0; j < y.rows(); ++j)
      if (y(j, i) != y(j, k)) return y(j, i) > y(j, k);
    return false;
  });
  // No point dominates one before it in this order.
  std::vector<Eigen::Index> front;
  for (const Eigen::Index i : order) {
    const bool beaten = y.rows() == 2 ? !front.empty() && dominates(y.col(front.back()), y.col(i))
                                      : std::any_of(front.begin(), front.end(),
                                                    [&](Eigen::Index k) { return dominates(y.col(k), y.col(i)); });
    if (!beaten) front.push_back(i);
  }
  return front;
}

}  // namespace lumo
