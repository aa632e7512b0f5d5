#pragma once

#include "lumo/mechanics/contact_set.hpp"
#include "lumo/mechanics/press_system.hpp"
#include "lumo/mechanics/state.hpp"

#include <chrono>

namespace lumo {

/// Static equilibrium at prescribed loads: the indenter's advance is an unknown, so that each load is met exactly (model: solver policy
/// "quasi-static"). Newton's method on energy(x, s) − F s, load by load along 0 → F₁ → F₂ ….
///
/// The stiff parts of the energy, volume change and contact, are linearised about values that are carried on *linearly* by each step
/// (volume ratios θ, gaps γ) instead of those that the moved nodes happen to have: a step's second-order errors in volume then make no
/// spurious pressure, the tangent stays positive definite, and contact points change sides by what the step meant. This is Newton's method
/// for the mixed problem with θ and γ eliminated; its solution is that of the plain one (Magisano, Leonetti, Garcea 2017 for stresses;
/// Hintermüller, Ito, Kunisch 2002 for contact). A factor is used again as long as it contracts.
///
/// At each load the unshifted tangent of the *whole* body must be positive definite, fields that break the scenario's symmetry included;
/// otherwise the status says so.
struct QuasiStatic {
  struct Config {
    double residual_tolerance = 1e-7;   ///< of the load
    int max_iterations = 200;           ///< factorisations per load
    double chord_contraction = 0.15;    ///< a kept factor must shrink the residual by this factor per step
    double load_stride = 4.0;           ///< loads in between are at most this factor apart
    double max_advance = 0.2;           ///< largest advance in one step, in indenter radii
    double time_limit_s = 1e9;          ///< per scenario, wall clock
  };
  Config config = {};

  /// States at the scenario's loads, displacements on the sector's nodes; after the first that is not converged no further one is tried
  /// (it carries the reason).
  template <class Model, Indenter Tool>
  std::vector<MechanicalState> run(const Model& model, const Scenario<Tool>& scenario, const Touch& touch) const;
};

namespace detail {

template <class Model, Indenter Tool>
class QuasiStaticRun {
 public:
  QuasiStaticRun(const Model& model, const Scenario<Tool>& scenario, const Touch& touch, const QuasiStatic::Config& config)
      : config_(config), model_(model), system_{model, scenario.indenter, touch.origin, scenario.direction()},
        eq_(model.blocks.front().equations), linear_(model.blocks.front().analysed), now_{positions_of(model.sector.mesh), 0.0},
        deadline_(std::chrono::steady_clock::now() + std::chrono::duration_cast<std::chrono::steady_clock::duration>(
                                                         std::chrono::duration<double>(std::min(config.time_limit_s, 1e6)))) {}

  /// Equilibrium at `load` (the sector's share), from where the last call ended.
  Status solve(double load) {
    iterations = 0;
    // A contact patch far smaller than the next one is a poor start: the way there is taken in loose strides.
    for (double from = std::max(load_, load / 50.0); from < load; from *= config_.load_stride) {
      if (from <= load_) continue;
      if (const Status s = approach(from, 0.05); s != Status::converged) return s;
    }
    load_ = load;
    const Status s = approach(load, config_.residual_tolerance);
    return s == Status::converged ? certify_stability() : s;
  }

  const Positions& positions() const { return now_.x; }
  double advance() const { return now_.advance; }
  int iterations = 0;

 private:
  using System = PressSystem<Model, Tool>;

  Status approach(double load, double tolerance) {
    if (now_.advance == 0.0) first_overlap(load);
    auto seen = system_.predicted(now_, now_, Positions::Zero(3, now_.x.cols()), 0.0);
    if (!have_factor_) enter(seen.touch, {});
    double last = std::numeric_limits<double>::infinity();
    for (;;) {
      const auto r = system_.residual(now_.x, now_.advance, load, eq_, &seen);
      if (!std::isfinite(r.norm())) return Status::non_finite;
      // The plain residual is what counts; it is looked at when the linearised one is small.
      if (r.norm() <= tolerance * load && system_.residual(now_.x, now_.advance, load, eq_).norm() <= tolerance * load) return Status::converged;
      if (std::chrono::steady_clock::now() > deadline_) return Status::time_limit;
      if (!have_factor_ || r.norm() > config_.chord_contraction * last) {
        if (iterations >= config_.max_iterations) return Status::max_iterations;
        if (const Status s = factorize(seen); s != Status::converged) return s;
      }
      last = r.norm();
      if (const Status s = step(r, seen); s != Status::converged) return s;
    }
  }

  // The first load starts from a rigid overlap that pushes back with that load.
  void first_overlap(double load) {
    double high = 1e-9;
    const auto push = [&](double s) { return add_contact_forces(model_.touchable, model_.contact, system_.indenter(s), now_.x, nullptr).push_N; };
    while (push(high) < load && high < system_.tool.radius_m()) high *= 1.5;
    now_.advance = high;
  }

  // A point that has just come into contact overlaps by what the last step did not know of; that overlap is to be undone, but it is no
  // pressure yet that could bend the tangent.
  static void enter(SeenGaps& gaps, const SeenGaps& before) {
    for (std::size_t f = 0; f < gaps.size(); ++f)
      for (std::size_t k = 0; k < gaps[f].size(); ++k)
        if (gaps[f][k] < 0.0 && (before.empty() || before[f][k] >= 0.0)) gaps[f][k] = -1e-15;
  }

  // Only on the way may the tangent be shifted until it is positive definite: at the end the unshifted one is tested.
  Status factorize(const typename System::Seen& seen) {
    system_.tangent(now_.x, now_.advance, 0, 1, tangent_, &seen);
    SparseLower& m = tangent_.matrix.front();
    const double unit = model_.solid.material().shear_modulus() * std::cbrt(smallest_volume());
    double shift = 0.0;
    for (int attempt = 0; attempt < 8; ++attempt) {
      ++iterations;
      const FactorStatus f = linear_.factorize(m);
      if (f == FactorStatus::non_finite) return Status::non_finite;
      if (f == FactorStatus::positive_definite && border()) {
        have_factor_ = true;
        factored_ = now_;
        return Status::converged;
      }
      const double more = shift == 0.0 ? 0.03 : 10.0 * shift;
      for (int k = 0; k < eq_.count; ++k) m.valuePtr()[m.outerIndexPtr()[k]] += (more - shift) * unit;
      shift = more;
    }
    return Status::not_positive_definite;
  }

  bool border() {
    response_ = linear_.solve(tangent_.coupling);
    schur_ = tangent_.stiffness - tangent_.coupling.dot(response_);
    return std::isfinite(schur_) && schur_ > 0.0;
  }

  double smallest_volume() const {
    double least = std::numeric_limits<double>::infinity();
    for (const auto& t : model_.sector.mesh.tets) {
      const auto at = [&](std::size_t k) -> const Vec3& { return model_.sector.mesh.nodes[std::size_t(t[k])]; };
      least = std::min(least, (at(1) - at(0)).cross(at(2) - at(0)).dot(at(3) - at(0)) / 6.0);
    }
    return least;
  }

  // A full Newton step unless the indenter would jump or an element would be turned inside out.
  Status step(const typename System::Residual& r, typename System::Seen& seen) {
    const Eigen::VectorXd z = linear_.solve(r.free);
    const double ds = (-r.advance + tangent_.coupling.dot(z)) / schur_;
    const Eigen::VectorXd du = -z - response_ * ds;
    if (!std::isfinite(ds) || !du.allFinite()) return Status::non_finite;
    const double now = model_.solid.smallest_J(now_.x);
    double t = std::min(1.0, config_.max_advance * system_.tool.radius_m() / std::max(std::abs(ds), 1e-300));
    Positions dx = Positions::Zero(3, now_.x.cols());
    System::move(dx, eq_, du, 1.0);
    for (int k = 0; k < 20; ++k, t *= 0.5) {
      const Positions trial = now_.x + t * dx;
      if (!(model_.solid.smallest_J(trial) > 0.2 * now)) continue;
      auto next = system_.predicted(now_, factored_, t * dx, t * ds);
      if (!(*std::min_element(next.ratios.begin(), next.ratios.end()) > 0.2)) continue;
      enter(next.touch, seen.touch);
      enter(next.rest, seen.rest);
      seen = std::move(next);
      now_.x = trial;
      now_.advance += t * ds;
      return Status::converged;
    }
    return Status::inverted;
  }

  // Unshifted tangents of all parities at the state that was reached; the even one serves as the next load's predictor.
  Status certify_stability() {
    have_factor_ = false;
    system_.tangent(now_.x, now_.advance, 0, 1, tangent_);
    const FactorStatus even = linear_.factorize(tangent_.matrix.front());
    if (even == FactorStatus::non_finite) return Status::non_finite;
    if (even != FactorStatus::positive_definite || !border()) return Status::not_positive_definite;
    have_factor_ = true;
    factored_ = now_;
    typename System::Tangent odd;
    system_.tangent(now_.x, now_.advance, 1, model_.blocks.size(), odd);
    for (std::size_t b = 1; b < model_.blocks.size(); ++b) {
      auto linear = model_.blocks[b].analysed;
      const FactorStatus f = linear.factorize(odd.matrix[b - 1]);
      if (f != FactorStatus::positive_definite) return f == FactorStatus::non_finite ? Status::non_finite : Status::not_positive_definite;
    }
    return Status::converged;
  }

  QuasiStatic::Config config_;
  const Model& model_;
  System system_;
  const Equations& eq_;
  std::decay_t<decltype(std::declval<Model>().blocks.front().analysed)> linear_;
  typename System::Place now_, factored_;   // where we are, and where the factor was made
  std::chrono::steady_clock::time_point deadline_;
  typename System::Tangent tangent_;
  Eigen::VectorXd response_;   // K⁻¹ k
  double schur_ = 0.0;
  double load_ = 0.0;          // last one in equilibrium
  bool have_factor_ = false;
};

}  // namespace detail

template <class Model, Indenter Tool>
std::vector<MechanicalState> QuasiStatic::run(const Model& model, const Scenario<Tool>& scenario, const Touch& touch) const {
  detail::QuasiStaticRun<Model, Tool> path(model, scenario, touch, config);
  const double fraction = model.sector.fraction();
  std::vector<MechanicalState> states;
  for (double load : scenario.loads_N) {
    MechanicalState state;
    state.load_N = load;
    state.status = path.solve(fraction * load);
    state.iterations = path.iterations;
    state.depth_m = path.advance();
    const Positions& x = path.positions();
    for (std::size_t k = 0; k < model.sector.mesh.nodes.size(); ++k) state.displacement.push_back(x.col(Eigen::Index(k)) - model.sector.mesh.nodes[k]);
    states.push_back(std::move(state));
    if (states.back().status != Status::converged) break;
  }
  return states;
}

}  // namespace lumo
