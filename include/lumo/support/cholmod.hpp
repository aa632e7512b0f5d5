#pragma once

// Adapter to SuiteSparse's CHOLMOD (its supernodal part is GPL-2+). Link with -lcholmod and a BLAS; OpenBLAS is much
// the fastest.

#include "lumo/mechanics/elements/linear_solver.hpp"

#include <suitesparse/cholmod.h>
#include <sys/mman.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <memory>
#include <mutex>
#include <new>
#include <utility>
#include <vector>

// Present only when the program is linked with OpenBLAS or an OpenMP run time.
extern "C" {
__attribute__((weak)) void openblas_set_num_threads(int threads);
__attribute__((weak)) void omp_set_max_active_levels(int levels);
__attribute__((weak)) int omp_get_max_active_levels();
}

namespace lumo {

namespace detail {

struct FreeFactor {
  cholmod_common* common = nullptr;
  void operator()(cholmod_factor* f) const { cholmod_free_factor(&f, common); }
};

// Debian's CHOLMOD opens OpenMP teams of four for every small front; scenarios run side by side, so one factor gets one
// thread.
class WithoutOpenMp {
 public:
  WithoutOpenMp() {
    if (!omp_set_max_active_levels || !omp_get_max_active_levels) return;
    levels_ = omp_get_max_active_levels();
    omp_set_max_active_levels(0);
  }
  ~WithoutOpenMp() {
    if (levels_ >= 0) omp_set_max_active_levels(levels_);
  }
  WithoutOpenMp(const WithoutOpenMp&) = delete;
  WithoutOpenMp& operator=(const WithoutOpenMp&) = delete;

 private:
  int levels_ = -1;
};

/// A thread's stay in BLAS. OpenBLAS maps a work area for each thread that is in it at a time and, when it gets none,
/// asks again for ever: so whether there is room is asked before. `more`: bytes that the caller will take before BLAS
/// does. Throws std::bad_alloc.
class BlasStay {
 public:
  explicit BlasStay(std::size_t more = 0) {
    const std::size_t bytes = std::size_t(++guests_) * work_area + more;
    void* room = openblas_set_num_threads
                     ? mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0)
                     : nullptr;
    if (room == MAP_FAILED) {
      --guests_;
      throw std::bad_alloc();
    }
    if (room) munmap(room, bytes);
  }
  ~BlasStay() { --guests_; }
  BlasStay(const BlasStay&) = delete;
  BlasStay& operator=(const BlasStay&) = delete;

 private:
  static constexpr std::size_t work_area = std::size_t(129) << 20;  // OpenBLAS's largest, with room to align it
  inline static std::atomic<int> guests_ = 0;
};

}  // namespace detail

/// A matrix in the order in which it is factorised, and the pattern of its factor: nested dissection (METIS; Karypis,
/// Kumar 1998), a third fewer operations here than minimum degree, which CHOLMOD would try first. One object per
/// thread; copies carry the analysis along. Throws std::bad_alloc. METIS replaces the process's handler of SIGTERM
/// while it orders: a program that must hear it blocks the signal in its threads and waits for it in one of them.
class CholmodAnalysis {
 public:
  using Factor = std::unique_ptr<cholmod_factor, detail::FreeFactor>;

  CholmodAnalysis() : common_(new cholmod_common, &finish) {
    cholmod_start(common_.get());
    common_->print = 0;
    common_->supernodal = CHOLMOD_SUPERNODAL;
    common_->nmethods = 1;
    common_->error_handler = nullptr;
    // One thread per factor: scenarios run side by side, and threads inside BLAS would change the order of sums.
    if (openblas_set_num_threads) openblas_set_num_threads(1);
  }
  CholmodAnalysis(const CholmodAnalysis& other) : CholmodAnalysis() { copy(other); }
  CholmodAnalysis& operator=(const CholmodAnalysis& other) {
    if (this != &other) copy(other);
    return *this;
  }
  CholmodAnalysis(CholmodAnalysis&&) = default;
  CholmodAnalysis& operator=(
      CholmodAnalysis&& other) noexcept {  // by exchange: a factor must be freed before the common block that made it
    std::swap(common_, other.common_);
    std::swap(symbolic_, other.symbolic_);
    order_.swap(other.order_);
    source_.swap(other.source_);
    matrix_.swap(other.matrix_);
    return *this;
  }

  void analyze(const SparseLower& lower) {
    // METIS draws from the C library's one random sequence: side by side, orderings and so the last bits of solutions
    // would differ.
    static std::mutex metis;
    const std::lock_guard one_at_a_time(metis);
    cholmod_sparse view = view_of(lower);
    common_->method[0].ordering = CHOLMOD_METIS;
    common_->postorder = 1;
    const Factor ordered = own(cholmod_analyze(&view, common_.get()));
    if (!ordered) throw std::bad_alloc();
    reorder(lower, static_cast<const int*>(ordered->Perm));
    // In that order CHOLMOD takes the matrix as it is, where it would else transpose it twice for each factor: a fifth
    // of the time.
    cholmod_sparse sorted = view_of(matrix_);
    common_->method[0].ordering = CHOLMOD_NATURAL;
    common_->postorder = 0;
    symbolic_ = own(cholmod_analyze(&sorted, common_.get()));
    if (!symbolic_) throw std::bad_alloc();
  }

  /// Takes over the values of a matrix of that pattern; false: not all are finite.
  bool take(const SparseLower& lower) {
    if (!Eigen::Map<const Eigen::ArrayXd>(lower.valuePtr(), lower.nonZeros()).isFinite().all()) return false;
    for (std::size_t k = 0; k < source_.size(); ++k) matrix_.valuePtr()[k] = lower.valuePtr()[source_[k]];
    return true;
  }

  const SparseLower& matrix() const { return matrix_; }          ///< in the factor's order
  const cholmod_factor& symbolic() const { return *symbolic_; }  ///< supernodal
  /// Columns with their rows in the factor's order, and back in the caller's.
  template <class Dense> Dense to_factor(const Dense& caller) const {
    Dense v(caller.rows(), caller.cols());
    for (Eigen::Index j = 0; j < v.cols(); ++j)
      for (Eigen::Index k = 0; k < v.rows(); ++k) v(k, j) = caller(order_[std::size_t(k)], j);
    return v;
  }
  template <class Dense> Dense to_caller(const Dense& factor) const {
    Dense v(factor.rows(), factor.cols());
    for (Eigen::Index j = 0; j < v.cols(); ++j)
      for (Eigen::Index k = 0; k < v.rows(); ++k) v(order_[std::size_t(k)], j) = factor(k, j);
    return v;
  }
  cholmod_common* common() const { return common_.get(); }
  cholmod_sparse view() const { return view_of(matrix_); }
  Factor own(cholmod_factor* f) const { return Factor(f, detail::FreeFactor{common_.get()}); }

 private:
  using Common = std::unique_ptr<cholmod_common, void (*)(cholmod_common*)>;

  static void finish(cholmod_common* c) {
    cholmod_finish(c);
    delete c;
  }
  void copy(const CholmodAnalysis& other) {
    symbolic_ = nullptr;
    if (other.symbolic_) symbolic_ = own(cholmod_copy_factor(other.symbolic_.get(), common_.get()));
    order_ = other.order_;
    source_ = other.source_;
    matrix_ = other.matrix_;
  }

  /// Takes over an order (new place → old) with the pattern in it, and where in the caller's values each of its values
  /// stands.
  void reorder(const SparseLower& lower, const int* order) {
    const int n = int(lower.cols());
    order_.assign(order, order + n);
    std::vector<int> place(order_.size());
    for (int k = 0; k < n; ++k) place[std::size_t(order_[std::size_t(k)])] = k;
    std::vector<Eigen::Triplet<double, int>> entries;  // with the number of the value, exact below 2⁵³
    entries.reserve(std::size_t(lower.nonZeros()));
    for (int j = 0; j < n; ++j)
      for (int e = lower.outerIndexPtr()[j]; e < lower.outerIndexPtr()[j + 1]; ++e) {
        const int a = place[std::size_t(lower.innerIndexPtr()[e])], b = place[std::size_t(j)];
        entries.emplace_back(std::max(a, b), std::min(a, b), double(e));
      }
    matrix_.resize(n, n);
    matrix_.setFromTriplets(entries.begin(), entries.end());
    source_.assign(matrix_.valuePtr(), matrix_.valuePtr() + matrix_.nonZeros());
  }

  static cholmod_sparse view_of(const SparseLower& lower) {
    cholmod_sparse a{};
    a.nrow = std::size_t(lower.rows());
    a.ncol = std::size_t(lower.cols());
    a.nzmax = std::size_t(lower.nonZeros());
    a.p = const_cast<int*>(lower.outerIndexPtr());
    a.i = const_cast<int*>(lower.innerIndexPtr());
    a.x = const_cast<double*>(lower.valuePtr());
    a.stype = -1;
    a.itype = CHOLMOD_INT;
    a.xtype = CHOLMOD_REAL;
    a.dtype = CHOLMOD_DOUBLE;
    a.sorted = 1;
    a.packed = 1;
    return a;
  }

  Common common_;
  Factor symbolic_;
  std::vector<int> order_;   // fill-reducing: new place → the caller's
  std::vector<int> source_;  // of each value of `matrix_`, in the caller's
  SparseLower matrix_;
};

/// Supernodal sparse Cholesky factorisation (Chen, Davis, Hager, Rajamanickam 2008). One object per thread; copies
/// carry the analysis along. Throws std::bad_alloc.
class Cholmod {
 public:
  Cholmod() = default;
  Cholmod(const Cholmod& other) : analysis_(other.analysis_) {}
  Cholmod& operator=(const Cholmod& other) {
    if (this == &other) return *this;
    factor_ = nullptr;
    analysis_ = other.analysis_;
    return *this;
  }
  Cholmod(Cholmod&&) = default;
  Cholmod& operator=(Cholmod&& other) noexcept {
    std::swap(analysis_, other.analysis_);
    std::swap(factor_, other.factor_);
    return *this;
  }

  void analyze(const SparseLower& lower) {
    factor_ = nullptr;
    analysis_.analyze(lower);
  }

  FactorStatus factorize(const SparseLower& lower) {
    // CHOLMOD factorises NaN without complaint, so finiteness is checked here.
    return analysis_.take(lower) ? factorize_taken() : FactorStatus::non_finite;
  }

  /// The same of the matrix whose values the analysis has.
  FactorStatus factorize_taken() {
    cholmod_common* const common = analysis_.common();
    cholmod_sparse view = analysis_.view();
    if (!factor_)
      factor_ = analysis_.own(cholmod_copy_factor(const_cast<cholmod_factor*>(&analysis_.symbolic()), common));
    if (!factor_) throw std::bad_alloc();
    common->status = CHOLMOD_OK;
    const detail::BlasStay stay(
        sizeof(double) * ((factor_->x ? 0 : factor_->xsize) + factor_->maxcsize + 8 * factor_->n));
    const detail::WithoutOpenMp one_thread;
    cholmod_factorize(&view, factor_.get(), common);
    if (common->status == CHOLMOD_OK && factor_->minor == factor_->n) return FactorStatus::positive_definite;
    if (common->status == CHOLMOD_OUT_OF_MEMORY) throw std::bad_alloc();
    return FactorStatus::not_positive_definite;
  }

  Eigen::MatrixXd solve(const Eigen::MatrixXd& rhs) {
    Eigen::MatrixXd ordered = analysis_.to_factor(rhs);
    cholmod_dense b{};
    b.nrow = std::size_t(rhs.rows());
    b.ncol = std::size_t(rhs.cols());
    b.nzmax = b.nrow * b.ncol;
    b.d = b.nrow;
    b.x = ordered.data();
    b.xtype = CHOLMOD_REAL;
    b.dtype = CHOLMOD_DOUBLE;
    const detail::BlasStay stay(8 * sizeof(double) * b.nzmax);
    const detail::WithoutOpenMp one_thread;
    cholmod_dense* x = cholmod_solve(CHOLMOD_A, factor_.get(), &b, analysis_.common());
    if (!x) throw std::bad_alloc();
    const Eigen::MatrixXd result = analysis_.to_caller<Eigen::MatrixXd>(
        Eigen::Map<const Eigen::MatrixXd>(static_cast<const double*>(x->x), rhs.rows(), rhs.cols()));
    cholmod_free_dense(&x, analysis_.common());
    return result;
  }

  /// Non-zeros of the factor.
  double factor_nonzeros() const { return analysis_.common()->lnz; }

  CholmodAnalysis& analysis() { return analysis_; }
  const CholmodAnalysis& analysis() const { return analysis_; }

 private:
  CholmodAnalysis analysis_;
  CholmodAnalysis::Factor factor_;
};

static_assert(LinearSolver<Cholmod>);

}  // namespace lumo
