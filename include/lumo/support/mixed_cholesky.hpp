#pragma once

// A sparse Cholesky factor in single precision with CHOLMOD's analysis (see cholmod.hpp), refined in double. Link with
// -lcholmod and a BLAS; OpenBLAS is much the fastest.

#include "lumo/core/sobol.hpp"
#include "lumo/support/cholmod.hpp"

#include <cblas.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

namespace lumo {

namespace detail {

// The supernodes of a factor and where everything goes. Columns of a supernode have the same rows below them; the dense
// panel that holds them and the update that they leave to later ones are a front.
struct FrontalPlan {
  struct Front {
    int first, columns;       // of the matrix
    int rows;                 // of the panel, its own columns' among them
    std::size_t row_numbers;  // where they start in `row`
    std::size_t panel;        // where it starts among the values
    int parent;               // that takes its update; −1: none
    int level;                // depth in the tree
    int last_child, before;   // the child that comes last, and the front's sibling before it; −1: none
  };
  std::vector<Front> fronts;             // children before parents, each subtree without a gap
  std::vector<int> row;                  // rows of all panels
  std::vector<int> in_parent;            // the same below the diagonal: places in the parent's panel or update
  std::vector<std::size_t> destination;  // of each of the matrix's values among those of the panels
  std::size_t values = 0;
  std::array<std::size_t, 2> stack = {0, 0};  // room for the updates of even and of odd levels
  int widest = 0;                             // most rows below a panel

  explicit FrontalPlan(const CholmodAnalysis& analysis);
};

inline FrontalPlan::FrontalPlan(const CholmodAnalysis& analysis) {
  const cholmod_factor& symbolic = analysis.symbolic();
  const int* super = static_cast<const int*>(symbolic.super);
  const int* start = static_cast<const int*>(symbolic.pi);
  const int* rows = static_cast<const int*>(symbolic.s);
  const std::size_t count = symbolic.nsuper, n = symbolic.n;
  std::vector<int> front_of(n);
  for (std::size_t s = 0; s < count; ++s)
    for (int c = super[s]; c < super[s + 1]; ++c) front_of[std::size_t(c)] = int(s);
  row.assign(rows, rows + start[count]);
  in_parent.assign(row.size(), 0);
  for (std::size_t s = 0; s < count; ++s) {
    Front f{super[s], super[s + 1] - super[s], start[s + 1] - start[s], std::size_t(start[s]), values, -1, 0, -1, -1};
    std::sort(row.begin() + start[s], row.begin() + start[s + 1]);
    if (f.rows > f.columns) f.parent = front_of[std::size_t(row[f.row_numbers + std::size_t(f.columns)])];
    values += std::size_t(f.rows) * std::size_t(f.columns);
    widest = std::max(widest, f.rows - f.columns);
    fronts.push_back(f);
  }
  for (std::size_t s = count; s-- > 0;) {
    Front& f = fronts[s];
    if (f.parent < 0) continue;
    const Front& p = fronts[std::size_t(f.parent)];
    f.level = p.level + 1;
    std::size_t at = p.row_numbers;
    for (std::size_t k = f.row_numbers + std::size_t(f.columns); k < f.row_numbers + std::size_t(f.rows); ++k) {
      while (row[at] != row[k]) ++at;
      in_parent[k] = int(at - p.row_numbers);
    }
  }
  for (std::size_t s = 0; s < count; ++s)
    if (Front& f = fronts[s]; f.parent >= 0) f.before = std::exchange(fronts[std::size_t(f.parent)].last_child, int(s));
  std::array<std::size_t, 2> top = {0, 0};
  for (std::size_t s = 0; s < count; ++s) {
    const Front& f = fronts[s];
    const auto room = [&](const Front& g) { return std::size_t(g.rows - g.columns) * std::size_t(g.rows - g.columns); };
    top[std::size_t(f.level) % 2] += room(f);
    stack[std::size_t(f.level) % 2] = std::max(stack[std::size_t(f.level) % 2], top[std::size_t(f.level) % 2]);
    for (int c = f.last_child; c >= 0; c = fronts[std::size_t(c)].before)
      top[1 - std::size_t(f.level) % 2] -= room(fronts[std::size_t(c)]);
  }
  const SparseLower& matrix = analysis.matrix();
  destination.reserve(std::size_t(matrix.nonZeros()));
  for (int j = 0; j < matrix.cols(); ++j) {
    const Front& f = fronts[std::size_t(front_of[std::size_t(j)])];
    std::size_t at = f.row_numbers;
    for (int e = matrix.outerIndexPtr()[j]; e < matrix.outerIndexPtr()[j + 1]; ++e) {
      while (row[at] != matrix.innerIndexPtr()[e]) ++at;
      destination.push_back(f.panel + std::size_t(j - f.first) * std::size_t(f.rows) + (at - f.row_numbers));
    }
  }
}

// Cholesky factor of the first `columns` rows of a panel, and the rows below it divided by that; false: a pivot is not
// positive.
inline bool factor_panel(float* a, int rows, int columns, int stride) {
  constexpr int narrow = 24;
  if (columns > narrow) {
    const int left = (columns / 2 + 7) / 8 * 8, right = columns - left, below = rows - left;
    if (!factor_panel(a, rows, left, stride)) return false;
    float* corner = a + left + std::size_t(left) * std::size_t(stride);
    cblas_sgemm(CblasColMajor, CblasNoTrans, CblasTrans, below, right, left, -1.0f, a + left, stride, a + left, stride,
        1.0f, corner, stride);
    return factor_panel(corner, below, right, stride);
  }
  for (int j = 0; j < columns; ++j) {
    float* column = a + std::size_t(j) * std::size_t(stride);
    if (!(column[j] > 0.0f) || !(column[j] < std::numeric_limits<float>::infinity())) return false;
    const float pivot = std::sqrt(column[j]), inverse = 1.0f / pivot;
    column[j] = pivot;
    for (int i = j + 1; i < columns; ++i) column[i] *= inverse;
    for (int k = j + 1; k < columns; ++k) {
      float* other = a + std::size_t(k) * std::size_t(stride);
      const float factor = column[k];
      for (int i = k; i < columns; ++i) other[i] -= factor * column[i];
    }
  }
  if (const int below = rows - columns; below > 0)
    cblas_strsm(CblasColMajor, CblasRight, CblasLower, CblasTrans, CblasNonUnit, below, columns, 1.0f, a, stride,
        a + columns, stride);
  return true;
}

}  // namespace detail

/// Sparse Cholesky factorisation in single precision, front by front (Duff, Reid 1983, doi:10.1145/356044.356047), with
/// solutions refined in double by conjugate gradients (Buttari et al. 2008, doi:10.1145/1377596.1377597): half the time
/// and half the memory of a factor in double. A matrix whose factor breaks down in single precision is factorised in
/// double. One object per thread; copies carry the analysis along. Throws std::bad_alloc.
class MixedCholesky {
 public:
  MixedCholesky() = default;
  MixedCholesky(const MixedCholesky& other) : exact_(other.exact_), plan_(other.plan_) {}
  MixedCholesky& operator=(const MixedCholesky& other) {
    if (this == &other) return *this;
    exact_ = other.exact_;
    plan_ = other.plan_;
    single_ = false;
    return *this;
  }
  MixedCholesky(MixedCholesky&&) = default;
  MixedCholesky& operator=(MixedCholesky&&) = default;

  void analyze(const SparseLower& lower) {
    exact_.analyze(lower);
    plan_ = std::make_shared<const detail::FrontalPlan>(exact_.analysis());
    single_ = false;
  }

  /// A factor to solve with. That it exists does not yet prove that the matrix is positive definite: certify() does.
  FactorStatus factorize(const SparseLower& lower) {
    if (!exact_.analysis().take(lower)) return FactorStatus::non_finite;
    single_ = factorize_single();
    return single_ ? FactorStatus::positive_definite : exact_.factorize_taken();
  }

  /// Is the matrix that was factorised positive definite? With a factor M in single precision the question is whether
  /// M⁻¹A has only positive eigenvalues. A random vector is multiplied by I − M⁻¹A some times: where all eigenvalues
  /// are within (0, 2) it shrinks; one ≤ 0 keeps its part of the vector, which is then seen to stop shrinking. What is
  /// not seen to shrink is factorised in double.
  FactorStatus certify() {
    if (!single_) return FactorStatus::positive_definite;
    const Eigen::Index n = exact_.analysis().matrix().cols();
    Eigen::VectorXd v(n);
    for (Eigen::Index k = 0; k < n; ++k) v[k] = double(combine(0, std::uint64_t(k)) >> 11) * 0x1p-52 - 1.0;
    for (int k = 0; k < certifying_steps; ++k) {
      const double before = v.norm();
      v -= apply(multiply(v));
      if (!(v.norm() < certified_contraction * before)) {
        single_ = false;
        return exact_.factorize_taken();
      }
    }
    return FactorStatus::positive_definite;
  }

  /// Solution with the factor as it is: four to six digits.
  Eigen::VectorXd precondition(const Eigen::VectorXd& rhs) {
    if (!single_) return exact_.solve(rhs);
    return exact_.analysis().to_caller(apply(exact_.analysis().to_factor(rhs)));
  }

  /// Solution whose residual is 1e-10 of the right-hand side.
  Eigen::MatrixXd solve(const Eigen::MatrixXd& rhs) {
    Eigen::MatrixXd x(rhs.rows(), rhs.cols());
    for (Eigen::Index j = 0; j < rhs.cols() && single_; ++j) {
      const Eigen::VectorXd b = exact_.analysis().to_factor<Eigen::VectorXd>(rhs.col(j));
      Eigen::VectorXd y = Eigen::VectorXd::Zero(b.size()), r = b, p;
      double rz = 0.0;
      const double wanted = refined * b.norm();
      for (int k = 0; r.norm() > wanted; ++k) {
        if (k == most_refinements) {
          single_ = false;
          if (exact_.factorize_taken() != FactorStatus::positive_definite)
            return Eigen::MatrixXd::Constant(rhs.rows(), rhs.cols(), std::numeric_limits<double>::quiet_NaN());
          break;
        }
        const Eigen::VectorXd z = apply(r);
        const double product = r.dot(z);
        p = k == 0 ? z : Eigen::VectorXd(z + product / rz * p);
        rz = product;
        const Eigen::VectorXd Ap = multiply(p);
        const double step = rz / p.dot(Ap);
        y += step * p;
        r -= step * Ap;
      }
      x.col(j) = exact_.analysis().to_caller(y);
    }
    return single_ ? x : exact_.solve(rhs);
  }

  /// Is the factor the one in single precision?
  bool is_single() const { return single_; }

 private:
  static constexpr int certifying_steps = 3;
  static constexpr double certified_contraction = 0.5;
  static constexpr double refined = 1e-10;
  static constexpr int most_refinements = 20;

  bool factorize_single();
  // M⁻¹ r, in the factor's order.
  Eigen::VectorXd apply(const Eigen::VectorXd& r);

  // A v, in the factor's order.
  Eigen::VectorXd multiply(const Eigen::VectorXd& v) const {
    const SparseLower& a = exact_.analysis().matrix();
    Eigen::VectorXd w = Eigen::VectorXd::Zero(v.size());
    for (int j = 0; j < a.cols(); ++j) {
      const int begin = a.outerIndexPtr()[j], end = a.outerIndexPtr()[j + 1];
      const double vj = v[j];
      double sum = a.valuePtr()[begin] * vj;
      for (int e = begin + 1; e < end; ++e) {
        const int i = a.innerIndexPtr()[e];
        sum += a.valuePtr()[e] * v[i];
        w[i] += a.valuePtr()[e] * vj;
      }
      w[j] += sum;
    }
    return w;
  }

  Cholmod exact_;  // the analysis, the matrix, and the factor where single precision does not do
  std::shared_ptr<const detail::FrontalPlan> plan_;
  std::vector<float> panels_;
  std::array<std::vector<float>, 2> updates_;  // of even and of odd levels
  bool single_ = false;
};

inline bool MixedCholesky::factorize_single() {
  const detail::FrontalPlan& plan = *plan_;
  const SparseLower& a = exact_.analysis().matrix();
  panels_.assign(plan.values, 0.0f);
  for (std::size_t k = 0; k < 2; ++k) updates_[k].resize(plan.stack[k]);
  for (std::size_t e = 0; e < plan.destination.size(); ++e) panels_[plan.destination[e]] = float(a.valuePtr()[e]);
  const detail::BlasStay stay;
  const detail::WithoutOpenMp one_thread;
  std::array<std::size_t, 2> top = {0, 0};
  for (std::size_t s = 0; s < plan.fronts.size(); ++s) {
    const detail::FrontalPlan::Front& f = plan.fronts[s];
    const int below = f.rows - f.columns;
    float* panel = panels_.data() + f.panel;
    const std::size_t own = std::size_t(f.level) % 2, other = 1 - own;
    float* update = updates_[own].data() + top[own];
    bool empty = true;
    // The children's updates lie on top of the other stack, the last one's first.
    for (int c = f.last_child; c >= 0; c = plan.fronts[std::size_t(c)].before) {
      const detail::FrontalPlan::Front& child = plan.fronts[std::size_t(c)];
      const int width = child.rows - child.columns;
      if (empty && below > 0) {
        std::fill_n(update, std::size_t(below) * std::size_t(below), 0.0f);
        empty = false;
      }
      top[other] -= std::size_t(width) * std::size_t(width);
      const float* from = updates_[other].data() + top[other];
      const int* place = plan.in_parent.data() + child.row_numbers + child.columns;
      for (int j = 0; j < width; ++j, from += width) {
        const int column = place[j];
        float* to = column < f.columns ? panel + std::size_t(column) * std::size_t(f.rows)
                                       : update + std::size_t(column - f.columns) * std::size_t(below) - f.columns;
        for (int i = j; i < width; ++i) to[place[i]] += from[i];
      }
    }
    if (!detail::factor_panel(panel, f.rows, f.columns, f.rows)) return false;
    if (below > 0) {
      cblas_ssyrk(CblasColMajor, CblasLower, CblasNoTrans, below, f.columns, -1.0f, panel + f.columns, f.rows,
          empty ? 0.0f : 1.0f, update, below);
    }
    top[own] += std::size_t(below) * std::size_t(below);
  }
  return true;
}

inline Eigen::VectorXd MixedCholesky::apply(const Eigen::VectorXd& r) {
  using Panel = Eigen::Map<const Eigen::MatrixXf, 0, Eigen::OuterStride<>>;
  const detail::FrontalPlan& plan = *plan_;
  const double size = r.cwiseAbs().maxCoeff();
  if (!(size > 0.0) || !std::isfinite(size)) return r;
  Eigen::VectorXf x = (r / size).cast<float>();  // so that no part of it is lost below the least float
  Eigen::VectorXf below(plan.widest);
  for (const detail::FrontalPlan::Front& f : plan.fronts) {
    const int rest = f.rows - f.columns;
    const Panel panel(panels_.data() + f.panel, f.rows, f.columns, Eigen::OuterStride<>(f.rows));
    auto own = x.segment(f.first, f.columns);
    panel.topRows(f.columns).triangularView<Eigen::Lower>().solveInPlace(own);
    if (rest == 0) continue;
    below.head(rest).noalias() = panel.bottomRows(rest) * own;
    const int* row = plan.row.data() + f.row_numbers + f.columns;
    for (int i = 0; i < rest; ++i) x[row[i]] -= below[i];
  }
  for (std::size_t s = plan.fronts.size(); s-- > 0;) {
    const detail::FrontalPlan::Front& f = plan.fronts[s];
    const int rest = f.rows - f.columns;
    const Panel panel(panels_.data() + f.panel, f.rows, f.columns, Eigen::OuterStride<>(f.rows));
    auto own = x.segment(f.first, f.columns);
    if (rest > 0) {
      const int* row = plan.row.data() + f.row_numbers + f.columns;
      for (int i = 0; i < rest; ++i) below[i] = x[row[i]];
      own.noalias() -= panel.bottomRows(rest).transpose() * below.head(rest);
    }
    panel.topRows(f.columns).triangularView<Eigen::Lower>().transpose().solveInPlace(own);
  }
  return size * x.cast<double>();
}

static_assert(RefiningSolver<MixedCholesky>);

}  // namespace lumo
