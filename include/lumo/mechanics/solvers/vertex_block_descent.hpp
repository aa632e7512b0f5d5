#pragma once

#include "lumo/core/executor.hpp"
#include "lumo/core/stopwatch.hpp"
#include "lumo/mechanics/contact/carrier.hpp"
#include "lumo/mechanics/solvers/descent_model.hpp"
#include "lumo/mechanics/solvers/vertex_block.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace lumo {

/// The paper's solver: implicit Euler in time, each step a fixed number of sweeps over the vertices, color by color;
/// each vertex is moved by Newton's method on its own three components, with inertia, elasticity, viscosity and contact
/// in the 3×3 block. The indenter advances at a constant speed until a load is met, then stands still for `hold_s`, and
/// the state is recorded: `held`, which says nothing of equilibrium. Vertices of one color do not meet, so that any
/// executor gives the same bits. Source: Chen, Liu, Yang, Yuksel 2024 (vertex block descent); protocol of the paper's
/// §III-B and its table of settings.
template <Executor E = Serial> struct BlockDescent {
  template <class Material, class Contact, class Element> using Model = DescentModel<Material, Contact, Element>;
  using Config = DescentConfig;
  static constexpr bool uses_symmetry = false;
  Config config = {};
  E executor = {};

  /// Throws InvalidArgument for settings out of range and for colors that are none.
  template <class Material, class Contact, class Element>
  std::unique_ptr<Model<Material, Contact, Element>> model(const Body& body, const TetMesh& mesh, Symmetry planes,
      const PressPhysics<Material, Contact, Element>& physics) const {
    validate(config);
    return std::make_unique<Model<Material, Contact, Element>>(body, mesh, planes, physics, config);
  }

  /// States after each load's hold. A load that is not met within `max_advance_m` ends as max_iterations; a step
  /// without finite positions as non_finite, with the state before it.
  template <class SomeModel, Indenter Tool>
  std::vector<MechanicalState> run(const SomeModel& model, const Scenario<Tool>& scenario, const Touch& touch) const;
};

using VertexBlockDescent = BlockDescent<>;

/// One body under one indenter in time.
template <class Model, Indenter Tool, Executor E> class Descent {
 public:
  Descent(const Model& model, const Tool& tool, const Touch& touch, const Vec3d& direction, const DescentConfig& config,
      const E& executor)
      : model_(model),
        config_(config),
        executor_(executor),
        tool_(tool),
        origin_(touch.origin),
        direction_(direction),
        x_(positions_of(model.sector.mesh)),
        start_(x_),
        target_(x_),
        velocity_(Positions::Zero(3, x_.cols())),
        last_velocity_(velocity_),
        touching_(model.touchable, model.contact, friction_coefficient(model.contact)),
        resting_(model.resting, model.contact, carrier_friction(model.contact)) {
    if constexpr (Model::batched)
      if (model.packs) {
        points_.resize(std::size_t(x_.cols()));
        packs_start_.resize(model.packs->slots());
        place_all();
      }
  }

  /// One time step, at whose start the indenter moves on by `by` [m]. False when it ends without sound positions; then
  /// all is as it was before.
  bool step(double by) {
    advance_ += by;
    const double dt = config_.time_step_s, stick = config_.slip_speed_m_per_s * dt;
    start_ = x_;
    remember();
    predict();
    place_all();
    touching_.find(
        start_, {&tool_, origin_ + advance_ * direction_, direction_}, by * direction_, config_.detection_m, stick);
    resting_.find(start_, {&model_.carrier, Vec3d::Zero(), Vec3d::UnitZ()}, Vec3d::Zero(), config_.detection_m, stick);
    for (int k = 0; k < config_.sweeps; ++k) sweep();
    if (!(x_.array().abs() < lost_m).all()) {
      x_ = start_;
      advance_ -= by;
      place_all();
      return false;
    }
    last_velocity_ = velocity_;
    velocity_ = (x_ - start_) / dt;
    return true;
  }

  /// What the indenter feels against its advance [N].
  double push() const { return touching_.sum(x_, nullptr).force.dot(direction_); }
  /// Friction on the nodes, and its part of the push.
  double friction(std::vector<Vec3d>& on_nodes) const {
    on_nodes.assign(std::size_t(x_.cols()), Vec3d::Zero());
    resting_.sum(x_, &on_nodes);
    return touching_.sum(x_, &on_nodes).friction.dot(direction_);
  }
  const Positions& positions() const { return x_; }
  double advance() const { return advance_; }

 private:
  // That far off, a pad is as lost as with NaN, and its forces are about to overflow.
  static constexpr double lost_m = 1e3;

  double rate() const { return config_.viscosity_Pa_s / config_.time_step_s; }

  // Copies a vertex's position for the packs.
  void place(int v) {
    if constexpr (Model::batched)
      if (model_.packs) points_[std::size_t(v)] = {SimdPack::Point::Register{x_(0, v), x_(1, v), x_(2, v), 0.0}};
  }
  void place_all() {
    for (int v = 0; v < int(x_.cols()); ++v) place(v);
  }
  void remember() {
    if constexpr (Model::batched)
      if (rate() > 0.0) for_batches([&](const auto& batch) { model_.packs->remember(batch, points_, packs_start_); });
  }

  // Where inertia alone would carry the vertices, and where the sweeps begin.
  void predict() {
    const double dt = config_.time_step_s;
    target_ = start_ + dt * velocity_;
    Positions ahead = Positions::Zero(3, x_.cols());
    if (config_.predictor != Predictor::position) ahead = dt * velocity_;
    if (config_.predictor == Predictor::acceleration) ahead += dt * (velocity_ - last_velocity_);
    for (Eigen::Index v = 0; v < x_.cols(); ++v)
      if (!model_.moves[std::size_t(v)]) ahead.col(v).setZero();
    x_ = start_ + ahead;
    // A law without an energy inside out must not begin there.
    if (model_.resists_inversion && config_.predictor != Predictor::position) {
      const double floor = 0.2 * model_.elasticity.smallest_J(start_);
      for (int k = 0; k < 10 && !(model_.elasticity.smallest_J(x_) > floor); ++k) {
        ahead *= 0.5;
        x_ = start_ + ahead;
      }
      if (!(model_.elasticity.smallest_J(x_) > floor)) x_ = start_;
    }
  }

  // Pieces of work that are large enough to hand out.
  static constexpr std::size_t piece = 16;

  template <class Visit> void for_batches(Visit&& visit) const {
    if constexpr (Model::batched)
      if (model_.packs)
        for (const auto& batches : model_.packs->batches())
          over(batches.size(), [&](std::size_t k) { visit(batches[k]); });
  }
  template <class Visit> void over(std::size_t count, Visit&& visit) const {
    executor_.for_each((count + piece - 1) / piece, [&](std::size_t p) {
      for (std::size_t k = p * piece; k < std::min(count, (p + 1) * piece); ++k) visit(k);
    });
  }

  void sweep() {
    if constexpr (Model::batched)
      if (model_.packs) {
        for_batches([&](const auto& batch) {
          std::array<VertexBlock, SimdPack::width> blocks;
          model_.packs->add(batch, points_, packs_start_, rate(), blocks);
          std::array<Vec3d, SimdPack::width> steps;
          steps.fill(Vec3d::Zero());
          for (std::size_t lane = 0; lane < SimdPack::width; ++lane)
            if (batch.moves[lane]) steps[lane] = step_of(batch.vertex[lane], blocks[lane]);
          if (model_.resists_inversion) {
            const auto part = model_.packs->feasible_parts(batch, points_, steps);
            for (std::size_t lane = 0; lane < SimdPack::width; ++lane) steps[lane] *= part[lane];
          }
          for (std::size_t lane = 0; lane < SimdPack::width; ++lane)
            if (batch.moves[lane]) {
              x_.col(batch.vertex[lane]) += steps[lane];
              place(batch.vertex[lane]);
            }
        });
        return;
      }
    for (const std::vector<int>& color : model_.colors)
      over(color.size(), [&](std::size_t k) {
        VertexBlock b;
        model_.elasticity.add(color[k], x_, start_, rate(), b);
        const Vec3d step = step_of(color[k], b);
        x_.col(color[k]) +=
            (model_.resists_inversion ? model_.elasticity.feasible_part(color[k], x_, step) : 1.0) * step;
      });
  }

  // Adds inertia and contact, and solves for the vertex's step.
  Vec3d step_of(int v, VertexBlock& b) const {
    const double inertia = model_.mass[std::size_t(v)] / (config_.time_step_s * config_.time_step_s);
    b.force += inertia * (target_.col(v) - x_.col(v));
    b.block += inertia * Mat3d::Identity();
    touching_.add(v, x_, b);
    resting_.add(v, x_, b);
    const Mat3d& H = b.block;
    const Mat3d c = cofactor(H);  // of a symmetric matrix: its inverse times the determinant
    const double determinant = H.col(0).dot(c.col(0));
    if (H(0, 0) > 0.0 && c(2, 2) > 0.0 && determinant > 1e-14 * H(0, 0) * H(1, 1) * H(2, 2))
      return c * b.force / determinant;
    if (!H.allFinite() || !b.force.allFinite())
      return Vec3d::Constant(std::numeric_limits<double>::quiet_NaN());  // seen at the step's end
    // Curvatures that are negative change sign: a step along them still lowers the energy.
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(H);
    const Vec3d l = eigen.eigenvalues().cwiseAbs();
    return eigen.eigenvectors() *
           (eigen.eigenvectors().transpose() * b.force).cwiseQuotient(l.cwiseMax(1e-9 * l.maxCoeff()));
  }

  const Model& model_;
  const DescentConfig& config_;
  const E& executor_;
  const Tool& tool_;
  Vec3d origin_, direction_;
  double advance_ = 0.0;
  Positions x_, start_, target_, velocity_, last_velocity_;
  StepContacts<std::decay_t<decltype(std::declval<Model>().contact)>, Tool> touching_;
  StepContacts<std::decay_t<decltype(std::declval<Model>().contact)>, Carrier> resting_;
  PaddedPositions points_;  // x_ for the packs
  typename Model::Packs::Start packs_start_;
};

template <Executor E> template <class SomeModel, Indenter Tool> std::vector<MechanicalState> BlockDescent<E>::run(
    const SomeModel& model, const Scenario<Tool>& scenario, const Touch& touch) const {
  const Stopwatch watch;
  Descent<SomeModel, Tool, E> body(model, scenario.indenter, touch, scenario.direction(), config, executor);
  const int hold = int(std::lround(config.hold_s / config.time_step_s));
  std::vector<MechanicalState> states;
  int steps = 0;
  for (double load : scenario.loads_N) {
    MechanicalState state;
    state.load_N = load;
    state.status = Status::held;
    const int before = steps;
    const auto report = [&](std::optional<Status> ended) {
      const double reached = ended == Status::held ? load : states.empty() ? 0.0 : states.back().load_N;
      if (config.watch)
        config.watch({load, reached, body.advance(), config.sweeps * (steps - before), std::nullopt, ended});
    };
    const auto go = [&](double by) {
      ++steps;
      if (!body.step(by)) state.status = Status::non_finite;
      else if (watch.seconds() > config.time_limit_s) state.status = Status::time_limit;
      report({});
    };
    while (state.status == Status::held && body.push() < load) {
      if (body.advance() >= config.max_advance_m) state.status = Status::max_iterations;
      else go(config.speed_m_per_s * config.time_step_s);
    }
    state.met_force_N = body.push();
    for (int k = 0; k < hold && state.status == Status::held; ++k) go(0.0);
    state.iterations = config.sweeps * (steps - before);
    state.depth_m = body.advance();
    const auto& x = body.positions();
    for (std::size_t k = 0; k < model.sector.mesh.nodes.size(); ++k)
      state.displacement.push_back(x.col(Eigen::Index(k)) - model.sector.mesh.nodes[k]);
    if (friction_coefficient(model.contact) > 0.0 || carrier_friction(model.contact) > 0.0)
      state.friction_push_N = body.friction(state.friction_N);
    report(state.status);
    states.push_back(std::move(state));
    if (states.back().status != Status::held) break;
  }
  return states;
}

}  // namespace lumo
