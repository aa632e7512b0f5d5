#include "catch.hpp"
#include "lumo/mechanics/contact/contact_handler.hpp"
#include "lumo/mechanics/materials/mooney_rivlin.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/materials/stable_neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/mechanics/solvers/vertex_block_descent.hpp"
#include "lumo/objective/contact_progression.hpp"
#include "lumo/support/tbb.hpp"
#include "mechanics/bodies.hpp"

#include <random>

using namespace lumo;

static_assert(PressSolver<VertexBlockDescent, NeoHookean, SDFContact, LinearTet>);
static_assert(PressSolver<QuasiStatic<>, NeoHookean, SDFContact, QuadraticTet>);
static_assert(!PressSolver<int, NeoHookean, SDFContact, LinearTet>);
static_assert(
    DilatationalMaterial<NeoHookean> && DilatationalMaterial<StableNeoHookean> && !DilatationalMaterial<MooneyRivlin>);

// The name that users type.
template struct lumo::Simulator<NeoHookean, SDFContact, LinearTet, VertexBlockDescent>;

namespace {

/// Two smooth configurations of the small block.
std::pair<Positions, Positions> moved(const TetMesh& mesh) {
  Positions start = positions_of(mesh), x = start;
  for (Eigen::Index k = 0; k < x.cols(); ++k) {
    start.col(k) += 0.5 * test::wavy(start.col(k), 8e-3);
    x.col(k) += test::wavy(x.col(k), 8e-3);
  }
  return {x, start};
}

template <class Material> void check_vertex_blocks(const Material& material) {
  const auto check = [&](auto element) {
    using Element = decltype(element);
    const TetMesh mesh = test::small_mesh<Element>();
    const VertexElasticity<Material, Element> vertices(mesh, material, element);
    const Solid<Material, Element> solid(mesh, material, element);
    const auto [x, start] = moved(mesh);
    Positions f = Positions::Zero(3, x.cols());
    solid.add_forces(x, f);
    const double rate = 1e4;
    for (int v = 0; v < int(mesh.nodes.size()); v += 3) {
      VertexBlock elastic, whole;
      vertices.add(v, x, start, 0.0, elastic);
      vertices.add(v, x, start, rate, whole);
      CHECK((elastic.force + f.col(v)).norm() < 1e-12 * f.norm());  // the solid's own forces
      const double h = 1e-8;
      for (int c = 0; c < 3; ++c) {
        Positions up = x, down = x;
        up(c, v) += h;
        down(c, v) -= h;
        VertexBlock fu, fd;
        vertices.add(v, up, start, 0.0, fu);
        vertices.add(v, down, start, 0.0, fd);
        CHECK(((fd.force - fu.force) / (2 * h) - elastic.block.col(c)).norm() < 1e-6 * elastic.block.norm());
        // Viscosity: the force is the slope of half the squared change of C, so two points give it too.
        VertexBlock vu, vd;
        vertices.add(v, up, start, rate, vu);
        vertices.add(v, down, start, rate, vd);
        const Vec3d slope = (vd.force - fd.force - vu.force + fu.force) / (2 * h);
        CHECK((slope - (whole.block - elastic.block).col(c)).norm() <
              0.2 * (whole.block - elastic.block).norm());  // Gauss–Newton: without the bend of C
      }
    }
  };
  check(LinearTet{});
  check(QuadraticTet{});
  check(QuadraticTet{false});
}

struct Bench {
  Body body;
  TetMesh mesh;
};
Bench block(int order, int n = 4) {
  const auto [body, mesh] =
      test::symmetric_block(Vec3d(5e-3, 5e-3, 5e-3), test::even(n), test::even(n), test::even(n), order);
  return {body, mesh};
}

template <class Sim> Sim quick(Sim sim) {
  sim.contact.stiffness_N_per_m3 = 1e10;
  sim.solver.config.hold_s = 0.2;
  return sim;
}

const Scenario<Sphere> kPress{Sphere{10e-3}, 0.0, 0.0, {0.1, 0.3}};

}  // namespace

TEST_CASE("vertex blocks are the derivatives of the energy by one node, for every material and element") {
  check_vertex_blocks(NeoHookean{1e5, 2e6});
  check_vertex_blocks(StableNeoHookean{1e5, 2e6});
  check_vertex_blocks(MooneyRivlin{.c10 = 4e4, .c01 = 1e4, .bulk = 2e6});
}

TEST_CASE("viscous forces are the slope of the dissipation and vanish in rigid motion") {
  const TetMesh mesh = test::small_mesh<LinearTet>();
  const VertexElasticity<StableNeoHookean, LinearTet> vertices(mesh, {1e5, 2e6}, {});
  const auto [x, begin] = moved(mesh);
  const Positions start = begin;  // clang 14 does not capture bindings
  const double rate = 300.0;
  const auto dissipation = [&](const Positions& at) {  // ½ η/Δt Σ V |C − C₀|²
    double sum = 0.0;
    for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
      Mat3d F = Mat3d::Zero(), F0 = F;
      for (int a = 0; a < 4; ++a) {
        const Vec3d g = vertices.gradient(int(e), 0).col(a);
        F += at.col(mesh.tets[e][std::size_t(a)]) * g.transpose();
        F0 += start.col(mesh.tets[e][std::size_t(a)]) * g.transpose();
      }
      sum += 0.5 * rate * vertices.weight(int(e), 0) * (F.transpose() * F - F0.transpose() * F0).squaredNorm();
    }
    return sum;
  };
  for (int v = 0; v < int(mesh.nodes.size()); ++v) {
    VertexBlock with, without;
    vertices.add(v, x, start, rate, with);
    vertices.add(v, x, start, 0.0, without);
    for (int c = 0; c < 3; ++c) {
      const double h = 1e-8;
      Positions up = x, down = x;
      up(c, v) += h;
      down(c, v) -= h;
      CHECK((dissipation(up) - dissipation(down)) / (2 * h) == Approx((without.force - with.force)[c]).margin(1e-6));
    }
    VertexBlock rigid, still;
    const Positions turned = Eigen::AngleAxisd(0.3, Vec3d(1, 2, 2).normalized()).toRotationMatrix() * start;
    vertices.add(v, turned, start, rate, rigid);
    vertices.add(v, turned, start, 0.0, still);
    CHECK((rigid.force - still.force).norm() < 1e-9);
  }
}

TEMPLATE_TEST_CASE("eight vertices at once have the blocks of each alone", "", NeoHookean, StableNeoHookean) {
  const TetMesh mesh = test::small_mesh<LinearTet>();
  const VertexElasticity<TestType, LinearTet> vertices(mesh, {1e5, 2e6}, {});
  const VertexColors colors = color_vertices(mesh);
  const VertexPacks<TestType> packs(mesh, vertices, colors);
  const auto [x, start] = moved(mesh);
  for (double rate : {0.0, 500.0}) {
    std::vector<int> seen(mesh.nodes.size(), 0);
    typename VertexPacks<TestType>::Start remembered(packs.slots());
    const auto places = [](const Positions& p) {
      std::vector<SimdPack::Point> points;
      for (Eigen::Index v = 0; v < p.cols(); ++v)
        points.push_back({SimdPack::Point::Register{p(0, v), p(1, v), p(2, v), 0.0}});
      return points;
    };
    const auto now = places(x), before = places(start);
    for (const auto& color : packs.batches())
      for (const auto& batch : color) {
        packs.remember(batch, before, remembered);
        std::array<VertexBlock, SimdPack::width> out;
        packs.add(batch, now, remembered, rate, out);
        std::array<Vec3d, SimdPack::width> steps;
        for (std::size_t l = 0; l < SimdPack::width; ++l) steps[l] = Vec3d(1e-3 * double(l) - 4e-3, 2e-3, -1e-3);
        const auto parts = packs.feasible_parts(batch, now, steps);
        for (std::size_t l = 0; l < SimdPack::width; ++l) {
          if (!batch.moves[l]) continue;
          ++seen[std::size_t(batch.vertex[l])];
          VertexBlock one;
          vertices.add(batch.vertex[l], x, start, rate, one);
          CHECK((out[l].force - one.force).norm() < 1e-12 * one.block.norm() * 1e-3);
          CHECK((out[l].block - one.block).norm() < 1e-12 * one.block.norm());
          CHECK(parts[l] == Approx(vertices.feasible_part(batch.vertex[l], x, steps[l])).epsilon(1e-9));
        }
      }
    for (int count : seen) CHECK(count == 1);
  }
}

TEST_CASE("a feasible part of a step keeps every element from turning inside out, and is as large as it may be") {
  const TetMesh mesh = test::small_mesh<QuadraticTet>();
  const VertexElasticity<NeoHookean, QuadraticTet> vertices(mesh, {1e5, 2e6}, {});
  const auto [x, start] = moved(mesh);
  std::mt19937 random(2);
  std::normal_distribution<double> n;
  int cut = 0;
  for (int v = 0; v < int(mesh.nodes.size()); ++v) {
    const Vec3d step = 3e-3 * Vec3d(n(random), n(random), n(random));
    const double t = vertices.feasible_part(v, x, step);
    Positions y = x;
    y.col(v) += t * step;
    CHECK(vertices.smallest_J(y) > 0.0);
    if (t == 1.0) continue;
    ++cut;
    y.col(v) = x.col(v) + 1.2 * t / 0.9 * step;
    CHECK(vertices.smallest_J(y) < 0.0);
  }
  CHECK(cut > 10);
}

TEST_CASE("colors part the vertices of every tetrahedron") {
  for (const TetMesh& mesh : {test::small_mesh<LinearTet>(), test::small_mesh<QuadraticTet>()}) {
    VertexColors colors = color_vertices(mesh);
    CHECK_NOTHROW(validate(colors, mesh));
    CHECK(colors.size() >= std::size_t(mesh.nodes_per_tet()));
    VertexColors twice = colors, missing = colors, mixed = colors, stray = colors;
    twice[1].push_back(colors[0][0]);
    CHECK_THROWS_WITH(validate(twice, mesh), Catch::Contains("more than one color"));
    missing[0].pop_back();
    CHECK_THROWS_WITH(validate(missing, mesh), Catch::Contains("has no color"));
    mixed[0].insert(mixed[0].end(), mixed[1].begin(), mixed[1].end());
    mixed[1].clear();
    CHECK_THROWS_WITH(validate(mixed, mesh), Catch::Contains("have one color"));
    stray[0].push_back(100000);
    CHECK_THROWS_WITH(validate(stray, mesh), Catch::Contains("names node 100000"));
  }
}

TEST_CASE("lumped masses are positive and add up to the body's") {
  const auto check = [](auto element) {
    const auto mass = lumped_masses<decltype(element)>(test::small_mesh<decltype(element)>(), 1000.0);
    double sum = 0.0;
    for (double m : mass) {
      CHECK(m > 0.0);
      sum += m;
    }
    CHECK(sum == Approx(1000.0 * test::small_size.prod()));
  };
  check(LinearTet{});
  check(QuadraticTet{});
  check(LinearPatchTet{});
}

TEST_CASE("a body that nothing holds rests until it is touched, and then its momentum is the indenter's impulse") {
  Body body = test::block_body(test::small_size);
  body.patches[0].bonded = false;
  const TetMesh mesh = test::small_mesh<LinearTet>();
  DescentConfig config;
  config.time_step_s = 1e-4;  // sweeps carry a stiff body's own motion slowly where inertia is small beside stiffness
  config.sweeps = 300;
  config.viscosity_Pa_s = 1.0;
  const DescentModel<StableNeoHookean, SDFContact, LinearTet> model(body, mesh, {}, {{}, {1e9}, {}}, config);
  const Sphere sphere{10e-3};
  const Touch touch{Vec3d(4e-3, 3e-3, test::small_size.z() + 5e-3), Vec3d(4e-3, 3e-3, test::small_size.z())};
  Descent<std::decay_t<decltype(model)>, Sphere, Serial> descent(
      model, sphere, touch, -Vec3d::UnitZ(), config, Serial{});
  const auto momentum = [&](const Positions& before) {
    Vec3d sum = Vec3d::Zero();
    for (Eigen::Index v = 0; v < before.cols(); ++v)
      sum += model.mass[std::size_t(v)] * (descent.positions().col(v) - before.col(v)) / config.time_step_s;
    return sum;
  };
  descent.step(-1e-3);
  CHECK((descent.positions() - positions_of(mesh)).norm() < 1e-15);
  descent.step(1e-3);
  double impulse = 0.0;
  for (int k = 0; k < 6; ++k) {
    const Positions before = descent.positions();
    descent.step(2e-5);
    impulse += descent.push() * config.time_step_s;
    CHECK(-momentum(before).z() == Approx(impulse).epsilon(1e-3));
  }
  CHECK(impulse > 0.0);
}

TEST_CASE(
    "many sweeps reach the equilibrium that the quasi-static solver finds at the same depth, with the indenter held") {
  const Bench b = block(1);
  auto dynamic = quick(Simulator<NeoHookean, SDFContact, LinearTet, VertexBlockDescent>{});
  dynamic.solver.config.sweeps = 200;
  dynamic.solver.config.hold_s = 0.5;
  const auto held = dynamic.press(b.body, b.mesh, kPress);
  REQUIRE(held.size() == 2);
  Scenario<Sphere> same = kPress;
  same.loads_N = {held[0].force_N, held[1].force_N};
  auto still = Simulator<NeoHookean, SDFContact, LinearTet>{};
  still.contact.stiffness_N_per_m3 = 1e10;
  const auto states = still.press(b.body, b.mesh, same);
  for (std::size_t k = 0; k < 2; ++k) {
    INFO("F " << held[k].force_N << " met " << held[k].met_force_N << " residual/F "
              << held[k].residual_N / held[k].force_N << " depth " << held[k].depth_m << " static "
              << states[k].depth_m);
    CHECK(held[k].status == Status::held);
    CHECK_FALSE(held[k].certified);
    CHECK(states[k].certified);
    CHECK(held[k].met_force_N >= kPress.loads_N[k]);
    CHECK(held[k].residual_N < 1e-3 * held[k].force_N);
    CHECK(states[k].depth_m == Approx(held[k].depth_m).epsilon(0.005));
    double apart = 0.0, size = 0.0;
    for (std::size_t n = 0; n < b.mesh.nodes.size(); ++n) {
      apart += (held[k].displacement[n] - states[k].displacement[n]).squaredNorm();
      size += states[k].displacement[n].squaredNorm();
    }
    CHECK(std::sqrt(apart / size) < 0.01);
  }
}

TEST_CASE("without a hold the state is that of the step at which the load is met, and contact sets may be of records") {
  const Bench b = block(1);
  auto moving = quick(Simulator<StableNeoHookean, SDFContact, LinearTet, VertexBlockDescent>{});
  const auto held = moving.press(b.body, b.mesh, kPress);
  moving.solver.config.hold_s = 0.0;
  const auto met = moving.press(b.body, b.mesh, kPress);
  moving.contact.record_margin_m = 0.1e-3;
  const auto recorded = moving.press(b.body, b.mesh, kPress);
  const double step = moving.solver.config.speed_m_per_s * moving.solver.config.time_step_s;
  for (std::size_t k = 0; k < 2; ++k) {
    CHECK(met[k].status == Status::held);
    CHECK(met[k].force_N == Approx(met[k].met_force_N));
    CHECK(met[k].force_N >= kPress.loads_N[k]);
    CHECK(std::abs(std::remainder(met[k].depth_m, step)) < 1e-12);
    CHECK(met[k].recorded.empty());
    CHECK(recorded[k].depth_m == met[k].depth_m);
    CHECK(recorded[k].contact_area_m2 > met[k].contact_area_m2);
    CHECK(recorded[k].displacement == met[k].displacement);
  }
  CHECK(met[0].depth_m == held[0].depth_m);
  CHECK(met[0].force_N > held[0].force_N);  // viscous stress relaxes in a hold
  const Body& body = b.body;
  Scenario<Sphere> all = kPress;
  all.loads_N = {0.05, 0.1, 0.2, 0.3};
  const auto states = moving.press(body, b.mesh, all);
  const ContactTerms q = contact_terms(body, b.mesh, states, 5e-3, {}, {0.05, 0.1, 0.2, 0.3});
  const ContactSurface surface(b.mesh, body, [](const Patch& p) { return p.contactable; });
  REQUIRE((q.form && q.stable));
  CHECK(q.form->value == Approx(std::sqrt(states[1].contact_area_m2 / (pi * 25e-6))));
  CHECK(q.stable->value ==
        recorded_overlap(surface, states[1].recorded, states[3].recorded, positions_of(b.mesh)).ratio());
}

TEST_CASE("few sweeps end farther from equilibrium than many, and say so in their residual") {
  const Bench b = block(1);
  const auto residual = [&](int sweeps) {
    auto sim = quick(Simulator<StableNeoHookean, SDFContact, LinearTet, VertexBlockDescent>{});
    sim.solver.config.sweeps = sweeps;
    const auto states = sim.press(b.body, b.mesh, kPress);
    CHECK(states.back().status == Status::held);
    return states.back().residual_N / states.back().force_N;
  };
  const double few = residual(2), some = residual(10), many = residual(100);
  INFO(few << " " << some << " " << many);
  CHECK(few > some);
  CHECK(some > 3.0 * many);
}

TEST_CASE("any executor and either way of taking vertices give the same states") {
  const Bench b = block(1);
  const auto states = [&](auto solver) {
    Simulator<StableNeoHookean, VertexContact, LinearTet, decltype(solver)> sim;
    sim.solver = solver;
    return quick(sim).press(b.body, b.mesh, kPress);
  };
  const auto serial = states(VertexBlockDescent{});
  for (int threads : {1, 2, 3}) {
    BlockDescent<TbbExecutor> parallel;
    parallel.executor.threads = threads;
    const auto other = states(parallel);
    for (std::size_t k = 0; k < serial.size(); ++k) {
      CHECK(other[k].force_N == serial[k].force_N);
      CHECK(other[k].displacement == serial[k].displacement);
    }
  }
  VertexBlockDescent alone;
  alone.config.packs = false;
  const auto other = states(alone);
  for (std::size_t k = 0; k < serial.size(); ++k) {
    CHECK(other[k].force_N == Approx(serial[k].force_N).epsilon(1e-9));
    for (std::size_t n = 0; n < b.mesh.nodes.size(); ++n)
      CHECK((other[k].displacement[n] - serial[k].displacement[n]).norm() < 1e-12);
  }
}

TEST_CASE("predictors and colors change the way, not the end") {
  const Bench b = block(1);
  const auto force = [&](Predictor predictor, bool reversed) {
    auto sim = quick(Simulator<NeoHookean, SDFContact, LinearTet, VertexBlockDescent>{});
    sim.solver.config.sweeps = 150;
    sim.solver.config.predictor = predictor;
    if (reversed) {
      sim.solver.config.colors = color_vertices(b.mesh);
      std::reverse(sim.solver.config.colors.begin(), sim.solver.config.colors.end());
    }
    Scenario<Sphere> s = kPress;
    s.loads_N = {0.3};
    const MechanicalState state = sim.press(b.body, b.mesh, s).front();
    CHECK(state.status == Status::held);
    return state.force_N / state.depth_m;
  };
  const double reference = force(Predictor::inertia, false);
  CHECK(force(Predictor::position, false) == Approx(reference).epsilon(0.005));
  CHECK(force(Predictor::acceleration, false) == Approx(reference).epsilon(0.005));
  CHECK(force(Predictor::inertia, true) == Approx(reference).epsilon(0.002));
}

TEST_CASE("quadratic elements and other materials descend too") {
  const Bench b = block(2, 1);
  auto sim = quick(Simulator<MooneyRivlin, SDFContact, QuadraticTet, VertexBlockDescent>{});
  sim.solver.config.sweeps = 30;
  sim.solver.config.hold_s = 0.1;
  const auto held = sim.press(b.body, b.mesh, Scenario<Sphere>{Sphere{10e-3}, 0.0, 0.0, {0.2}});
  REQUIRE(held.front().status == Status::held);
  Simulator<MooneyRivlin, SDFContact> still;
  still.contact.stiffness_N_per_m3 = 1e10;
  const auto states = still.press(b.body, b.mesh, Scenario<Sphere>{Sphere{10e-3}, 0.0, 0.0, {held.front().force_N}});
  REQUIRE(states.front().status == Status::converged);
  INFO(held.front().force_N << " N at " << held.front().depth_m << " m, static " << states.front().depth_m
                            << " residual " << held.front().residual_N);
  CHECK(states.front().depth_m == Approx(held.front().depth_m).epsilon(0.02));
}

TEST_CASE("an element is refused on a mesh of another order") {
  const auto wrong = [](auto element, const TetMesh& mesh) {
    using Element = decltype(element);
    CHECK_THROWS_WITH((VertexElasticity<NeoHookean, Element>(mesh, {}, element)), Catch::Contains("must be the same"));
    CHECK_THROWS_WITH((Solid<NeoHookean, Element>(mesh, {}, element)), Catch::Contains("must be the same"));
    CHECK_THROWS_AS(lumped_masses<Element>(mesh, 1000.0), InvalidArgument);
  };
  wrong(LinearTet{}, test::small_mesh<QuadraticTet>());
  wrong(QuadraticTet{}, test::small_mesh<LinearTet>());
  const Bench quadratic = block(2, 2);
  CHECK_THROWS_AS((Simulator<NeoHookean, SDFContact, LinearTet, VertexBlockDescent>{}.press(
                      quadratic.body, quadratic.mesh, kPress)),
      InvalidArgument);
}

namespace {
/// A law that gives out under a compression of a hundredth.
struct Brittle : StableNeoHookean {
  Mat3d distortion_stress(const Mat3d& F) const {
    return F(2, 2) < 0.99 ? Mat3d(Mat3d::Constant(std::numeric_limits<double>::quiet_NaN()))
                          : StableNeoHookean::distortion_stress(F);
  }
};
}  // namespace

TEST_CASE("a step that ends in NaN is a status, and what is given is the state before it") {
  const Bench b = block(1, 2);
  auto sim = quick(Simulator<Brittle, SDFContact, LinearTet, VertexBlockDescent>{});
  sim.solver.config.packs = false;
  for (const MechanicalState& s : sim.press(b.body, b.mesh, kPress)) {
    CHECK(s.status == (s.load_N > 0.2 ? Status::non_finite : s.status));
    for (const double v :
        {s.force_N, s.met_force_N, s.depth_m, s.contact_area_m2, s.reference_area_m2, s.penetration_m})
      CHECK(std::isfinite(v));
    CHECK_FALSE(std::isnan(s.residual_N));
    for (const Vec3d& u : s.displacement) CHECK(u.allFinite());
    for (const double p : s.pressure_Pa) CHECK(std::isfinite(p));
  }
  Scenario<Sphere> hard = kPress;
  hard.loads_N = {5.0};
  CHECK(sim.press(b.body, b.mesh, hard).front().status == Status::non_finite);
}

TEST_CASE("what descent cannot do is a status or one line") {
  const Bench b = block(1, 2);
  auto sim = quick(Simulator<StableNeoHookean, SDFContact, LinearTet, VertexBlockDescent>{});
  sim.solver.config.max_advance_m = 1e-4;
  CHECK(sim.press(b.body, b.mesh, Scenario<Sphere>{Sphere{10e-3}, 0.0, 0.0, {5.0, 10.0}}).back().status ==
        Status::max_iterations);
  sim.solver.config.time_limit_s = 0.0;
  CHECK(sim.press(b.body, b.mesh, kPress).back().status == Status::time_limit);
  sim.solver.config = {};
  sim.solver.config.sweeps = 0;
  CHECK_THROWS_WITH(sim.press(b.body, b.mesh, kPress), Catch::Contains("sweeps is 0"));
  sim.solver.config = {};
  sim.solver.config.colors = {{0}};
  CHECK_THROWS_AS(sim.press(b.body, b.mesh, kPress), InvalidArgument);
  CHECK_THROWS_AS(validate(VertexContact{.friction = -1.0}), InvalidArgument);
}
