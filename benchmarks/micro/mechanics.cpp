#include "kernel.hpp"
#include "pad.hpp"

#include "geometry/surfaces.hpp"

#include "lumo/mechanics/certify.hpp"
#include "lumo/mechanics/contact/contact_handler.hpp"
#include "lumo/mechanics/contact/contact_set.hpp"
#include "lumo/mechanics/indenters/box.hpp"
#include "lumo/mechanics/indenters/capsule.hpp"
#include "lumo/mechanics/indenters/cylinder.hpp"
#include "lumo/mechanics/indenters/mesh_indenter.hpp"
#include "lumo/mechanics/materials/mooney_rivlin.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/materials/ogden.hpp"
#include "lumo/mechanics/materials/stable_neo_hookean.hpp"
#include "lumo/mechanics/materials/yeoh.hpp"
#include "lumo/mechanics/solvers/press_system.hpp"
#include "lumo/mechanics/solvers/quasi_static.hpp"
#include "lumo/mechanics/solvers/vertex_block_descent.hpp"
#include "lumo/mesh/body_mesh.hpp"
#include "lumo/mesh/swept_mesher.hpp"
#include "lumo/support/cholmod.hpp"
#include "lumo/support/mixed_cholesky.hpp"

using namespace lumo;
using namespace lumo::micro;

namespace {

using QuarterModel = SectorModel<NeoHookean, SDFContact, QuadraticTet, Cholmod>;

/// The quarter that the quasi-static solver works on, at equilibrium.
struct Quarter {
  const PressedPad& pad = pressed_pad();
  QuarterModel model{pad.body, pad.mesh, {true, true}, {}};
  PressSystem<QuarterModel, Sphere> system{model, pad.ball.indenter, pad.touch.origin, pad.ball.direction()};
  const Equations& equations = model.blocks.front().equations;
  Positions x = positions_of(model.sector.mesh);
  double advance = pad.state.depth_m;

  Quarter() {
    for (std::size_t k = 0; k < model.sector.to_whole.size(); ++k)
      x.col(Eigen::Index(k)) += pad.state.displacement[std::size_t(model.sector.to_whole[k])];
  }
  std::string size() const {
    return message(model.sector.mesh.tets.size(), " tetrahedra, ", model.sector.mesh.nodes.size(), " nodes");
  }
};

const Quarter& quarter() {
  static const Quarter q;
  return q;
}

template <class Material> void time_material(const std::string& name, const Material& m, const std::vector<Mat3d>& F) {
  std::vector<Mat3d> stress(F.size());
  REQUIRE(first_piola(m, F[1]).norm() > 0.0);
  BENCHMARK(named("first Piola stress", message(F.size(), " gradients"), name)) {
    for (std::size_t i = 0; i < F.size(); ++i) stress[i] = first_piola(m, F[i]);
    return stress.data();
  };
}

template <class Material> void time_tangent(const std::string& name, const Material& m, const std::vector<Mat3d>& F) {
  std::vector<Mat9d> tangent(F.size());
  BENCHMARK(named("material tangent", message(F.size(), " gradients"), name)) {
    for (std::size_t i = 0; i < F.size(); ++i) tangent[i] = elasticity_tangent(m, F[i]);
    return tangent.data();
  };
}

template <class Element>
void time_solid(const std::string& name, const Sector& sector, const Body& body, const Positions& x) {
  const Solid<NeoHookean, Element> solid(sector.mesh, NeoHookean{}, Element{});
  const Equations equations(sector, body, {});
  REQUIRE(std::isfinite(solid.energy(x)));
  std::vector<double> values(std::size_t(equations.pattern.nonZeros()));
  Positions force = Positions::Zero(3, x.cols());
  const std::string input = message(sector.mesh.tets.size(), " tetrahedra");
  BENCHMARK(named(name + ": energy", input)) { return solid.energy(x); };
  BENCHMARK(named(name + ": forces", input)) {
    solid.add_forces(x, force);
    return force.data();
  };
  BENCHMARK(named(name + ": tangent into the sparse matrix", input)) {
    solid.add_tangent(x, {&equations}, {values.data()});
    return values.data();
  };
}

}  // namespace

TEST_CASE("mechanics: materials", "[mechanics]") {
  const OwenSobol u{1};
  std::vector<Mat3d> F(256, Mat3d::Identity());
  for (std::uint32_t i = 0; i < F.size(); ++i)
    for (int k = 0; k < 9; ++k) F[i].data()[k] += 0.4 * (u(i, k) - 0.5);
  const Ogden ogden{{{{80e3, 1.3}, {5e3, 5.0}, {-2e3, -2.0}}}, 10e6};
  const Yeoh yeoh{.c2 = 1e3, .c3 = 1e2};
  time_material("NeoHookean", NeoHookean{}, F);
  time_material("StableNeoHookean", StableNeoHookean{}, F);
  time_material("MooneyRivlin", MooneyRivlin{}, F);
  time_material("Yeoh", yeoh, F);
  time_material("Ogden", ogden, F);
  time_tangent("NeoHookean", NeoHookean{}, F);
  time_tangent("StableNeoHookean", StableNeoHookean{}, F);
  time_tangent("MooneyRivlin", MooneyRivlin{}, F);
  time_tangent("Yeoh", yeoh, F);
  time_tangent("Ogden", ogden, F);
}

TEST_CASE("mechanics: elements", "[mechanics]") {
  const Quarter& q = quarter();
  time_solid<QuadraticTet>("QuadraticTet", q.model.sector, q.pad.body, q.x);
  time_solid<LinearPatchTet>("LinearPatchTet", q.model.sector, q.pad.body, q.x);
  // The same body of linear tetrahedra, stretched a little.
  const Sector linear = sector_of(mesh_body(q.pad.body, SweptMesher{}, 1), {true, true});
  Positions x = positions_of(linear.mesh);
  x.row(0) *= 1.02;
  time_solid<LinearTet>("LinearTet", linear, q.pad.body, x);
  const Positions dx = 1e-3 * q.x;
  const VolumeRatios start = q.model.solid.volume_ratios(q.x);
  BENCHMARK(named("QuadraticTet: volume ratios carried on", message(q.model.sector.mesh.tets.size(), " tetrahedra"))) {
    std::vector<double> J = start.J;
    q.model.solid.carry_on(J, q.x, dx);
    return J;
  };
}

TEST_CASE("mechanics: contact", "[mechanics]") {
  const Quarter& q = quarter();
  const auto sphere = q.system.indenter(q.advance);
  const ContactSurface& surface = q.model.touchable;
  const std::string input = message(surface.size(), " faces");
  Positions force = Positions::Zero(3, q.x.cols());
  Eigen::VectorXd coupling = Eigen::VectorXd::Zero(q.equations.count);
  std::vector<double> values(std::size_t(q.equations.pattern.nonZeros()));
  REQUIRE(4.0 * add_contact_forces(surface, SDFContact{}, sphere, q.x, nullptr).push_N > 4.9);
  BENCHMARK(named("contact forces", input)) {
    return add_contact_forces(surface, SDFContact{}, sphere, q.x, &force).push_N;
  };
  BENCHMARK(named("contact tangent into the sparse matrix", input)) {
    return add_contact_tangent(surface, SDFContact{}, sphere, q.x, {q.equations, values.data(), &coupling})
               .push_stiffness +
           values.front();
  };
  const Positions dx = 1e-3 * q.x;
  const ContactPlace<Sphere> here{sphere, q.x};
  BENCHMARK(named("gaps carried on", input)) { return predicted_gaps(surface, here, here, dx, 1e-6); };
  BENCHMARK(named("first touch", message("1 line on ", q.pad.mesh.faces.size(), " faces"))) {
    return first_touch(q.pad.body, q.pad.mesh, q.pad.ball).point;
  };

  // On the whole mesh, as results are reported.
  const PressedPad& pad = q.pad;
  const ContactSurface whole(pad.mesh, pad.body, [](const Patch& p) { return p.contactable; });
  Positions x = positions_of(pad.mesh);
  for (std::size_t k = 0; k < pad.state.displacement.size(); ++k) x.col(Eigen::Index(k)) += pad.state.displacement[k];
  const std::string faces = message(whole.size(), " faces");
  BENCHMARK(named("contact field", faces)) { return contact_field(pad.mesh, whole, SDFContact{}, sphere, x).field; };
  const std::vector<double>& field = pad.state.contact_field;
  std::vector<double> smaller = field;
  for (double& f : smaller) f -= 0.2e-3;
  REQUIRE(contact_overlap(whole, field, smaller, x).ratio() < 0.95);
  BENCHMARK(named("contact sets clipped and overlaid", faces)) {
    return contact_overlap(whole, field, smaller, x).ratio();
  };
  BENCHMARK(named("certificate of equilibrium", message(pad.mesh.tets.size(), " tetrahedra"))) {
    return out_of_balance(pad.body, pad.mesh, PressPhysics{NeoHookean{}, SDFContact{}, QuadraticTet{}}, sphere,
        {5.0, pad.state.displacement});
  };
}

TEST_CASE("mechanics: linear systems", "[mechanics]") {
  const Quarter& q = quarter();
  PressSystem<QuarterModel, Sphere>::Tangent tangent;
  q.system.tangent(q.x, q.advance, 0, 1, tangent);
  const SparseLower& K = tangent.matrix.front();
  const std::string input = message("1 tangent of ", K.cols(), " equations, ", K.nonZeros(), " non-zeros");
  BENCHMARK(named("equations and pattern", message(q.model.sector.mesh.tets.size(), " tetrahedra"))) {
    return Equations(q.model.sector, q.pad.body, {}).count;
  };

  EigenCholesky eigen;
  Cholmod cholmod;
  eigen.analyze(K);
  cholmod.analyze(K);
  MixedCholesky mixed;
  mixed.analyze(K);
  REQUIRE(mixed.factorize(K) == FactorStatus::positive_definite);
  REQUIRE(eigen.factorize(K) == FactorStatus::positive_definite);
  REQUIRE(cholmod.factorize(K) == FactorStatus::positive_definite);
  const Eigen::MatrixXd rhs = tangent.coupling;
  REQUIRE((eigen.solve(rhs) - cholmod.solve(rhs)).norm() < 1e-6 * cholmod.solve(rhs).norm());
  BENCHMARK(named("symbolic analysis", input, "EigenCholesky (AMD)")) {
    EigenCholesky fresh;
    fresh.analyze(K);
    return fresh;
  };
  BENCHMARK(named("symbolic analysis", input, "Cholmod (METIS)")) {
    Cholmod fresh;
    fresh.analyze(K);
    return fresh.factor_nonzeros();
  };
  BENCHMARK(named("factorisation", input, "EigenCholesky")) { return eigen.factorize(K); };
  BENCHMARK(named("factorisation", input, "Cholmod")) { return cholmod.factorize(K); };
  BENCHMARK(named("factorisation", input, "MixedCholesky")) { return mixed.factorize(K); };
  BENCHMARK(named("solution with a factor", input, "EigenCholesky")) { return eigen.solve(rhs); };
  BENCHMARK(named("solution with a factor", input, "Cholmod")) { return cholmod.solve(rhs); };
  BENCHMARK(named("solution with a factor", input, "MixedCholesky")) { return mixed.solve(rhs); };

  SecantPairs pairs;
  const Eigen::VectorXd b = rhs.col(0);
  for (int k = 1; k <= 8; ++k) {
    const Eigen::VectorXd step = Eigen::VectorXd::LinSpaced(b.size(), -1.0, double(k));
    pairs.add(step, K.selfadjointView<Eigen::Lower>() * step);
  }
  BENCHMARK(named("correction by 8 secant pairs", message(b.size(), " equations"))) {
    return pairs.solve(b, [](const Eigen::VectorXd& r) { return r; });
  };
}

TEST_CASE("mechanics: vertex block descent", "[mechanics]") {
  const PressedPad& pad = pressed_pad();
  const TetMesh mesh = mesh_body(pad.body, SweptMesher{}, 1);
  using Model = DescentModel<StableNeoHookean, VertexContact, LinearTet>;
  const VertexContact contact{.stiffness_N_per_m3 = 1e9, .friction = 0.5};
  const Serial serial;
  const auto time_step = [&](const std::string& name, bool packs) {
    DescentConfig config;
    config.packs = packs;
    const Model model(pad.body, mesh, {}, {{}, contact, {}}, config);
    const Touch touch = first_touch(pad.body, mesh, pad.ball);
    Descent<Model, Sphere, Serial> descent(model, pad.ball.indenter, touch, pad.ball.direction(), config, serial);
    bool finite = true;
    for (int k = 0; k < 30; ++k) finite = descent.step(50e-6) && finite;
    REQUIRE(finite);
    const double push = descent.push();
    BENCHMARK(named("time step of 10 sweeps",
        message("10 sweeps over ", mesh.nodes.size(), " nodes, ", mesh.tets.size(), " linear tetrahedra"), name)) {
      return descent.step(0.0);
    };
    REQUIRE(descent.step(0.0));
    return push;
  };
  const double one = time_step("vertex by vertex", false), eight = time_step("eight vertices at once", true);
  REQUIRE(one > 0.5);
  REQUIRE(std::abs(eight / one - 1.0) < 1e-6);
  BENCHMARK(named("colors of the vertices", message(mesh.nodes.size(), " nodes"))) { return color_vertices(mesh); };
}

TEST_CASE("mechanics: distance to a tool", "[mechanics]") {
  const MeshInput sphere = surfaces::sphere(3, 5e-3);
  TriangleSurface surface{sphere.vertices, {}};
  for (const Facet& f : sphere.facets) surface.triangles.push_back({f.loop[0], f.loop[1], f.loop[2]});
  const MeshIndenter mesh(surface);
  std::vector<Vec3d> near =
      points_in(Vec3d::Constant(-1.0), Vec3d::Constant(1.0), 1024, 5);  // a shell about the surface, where contact asks
  for (std::size_t i = 0; i < near.size(); ++i) near[i] *= (5e-3 + 0.5e-3 * near[i].x()) / near[i].norm();
  REQUIRE(std::abs(mesh.distance(near[5]) - Sphere{10e-3}.distance(near[5])) < 50e-6);
  const auto samples = [&](const auto& tool) {
    double sum = 0.0;
    Mat3d bend = Mat3d::Zero();
    for (const Vec3d& p : near) {
      const auto d = tool.sample(p);
      sum += d.distance + d.gradient.z();
      bend += d.hessian;
    }
    return sum + bend.sum();
  };
  const std::string input = "1024 points near a tool";
  BENCHMARK(named("distance with two derivatives", input, "Sphere")) { return samples(Sphere{10e-3}); };
  BENCHMARK(named("distance with two derivatives", input, "Capsule")) { return samples(Capsule{10e-3, 2e-3}); };
  BENCHMARK(named("distance with two derivatives", input, "Cylinder")) { return samples(Cylinder{9e-3, 9e-3}); };
  BENCHMARK(named("distance with two derivatives", input, "Box")) { return samples(Box{Vec3d::Constant(8e-3)}); };
  BENCHMARK(named(
      "distance with two derivatives", input, message("MeshIndenter, ", surface.triangles.size(), " triangles"))) {
    return samples(mesh);
  };
  BENCHMARK(named("mesh tool made", message("1 tool of ", surface.triangles.size(), " triangles"))) {
    return MeshIndenter(surface).radius_m();
  };
}
