#pragma once

#include "lumo/mechanics/contact_set.hpp"
#include "lumo/mechanics/press_system.hpp"
#include "lumo/mechanics/state.hpp"

#include <chrono>

namespace lumo {

/// Static equilibrium at prescribed loads: the indenter's advance is an unknown, so that each load is met exactly (model: solver policy
/// "quasi-static"). Newton's method on energy(x, s) − F s, load by load along 0 → F₁ → F₂ …, with a shifted tangent where the tangent is
/// not positive definite, and re-use of a factor as long as it contracts. At each load the unshifted tangent of the *whole* body must be
/// positive definite, fields that break the scenario's symmetry included; otherwise the status says so.
struct QuasiStatic {
  struct Config {
    double residual_tolerance = 1e-7;   ///< of the load
    int max_iterations = 80;            ///< factorisations per load
    double chord_contraction = 0.3;     ///< a kept factor must shrink the residual by this factor per step
    double max_advance = 0.25;          ///< largest advance in one step, in indenter radii
    double time_limit_s = 1e9;          ///< per scenario, wall clock
  };
  Config config = {};

  /// States at the scenario's loads, displacements on the sector's nodes; after the first that is not converged no further one is tried (it carries the reason).
  template <class Model, Indenter Tool>
  std::vector<MechanicalState> run(const Model& model, const Scenario<Tool>& scenario, const Touch& touch) const;
};

namespace detail {

template <class Model, Indenter Tool>
class QuasiStaticRun {
 public:
  QuasiStaticRun(const Model& model, const Scenario<Tool>& scenario, const Touch& touch, const QuasiStatic::Config& config)
      : config_(config), model_(model), system_{model, scenario.indenter, touch.origin, scenario.direction()},
        eq_(model.blocks.front().equations), linear_(model.blocks.front().analysed), x_(positions_of(model.sector.mesh)),
        deadline_(std::chrono::steady_clock::now() + std::chrono::duration_cast<std::chrono::steady_clock::duration>(
                                                         std::chrono::duration<double>(std::min(config.time_limit_s, 1e6)))) {}

  /// Equilibrium at `load` (the sector's share), from where the last call ended.
  Status solve(double load) {
    if (advance_ == 0.0) first_overlap(load);
    iterations = 0;
    auto r = system_.residual(x_, advance_, load, eq_);
    double last = std::numeric_limits<double>::infinity();
    for (;;) {
      if (!std::isfinite(r.norm())) return Status::non_finite;
      if (r.norm() <= config_.residual_tolerance * load) break;
      if (iterations >= config_.max_iterations) return Status::max_iterations;
      if (std::chrono::steady_clock::now() > deadline_) return Status::time_limit;
      if (!have_factor_ || r.norm() > config_.chord_contraction * last)
        if (const Status s = factorize(); s != Status::converged) return s;
      last = r.norm();
      if (const Status s = step(load, r); s != Status::converged) return s;
    }
    return certify_stability();
  }

  const Positions& positions() const { return x_; }
  double advance() const { return advance_; }
  const PressSystem<Model, Tool>& system() const { return system_; }
  int iterations = 0;

 private:
  // The first load starts from a rigid overlap that pushes back with that load.
  void first_overlap(double load) {
    double high = 1e-9;
    const auto push = [&](double s) { return add_contact_forces(model_.touchable, model_.contact, system_.indenter(s), x_, nullptr).push_N; };
    while (push(high) < load && high < system_.tool.radius_m()) high *= 1.5;
    advance_ = high;
  }

  Status factorize() {
    ++iterations;
    system_.tangent(x_, advance_, 0, 1, tangent_);
    shift_ = 0.0;
    for (int attempt = 0; attempt < 12; ++attempt) {
      SparseLower& m = tangent_.matrix.front();
      const FactorStatus f = linear_.factorize(m);
      if (f == FactorStatus::non_finite) return Status::non_finite;
      if (f == FactorStatus::positive_definite && border()) {
        have_factor_ = true;
        return Status::converged;
      }
      // Only to find a way down: at the end the unshifted tangent is tested.
      const double more = shift_ == 0.0 ? 1e-3 : 3.0 * shift_;
      for (int k = 0; k < eq_.count; ++k) m.valuePtr()[m.outerIndexPtr()[k]] += (more - shift_) * model_.solid.material().shear_modulus() * mesh_size();
      shift_ = more;
    }
    return Status::not_positive_definite;
  }

  bool border() {
    response_ = linear_.solve(tangent_.coupling);
    schur_ = tangent_.stiffness - tangent_.coupling.dot(response_);
    return std::isfinite(schur_) && schur_ > 0.0;
  }

  double mesh_size() const {
    return std::cbrt((model_.body.exact_volume_m3 > 0 ? model_.body.exact_volume_m3 : 1e-5) / double(model_.sector.mesh.tets.size()));
  }

  Status step(double load, typename PressSystem<Model, Tool>::Residual& r) {
    const Eigen::VectorXd z = linear_.solve(r.free);
    const double ds = (-r.advance + tangent_.coupling.dot(z)) / schur_;
    const Eigen::VectorXd du = -z - response_ * ds;
    if (!std::isfinite(ds) || !du.allFinite()) return Status::non_finite;
    double t = std::min(1.0, config_.max_advance * system_.tool.radius_m() / std::max(std::abs(ds), 1e-300));
    const double slope = r.free.dot(du) + r.advance * ds;
    const double before = system_.energy(x_, advance_, load);
    bool inverted = false;
    for (int k = 0; k < 25; ++k, t *= 0.5) {
      Positions trial = x_;
      PressSystem<Model, Tool>::move(trial, eq_, du, t);
      const double s = advance_ + t * ds;
      const double after = system_.energy(trial, s, load);
      inverted = !std::isfinite(after);
      if (inverted) continue;
      auto moved = system_.residual(trial, s, load, eq_);
      const bool descends = after <= before + 1e-4 * t * slope;
      if (!descends && !(moved.norm() < 0.5 * r.norm())) continue;
      x_ = std::move(trial);
      advance_ = s;
      r = std::move(moved);
      return Status::converged;
    }
    if (shift_ == 0.0 && stale()) {  // a kept factor may point the wrong way: make a fresh one before giving up
      have_factor_ = false;
      return Status::converged;
    }
    return inverted ? Status::inverted : Status::line_search;
  }

  bool stale() {
    const bool first = !warned_;
    warned_ = true;
    return first;
  }

  // Unshifted tangents of all parities at the state that was reached; the even one serves as the next load's predictor.
  Status certify_stability() {
    have_factor_ = false;
    system_.tangent(x_, advance_, 0, 1, tangent_);
    shift_ = 0.0;
    const FactorStatus even = linear_.factorize(tangent_.matrix.front());
    if (even == FactorStatus::non_finite) return Status::non_finite;
    if (even != FactorStatus::positive_definite || !border()) return Status::not_positive_definite;
    have_factor_ = true;
    typename PressSystem<Model, Tool>::Tangent odd;
    system_.tangent(x_, advance_, 1, model_.blocks.size(), odd);
    for (std::size_t b = 1; b < model_.blocks.size(); ++b) {
      auto linear = model_.blocks[b].analysed;
      const FactorStatus f = linear.factorize(odd.matrix[b - 1]);
      if (f != FactorStatus::positive_definite) return f == FactorStatus::non_finite ? Status::non_finite : Status::not_positive_definite;
    }
    return Status::converged;
  }

  QuasiStatic::Config config_;
  const Model& model_;
  PressSystem<Model, Tool> system_;
  const Equations& eq_;
  std::decay_t<decltype(std::declval<Model>().blocks.front().analysed)> linear_;
  Positions x_;
  double advance_ = 0.0;
  std::chrono::steady_clock::time_point deadline_;
  typename PressSystem<Model, Tool>::Tangent tangent_;
  Eigen::VectorXd response_;   // K⁻¹ k
  double schur_ = 0.0;
  double shift_ = 0.0;
  bool have_factor_ = false;
  bool warned_ = false;
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
