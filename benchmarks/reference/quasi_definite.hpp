#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mechanics/elements/linear_solver.hpp"

#include <suitesparse/cholmod.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <vector>

namespace lumo::reference {

/// L D Lᵀ of a symmetric quasi-definite matrix without pivoting, multifrontal on the supernodes that CHOLMOD's analysis
/// finds. Such a matrix has that factorisation in every order (Vanderbei 1995), and the signs of D are its inertia
/// (Sylvester).
class QuasiDefinite {
 public:
  void analyze(const SparseLower& lower);

  /// Number of negative pivots; −1 when a pivot vanished or is not finite.
  int factorize(const SparseLower& lower);

  Eigen::VectorXd solve(const Eigen::VectorXd& rhs) const;

  double factor_nonzeros() const { return double(values_.size()); }

 private:
  using Dense = Eigen::MatrixXd;
  using Panel = Eigen::Map<Dense>;
  using ConstPanel = Eigen::Map<const Dense>;

  Eigen::Index columns(std::size_t s) const { return first_[s + 1] - first_[s]; }
  Eigen::Index rows(std::size_t s) const { return row_start_[s + 1] - row_start_[s]; }
  const int* row(std::size_t s) const { return rows_.data() + row_start_[s]; }
  bool eliminate(std::size_t s, Dense& update, int& negative);

  std::vector<int> order_, first_, row_start_, rows_;  // permutation; supernodes' first columns and row lists
  std::vector<std::int64_t> value_start_, slot_;  // supernode → panel, entry of the matrix → place in the panels
  std::vector<std::vector<int>> children_;
  std::vector<double> values_, pivots_;
};

inline void QuasiDefinite::analyze(const SparseLower& lower) {
  cholmod_common common;
  cholmod_start(&common);
  common.print = 0;
  common.supernodal = CHOLMOD_SUPERNODAL;
  cholmod_sparse view{};
  view.nrow = view.ncol = std::size_t(lower.rows());
  view.nzmax = std::size_t(lower.nonZeros());
  view.p = const_cast<int*>(lower.outerIndexPtr());
  view.i = const_cast<int*>(lower.innerIndexPtr());
  view.stype = -1;
  view.itype = CHOLMOD_INT;
  view.xtype = CHOLMOD_PATTERN;
  view.dtype = CHOLMOD_DOUBLE;
  view.sorted = view.packed = 1;
  cholmod_factor* f = cholmod_analyze(&view, &common);
  if (!f || !f->is_super) {
    cholmod_free_factor(&f, &common);
    cholmod_finish(&common);
    throw Error("symbolic factorisation failed");
  }
  const auto copy = [](const void* from, std::size_t n) {
    return std::vector<int>(static_cast<const int*>(from), static_cast<const int*>(from) + n);
  };
  const std::size_t n = f->n, supers = f->nsuper;
  order_ = copy(f->Perm, n);
  first_ = copy(f->super, supers + 1);
  row_start_ = copy(f->pi, supers + 1);
  rows_ = copy(f->s, f->ssize);
  cholmod_free_factor(&f, &common);
  cholmod_finish(&common);

  std::vector<int> inverse(n), owner(n);
  for (std::size_t k = 0; k < n; ++k) inverse[std::size_t(order_[k])] = int(k);
  value_start_.assign(supers + 1, 0);
  children_.assign(supers, {});
  for (std::size_t s = 0; s < supers; ++s) {
    for (int c = first_[s]; c < first_[s + 1]; ++c) owner[std::size_t(c)] = int(s);
    value_start_[s + 1] = value_start_[s] + rows(s) * columns(s);
  }
  for (std::size_t s = 0; s < supers; ++s)
    if (rows(s) > columns(s)) children_[std::size_t(owner[std::size_t(row(s)[columns(s)])])].push_back(int(s));
  slot_.clear();
  slot_.reserve(std::size_t(lower.nonZeros()));
  for (int j = 0; j < lower.outerSize(); ++j)
    for (SparseLower::InnerIterator it(lower, j); it; ++it) {
      const auto [c, r] = std::minmax(inverse[std::size_t(it.row())], inverse[std::size_t(it.col())]);
      const std::size_t s = std::size_t(owner[std::size_t(c)]);
      const auto at = std::lower_bound(row(s), row(s) + rows(s), r) - row(s);
      slot_.push_back(value_start_[s] + (c - first_[s]) * rows(s) + at);
    }
}

inline int QuasiDefinite::factorize(const SparseLower& lower) {
  values_.assign(std::size_t(value_start_.back()), 0.0);
  pivots_.assign(order_.size(), 0.0);
  for (std::size_t k = 0; k < slot_.size(); ++k) values_[std::size_t(slot_[k])] += lower.valuePtr()[k];
  std::vector<Dense> update(first_.size());
  std::vector<int> where(order_.size());
  int negative = 0;
  for (std::size_t s = 0; s + 1 < first_.size(); ++s) {
    const Eigen::Index nc = columns(s), nr = rows(s);
    Panel panel(values_.data() + value_start_[s], nr, nc);
    Dense& u = update[s];
    u.setZero(nr - nc, nr - nc);
    for (int k = 0; k < nr; ++k) where[std::size_t(row(s)[k])] = k;
    for (int child : children_[s]) {
      const std::size_t c = std::size_t(child);
      const int* list = row(c) + columns(c);
      Dense& from = update[c];
      for (Eigen::Index j = 0; j < from.cols(); ++j) {
        const Eigen::Index to = where[std::size_t(list[j])];
        double* column = to < nc ? panel.col(to).data() : u.col(to - nc).data() - nc;
        for (Eigen::Index i = j; i < from.rows(); ++i) column[where[std::size_t(list[i])]] += from(i, j);
      }
      from.resize(0, 0);
    }
    if (!eliminate(s, u, negative)) return -1;
  }
  return negative;
}

inline bool QuasiDefinite::eliminate(std::size_t s, Dense& update, int& negative) {
  constexpr Eigen::Index block = 48, stripe = 192;
  const Eigen::Index nc = columns(s), nr = rows(s), rest = nr - nc;
  Panel panel(values_.data() + value_start_[s], nr, nc);
  double* d = pivots_.data() + first_[s];
  for (Eigen::Index k = 0; k < nc; k += block) {
    const Eigen::Index b = std::min(block, nc - k), below = nr - k - b;
    for (Eigen::Index j = k; j < k + b; ++j) {
      const double pivot = panel(j, j);
      if (!std::isfinite(pivot) || pivot == 0.0) return false;
      d[j] = pivot;
      negative += pivot < 0.0;
      const Eigen::Index tail = k + b - j - 1;
      const Eigen::VectorXd unscaled = panel.col(j).segment(j + 1, tail);
      panel.col(j).segment(j + 1, tail) /= pivot;
      for (Eigen::Index i = 0; i < tail; ++i)
        panel.col(j + 1 + i).segment(j + 1 + i, tail - i) -= unscaled[i] * panel.col(j).segment(j + 1 + i, tail - i);
    }
    if (below == 0) continue;
    auto under = panel.block(k + b, k, below, b);
    panel.block(k, k, b, b).triangularView<Eigen::UnitLower>().transpose().solveInPlace<Eigen::OnTheRight>(under);
    const Dense scaled = under;  // L D
    under = scaled * Eigen::Map<const Eigen::VectorXd>(d + k, b).cwiseInverse().asDiagonal();
    for (Eigen::Index j = k + b; j < nc; j += stripe) {
      const Eigen::Index w = std::min(stripe, nc - j);
      panel.block(j, j, nr - j, w).noalias() -=
          panel.block(j, k, nr - j, b) * scaled.middleRows(j - k - b, w).transpose();
    }
  }
  if (rest == 0) return true;
  const auto lowest = panel.bottomRows(rest);
  const Dense scaled = lowest * Eigen::Map<const Eigen::VectorXd>(d, nc).asDiagonal();
  for (Eigen::Index j = 0; j < rest; j += stripe) {
    const Eigen::Index w = std::min(stripe, rest - j);
    update.block(j, j, rest - j, w).noalias() -= lowest.bottomRows(rest - j) * scaled.middleRows(j, w).transpose();
  }
  return true;
}

inline Eigen::VectorXd QuasiDefinite::solve(const Eigen::VectorXd& rhs) const {
  Eigen::VectorXd y(rhs.size()), gathered;
  for (std::size_t k = 0; k < order_.size(); ++k) y[Eigen::Index(k)] = rhs[order_[k]];
  const auto panel = [&](std::size_t s) { return ConstPanel(values_.data() + value_start_[s], rows(s), columns(s)); };
  for (std::size_t s = 0; s + 1 < first_.size(); ++s) {
    const auto p = panel(s);
    auto own = y.segment(first_[s], columns(s));
    p.topRows(columns(s)).triangularView<Eigen::UnitLower>().solveInPlace(own);
    gathered.noalias() = p.bottomRows(rows(s) - columns(s)) * own;
    for (Eigen::Index k = 0; k < gathered.size(); ++k) y[row(s)[columns(s) + k]] -= gathered[k];
  }
  y.array() /= Eigen::Map<const Eigen::ArrayXd>(pivots_.data(), y.size());
  for (std::size_t s = first_.size() - 1; s-- > 0;) {
    const auto p = panel(s);
    auto own = y.segment(first_[s], columns(s));
    gathered.resize(rows(s) - columns(s));
    for (Eigen::Index k = 0; k < gathered.size(); ++k) gathered[k] = y[row(s)[columns(s) + k]];
    own.noalias() -= p.bottomRows(gathered.size()).transpose() * gathered;
    p.topRows(columns(s)).triangularView<Eigen::UnitLower>().transpose().solveInPlace(own);
  }
  Eigen::VectorXd x(rhs.size());
  for (std::size_t k = 0; k < order_.size(); ++k) x[order_[k]] = y[Eigen::Index(k)];
  return x;
}

}  // namespace lumo::reference
