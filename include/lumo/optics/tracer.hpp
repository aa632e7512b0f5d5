#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/executor.hpp"
#include "lumo/core/sobol.hpp"
#include "lumo/core/types.hpp"
#include "lumo/mechanics/contact/state.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "lumo/morphology/body.hpp"
#include "lumo/optics/beer_lambert.hpp"
#include "lumo/optics/bvh.hpp"
#include "lumo/optics/exit_power.hpp"
#include "lumo/optics/lamp_places.hpp"
#include "lumo/optics/optical_scene.hpp"
#include "lumo/optics/response.hpp"
#include "lumo/optics/transport/face_set.hpp"
#include "lumo/optics/transport/film_launch.hpp"
#include "lumo/optics/transport/guide_lesson.hpp"
#include "lumo/optics/transport/next_event.hpp"
#include "lumo/optics/transport/path_tracer.hpp"
#include "lumo/optics/transport/radiosity.hpp"
#include "lumo/optics/transport/ray_guide.hpp"
#include "lumo/optics/transport/ray_pattern.hpp"
#include "lumo/optics/transport/splatting.hpp"
#include "lumo/optics/transport/view_gather.hpp"
#include "lumo/optics/view.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <iterator>
#include <numeric>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

namespace lumo {

/// Planes in which body, mesh and emitters are their own mirror images.
inline Symmetry symmetry_of(const Body& body, const TetMesh& mesh) {
  const Symmetry s = RayPattern::symmetry_of(body.emitters), m = mesh.symmetry, b = body.symmetry;
  return {s.x && m.x && b.x, s.y && m.y && b.y};
}

/// Traces light from a body's emitters through its deformed shape to the channels of the readout.
///
/// Emitters in the medium (or in air beside it), both Fresnel branches at smooth interfaces, opaque carrier, straight
/// rays in air (model: paper §III). Channels of the response: those of the readout for the light of the first colour,
/// then for that of the next. A medium that scatters sends on light twice from each straight piece, straight and
/// scattered; steps 1 to 3 hold for both, but emitters' light that was scattered is neither spread nor gathered.
/// 1. trace_emitters: paths from the emitters, on a random grid or net of directions that is the same for every design,
///    state and emitter, until they are absorbed, leave for good, or fall on a Lambertian face. Light that leaves
///    through regions after reflections is spread between neighbouring paths (splatting.hpp).
/// 2. trace_faces: Lambertian faces, of the body and of the carrier seen through air, exchange their light, linear
///    between nodes (radiosity.hpp).
/// 3. Light that leaves through faces with regions is gathered backwards from them (next_event.hpp): direct light and
///    light of Lambertian faces. Channel by channel the paths' own light stays where it is better known
///    (choose_better). Steps 1 and 3 are plain forward tracing if exit_rays = 0.
/// Random numbers of later events are keyed by (path, event). Same arguments, same bits, whatever the thread; const and
/// thread-safe: run one state per task. Errors: of the integration, stated in the Response; of light that is linear
/// between nodes (scene.sub_facets, scene.carrier_cell_m), and of spreading, which are not in it.
template <TransparentMedium Medium = BeerLambert, ExitReadout Readout = ExitPower, Intersector Backend = Bvh>
class Tracer {
 public:
  struct Config {
    int rays_per_emitter = 1 << 16;  ///< over all replicates; a power of two
    int replicates = 8;          ///< independent scrambles of the pattern; a power of two ≥ 2, ≤ rays_per_emitter/4
    int carrier_rays = 1 << 15;  ///< over all replicates and Lambertian faces, by area; at least one on each triangle
    int exit_rays = 1 << 18;     ///< likewise over the faces with regions that light is gathered from; 0: not done
    double roulette_below = 0.02;  ///< branches below this share of their path's start weight may be ended
    double scattered_below = 0.5;  ///< the same for the many branches that were scattered in the medium
    int max_events = 4096;         ///< a branch that meets more surfaces is booked as lost
    /// Share of the emitted power beyond which a result is refused, if it is more than a few paths (lost_admitted).
    /// Only light that is caught for good, in a body that absorbs nothing, needs more.
    double largest_lost = EnergyLedger::largest_lost;
    std::uint64_t seed = 0;  ///< another number, another independent pattern
    OpticalScene::Config scene{};
  };

  Tracer() = default;
  explicit Tracer(const Config& config, const Readout& readout = {}, const Backend& backend = {})
      : config_(config), readout_(readout), backend_(backend) {}

  const Config& config() const { return config_; }

  /// Channels of the response: those of the readout for each colour; 0 without emitters.
  int channels(const Body& body) const { return color_count(body.emitters) * readout_.channels(body); }
  /// Channel → its mirror image in the plane across `axis` (0: x, 1: y). nullopt if the emitters are not symmetric or
  /// the readout does not know.
  std::optional<std::vector<int>> image_channels(const Body& body, int axis) const {
    if constexpr (requires {
                    { readout_.image_channels(body, axis) } -> std::convertible_to<std::optional<std::vector<int>>>;
                  }) {
      const Symmetry light = RayPattern::symmetry_of(body.emitters);
      if (axis == 0 ? !light.x : !light.y) return std::nullopt;
      const std::optional<std::vector<int>> one = readout_.image_channels(body, axis);
      if (!one) return std::nullopt;
      std::vector<int> all;
      for (int color = 0; color < color_count(body.emitters); ++color)
        for (int c : *one) all.push_back(color * int(one->size()) + c);
      return all;
    } else {
      return std::nullopt;
    }
  }

  /// The same tracer with `factor` times as many rays of each kind, a power of two, and with an independent pattern for
  /// each number of `pattern`. Compare its responses with its own only. Throws InvalidArgument for a factor that is no
  /// power of two, or out of range.
  Tracer refined(double factor, std::uint64_t pattern = 0) const {
    require_in_range("refinement factor", factor, 1.0 / (1 << 12), double(1 << 12), "");
    int exponent = 0;
    if (std::frexp(factor, &exponent) != 0.5)
      throw InvalidArgument(message("refinement factor is ", factor, ", must be a power of two"));
    Tracer t = *this;
    Config& c = t.config_;
    const auto times = [&](int rays, int least) {
      return rays == 0 ? 0 : int(std::clamp(rays * factor, double(least), double(1 << 28)));
    };
    c.rays_per_emitter = times(c.rays_per_emitter, 4 * c.replicates);
    c.carrier_rays = times(c.carrier_rays, 1);
    c.exit_rays = times(c.exit_rays, 1);
    if (pattern > 0) c.seed = combine(config_.seed, pattern);
    return t;
  }

  /// Share of lost light up to which a result stands: a few paths may be lost, however few there are.
  double lost_admitted(const Body& body) const {
    constexpr double few = 10.0;
    return std::max(config_.largest_lost,
        few / (double(config_.rays_per_emitter) * double(std::max<std::size_t>(1, body.emitters.size()))));
  }

  /// `count` of the replicates from `first` on, as a tracer of its own: tasks that can run side by side. joined() makes
  /// of their responses that of all replicates, to the bit for the same division. A portion is not refused for what
  /// it loses: that is for require_closed() of the joined ledger.
  Tracer portion(int first, int count) const {
    Tracer t = *this;
    t.first_ = first_ + first;
    t.count_ = count;
    return t;
  }
  static Response joined(const std::vector<Response>& portions) {
    Response all;
    for (const Response& p : portions) {
      const Eigen::Index rows = all.replicates.rows(), more = p.replicates.rows();
      for (const auto& [sum, part] : {std::pair(&all.replicates, &p.replicates), std::pair(&all.direct, &p.direct),
               std::pair(&all.forward, &p.forward), std::pair(&all.forward_direct, &p.forward_direct)}) {
        sum->conservativeResize(rows + more, part->cols());
        sum->bottomRows(more) = *part;
      }
      all.ledgers.insert(all.ledgers.end(), p.ledgers.begin(), p.ledgers.end());
      all.rays += p.rays;
      all.segments += p.segments;
    }
    choose_better(all);
    return averaged(std::move(all));
  }

  /// Response of the undeformed body. Uses its symmetry when mesh and emitters share it.
  Response trace(const Body& body, const TetMesh& mesh) const {
    return trace(body, mesh, SurfaceState{}, symmetry_of(body, mesh));
  }

  /// Response of a mechanical state. `symmetry`: planes in which body *and* state are their own mirror images.
  Response trace(const Body& body, const TetMesh& mesh, const MechanicalState& state, Symmetry symmetry = {},
      const RayFocus& focus = {}, const RayGuide& guide = {}) const {
    return trace(body, mesh, surface_of(state), symmetry, focus, guide);
  }

  /// Response under `displacement` [m] and `contact_field` (> 0 in contact) per mesh node; either may be empty.
  Response trace(const Body& body, const TetMesh& mesh, const std::vector<Vec3d>& displacement,
      const std::vector<double>& contact_field, Symmetry symmetry = {}, const RayFocus& focus = {}) const {
    return trace(body, mesh, SurfaceState{displacement, contact_field}, symmetry, focus);
  }

  /// Response of a surface that is given node by node.
  /// One of two mirror images in a plane of `symmetry` is traced, and booked for both: the caller vouches for it.
  /// `focus` must have the symmetry; `guide` is of this body, mesh and tracer, and read-out through openings does
  /// without. Throws InvalidArgument for broken numbers, sizes or settings and for an emitter that lies out of the
  /// medium that it radiates into (by more than nodes have moved: LampPlaces), MeshError for patches off their shapes
  /// (require_on_shapes), NumericalError if light is lost (require_closed); never returns a NaN.
  Response trace(const Body& body, const TetMesh& mesh, const SurfaceState& state, Symmetry symmetry = {},
      const RayFocus& focus = {}, const RayGuide& guide = {}) const {
    check(body, symmetry, focus);
    const Medium medium{body.medium};
    const OpticalScene surface(body, mesh, state, symmetry, config_.scene);
    const auto scene = backend_.build(surface.triangles());
    using Scene = std::remove_const_t<decltype(scene)>;
    check(body, surface, scene, guide);
    const LightNodes nodes(surface, symmetry, guide);
    const FaceSet lambertian = sending_faces(body, surface, nodes, symmetry, guide),
                  exits = gathering_faces(surface, symmetry, focus);
    const int channels = readout_.channels(body), colors = color_count(body.emitters);
    const LitBody<Scene, Medium, Readout> lit{surface, scene, medium, BeerLambert(body.surroundings).refractive_index(),
        readout_, channels, nodes, exits, symmetry};
    PathTracer<Scene, Medium, Readout> path(lit, {config_.roulette_below, config_.scattered_below, config_.max_events});
    struct Color {
      RayPattern pattern;
      NextEventGather<Scene, Medium, Readout> gather;
    };
    std::vector<Color> light;
    for (int c = 0; c < colors; ++c) {
      const std::vector<Emitter> emitters = emitters_of(body, c);
      const auto rays = std::uint32_t(config_.rays_per_emitter / config_.replicates);
      light.push_back({RayPattern(emitters, rays, symmetry, focus), {emitters, lit, path, body.film_closes_m}});
    }

    const int count = count_ > 0 ? count_ : config_.replicates;
    Response response = unwritten(count, colors * channels, exits.size() > 0);
    for (int r = 0; r < count; ++r) {
      const auto sequence = [&](std::uint64_t use) {
        return OwenSobol{combine(config_.seed, 3 * std::uint64_t(first_ + r) + use)};
      };
      std::vector<Tally> totals;
      for (std::size_t c = 0; c < light.size(); ++c) {
        trace_emitters(lit, light[c].pattern, body.film_closes_m, sequence(0), path,
            guide.directions.empty() ? nullptr : &guide.directions[c]);
        totals.push_back(path.accounts().take());
      }
      const RadiosityTransport transport = trace_faces(lit, lambertian, sequence(1), path);
      for (int k = 0; k < colors; ++k) {
        Tally& total = totals[std::size_t(k)];
        const std::vector<double> direct = total.gathered;  // by emitters' paths
        const std::vector<double> sent = solve_radiosity(nodes, transport, total);
        book_forward(total, direct, r, k * channels, response);
        light[std::size_t(k)].gather.run(sequence(2), sent, total);
        book(total, r, k * channels, response);
      }
    }
    response.rays = path.rays;
    response.segments = path.segments;
    if (count_ == 0) choose_better(response);
    response = averaged(std::move(response));
    if (count_ == 0) require_closed(response.ledger, lost_admitted(body));
    return response;
  }

  /// Light on the lines of a view, of a body in one state: what its Lambertian faces send is found as for a response,
  /// and the lines' paths run backwards to them and to the emitters. Nothing else shines, and the tool is seen as the
  /// contact set only, black. Bit-identical for every executor. Throws as trace() does, and InvalidArgument for broken
  /// settings of the view and for emitters that cannot be seen.
  template <View V, Executor E> ViewLight look(const Body& body, const TetMesh& mesh, const SeenState& state,
      const V& view, const ViewEffort& effort, const E& executor) const {
    const Symmetry symmetry = state.symmetry;
    check(body, symmetry, {});
    const int replicates = check(body, view.pixels(), effort), samples = effort.samples / replicates;
    const Medium medium{body.medium};
    const OpticalScene surface(body, mesh, state.surface, symmetry, config_.scene);
    const auto scene = backend_.build(surface.triangles());
    using Scene = std::remove_const_t<decltype(scene)>;
    check(body, surface, scene, {});
    const LightNodes nodes(surface, symmetry);
    const FaceSet exits(surface, symmetry, {.whole = true}, [](int) { return false; });
    const LitBody<Scene, Medium, Readout> lit{surface, scene, medium, BeerLambert(body.surroundings).refractive_index(),
        readout_, readout_.channels(body), nodes, exits, symmetry};
    using Gather = ViewGather<Scene, Medium, Readout>;
    std::vector<typename Gather::Color> colors;
    for (int c = 0; c < color_count(body.emitters); ++c)
      colors.push_back({std::vector<std::vector<double>>(std::size_t(replicates)),
          emitter_faces(emitters_of(body, c), lit, body.film_closes_m)});
    ViewLight seen;
    seen.ledger = sent_light(body, lit, executor, colors);
    require_closed(seen.ledger, lost_admitted(body));
    const std::size_t pixels = std::size_t(view.pixels()), tasks = (pixels + pixels_together - 1) / pixels_together;
    seen.replicates.resize(replicates, Eigen::Index(pixels * colors.size()));
    std::vector<double> lines(tasks, 0.0), lost(tasks, 0.0);
    executor.for_each(tasks, [&](std::size_t task) {
      Gather gather(lit, {effort.roulette_below, config_.scattered_below, config_.max_events}, colors,
          combine(config_.seed, view_key));
      for (std::size_t k = task * pixels_together; k < std::min(pixels, (task + 1) * pixels_together); ++k) {
        const auto found = gather(view, int(k), replicates, samples);
        for (std::size_t c = 0; c < colors.size(); ++c)
          for (int r = 0; r < replicates; ++r)
            seen.replicates(r, Eigen::Index(c * pixels + k)) =
                found.light[c * std::size_t(replicates) + std::size_t(r)];
        lines[task] += found.lines;
        lost[task] += found.lost;
      }
    });
    require_lines_kept(lines, lost, pixels * std::size_t(effort.samples));
    if (!seen.replicates.allFinite()) throw NumericalError("light: a pixel of the view is not finite");
    return seen;
  }

  /// Learns how these states' light differs from that of the undeformed body, all on one mesh: empty unless emitters
  /// radiate into air. `symmetry`: planes in which body and all of the states are their own mirror images.
  RayGuide guide(const Body& body, const TetMesh& mesh, const std::vector<const MechanicalState*>& states,
      Symmetry symmetry = {}) const {
    check(body, symmetry, {});
    RayGuide learned;
    if (ConnectedReadout<Readout> ||
        std::none_of(body.emitters.begin(), body.emitters.end(), [](const Emitter& e) { return e.in_air(); }))
      return learned;
    std::vector<RayPattern> patterns;
    for (int c = 0; c < color_count(body.emitters); ++c)
      patterns.emplace_back(emitters_of(body, c), guide_rays, symmetry);
    const OwenSobol sequence{combine(config_.seed, guide_rays)};
    GuideLesson lesson(std::move(patterns), sequence);
    const Medium medium{body.medium};
    const int channels = readout_.channels(body);
    for (std::size_t k = 0; k <= states.size(); ++k) {
      const OpticalScene surface(
          body, mesh, k == 0 ? SurfaceState{} : surface_of(*states[k - 1]), symmetry, config_.scene);
      const auto scene = backend_.build(surface.triangles());
      using Scene = std::remove_const_t<decltype(scene)>;
      const LightNodes nodes(surface, symmetry);
      const FaceSet exits(surface, symmetry, {.whole = true}, [](int) { return false; });
      const LitBody<Scene, Medium, Readout> lit{surface, scene, medium,
          BeerLambert(body.surroundings).refractive_index(), readout_, channels, nodes, exits, symmetry};
      PathTracer<Scene, Medium, Readout> path(
          lit, {config_.roulette_below, config_.scattered_below, config_.max_events});
      const FilmLaunch launch(scene, body.film_closes_m);
      if (k > 0) {
        lesson.state(path, launch);
        continue;
      }
      Tally light = lesson.undeformed(path, launch);
      const RadiosityTransport transport =
          trace_faces(lit, sending_faces(body, surface, nodes, symmetry, {}), sequence, path);
      learn_sent_light(surface, nodes, solve_radiosity(nodes, transport, light), learned);
    }
    learned.directions = lesson.directions();
    return learned;
  }

 private:
  static constexpr std::uint32_t guide_rays = 1 << 16;  ///< of each emitter; far fewer learn chance
  static constexpr double sent_per_emitted = 4.0;       ///< rays a watt that bright faces send
  static constexpr std::uint64_t view_key = 5;          ///< of the lines' sequence
  static constexpr std::size_t pixels_together = 64;    ///< in one task

  static SurfaceState surface_of(const MechanicalState& state) {
    return {state.displacement, state.contact_field, state.tool_slopes, state.carrier_slopes};
  }
  static std::vector<Emitter> emitters_of(const Body& body, int color) {
    std::vector<Emitter> emitters;
    std::copy_if(body.emitters.begin(), body.emitters.end(), std::back_inserter(emitters),
        [&](const Emitter& e) { return e.channel() == color; });
    return emitters;
  }

  // Few paths lead through an opening: there light is gathered or not known.
  static Response unwritten(int rows, int columns, bool gathers) {
    Response r;
    r.replicates.resize(rows, columns);
    r.direct.resize(rows, columns);
    r.ledgers.resize(std::size_t(rows));
    if (gathers && !ConnectedReadout<Readout>) r.forward_direct = r.forward = r.replicates;
    return r;
  }
  // Power, error and ledger from the replicates.
  static Response averaged(Response response) {
    response.ledger = {};
    for (const EnergyLedger& one : response.ledgers)
      add_scaled(response.ledger, one, 1.0 / double(response.ledgers.size()));
    for (Eigen::Index c = 0; c < response.replicates.cols(); ++c)
      response.ledger.channels.push_back(response.replicates.col(c).mean());
    response.power_W = response.ledger.channels;
    response.error_W = standard_error(response.replicates);
    return response;
  }

  /// Throws InvalidArgument unless settings, body and focus can be traced.
  void check(const Body& body, Symmetry symmetry, const RayFocus& focus) const {
    const auto power_of_two = [](const char* what, int value, int low) {
      require_in_range(what, value, low, 1 << 28, "");
      if (!std::has_single_bit(unsigned(value)))
        throw InvalidArgument(message(what, " is ", value, ", must be a power of two"));
    };
    power_of_two("replicates", config_.replicates, 2);
    power_of_two("rays per emitter", config_.rays_per_emitter, 4 * config_.replicates);
    require_in_range("carrier rays", config_.carrier_rays, 1, 1 << 30, "");
    require_in_range("exit rays", config_.exit_rays, 0, 1 << 30, "");
    require_in_range("roulette_below", config_.roulette_below, 0.0, 1.0, "");
    require_in_range("scattered_below", config_.scattered_below, 1e-4, 1.0, "");  // each piece sends on two
    require_in_range("max_events", config_.max_events, 1, 1 << 28, "");
    require_in_range("largest share of lost light", config_.largest_lost, 0.0, 1.0, "");
    if (body.surroundings.extinction_per_m != 0.0)
      throw InvalidArgument(
          message("surroundings extinguish ", body.surroundings.extinction_per_m, " 1/m, only 0 1/m is known"));

    require_in_range("focus of the rays", focus.y_m, -1e3, 1e3, "m");
    require_in_range("length of the rays' focus", focus.length_m, 0.0, 1e3, "m");
    require_in_range("least density of rays", focus.least, 1e-6, 1.0, "");
    if (symmetry.y && !focus.is_symmetric())
      throw InvalidArgument(
          message("rays are focussed on y = ", focus.y_m * 1e3, " mm, must be 0 mm in a state that is symmetric in y"));
    validate(body.emitters);
    require_in_range("readout channels", readout_.channels(body), 0, 1 << 18, "");
  }
  /// Replicates that lines of a view are divided by. Throws InvalidArgument.
  int check(const Body& body, int pixels, const ViewEffort& effort) const {
    require_in_range("pixels of a view", pixels, 1, 1 << 26, "");
    require_in_range("samples per pixel", effort.samples, 1, 1 << 20, "");
    require_in_range("roulette_below of a view", effort.roulette_below, 0.0, 1.0, "");
    const int replicates = std::min(config_.replicates, effort.samples);
    if (effort.samples % replicates != 0 || config_.replicates % replicates != 0)
      throw InvalidArgument(message("samples per pixel are ", effort.samples, ", must be a multiple of ",
          config_.replicates, ", or a power of two below"));
    for (const Emitter& e : body.emitters)
      if (!e.can_be_seen())
        throw InvalidArgument("view: an emitter has no area or no known shape, so that no line of sight meets it");
    return replicates;
  }
  /// Throws NumericalError if more light than admitted is lost on lines of sight.
  void require_lines_kept(const std::vector<double>& lines, const std::vector<double>& lost, std::size_t count) const {
    constexpr double few = 10.0;
    const double all = std::accumulate(lines.begin(), lines.end(), 0.0),
                 gone = std::accumulate(lost.begin(), lost.end(), 0.0),
                 admitted = std::max(config_.largest_lost, few / double(count));
    if (!(gone <= admitted * all))
      throw NumericalError(message("light: ", gone / all, " of the lines of sight are lost, at most ", admitted,
          ": the surface is open, or max_events is too small"));
  }
  /// Finds what Lambertian faces send in each replicate, colour by colour. Returns the mean ledger.
  template <class Scene, Executor E, class Color> EnergyLedger sent_light(const Body& body,
      const LitBody<Scene, Medium, Readout>& lit, const E& executor, std::vector<Color>& colors) const {
    const FaceSet lambertian = sending_faces(body, lit.surface, lit.nodes, lit.symmetry, {});
    std::vector<RayPattern> patterns;
    for (std::size_t c = 0; c < colors.size(); ++c)
      patterns.emplace_back(
          emitters_of(body, int(c)), std::uint32_t(config_.rays_per_emitter / config_.replicates), lit.symmetry);
    std::vector<EnergyLedger> ledgers(colors.front().sent.size());
    executor.for_each(ledgers.size(), [&](std::size_t r) {
      const auto sequence = [&](std::uint64_t use) { return OwenSobol{combine(config_.seed, 3 * r + use)}; };
      PathTracer<Scene, Medium, Readout> path(
          lit, {config_.roulette_below, config_.scattered_below, config_.max_events});
      const RadiosityTransport transport = trace_faces(lit, lambertian, sequence(1), path);
      for (std::size_t c = 0; c < colors.size(); ++c) {
        trace_emitters(lit, patterns[c], body.film_closes_m, sequence(0), path, nullptr);
        Tally total = path.accounts().take();
        colors[c].sent[r] = solve_radiosity(lit.nodes, transport, total);
        for (const double w : total.ledger.channels) total.ledger.elsewhere += w;
        total.ledger.channels.clear();
        add_scaled(ledgers[r], total.ledger, 1.0);
      }
    });
    EnergyLedger mean;
    for (const EnergyLedger& one : ledgers) add_scaled(mean, one, 1.0 / double(ledgers.size()));
    return mean;
  }
  /// Throws InvalidArgument unless lamps and guide fit the scene.
  template <class Scene>
  static void check(const Body& body, const OpticalScene& surface, const Scene& scene, const RayGuide& guide) {
    LampPlaces<Scene>(surface.triangles(), scene, surface.precision_m(), surface.moved_m()).require(body.emitters);
    if (!guide.sent_W_m2.empty() && guide.sent_W_m2.size() != surface.triangles().size())
      throw InvalidArgument(
          message("ray guide for ", guide.sent_W_m2.size(), " triangles, the scene has ", surface.triangles().size()));
  }
  template <class Scene> void trace_emitters(const LitBody<Scene, Medium, Readout>& body, const RayPattern& pattern,
      std::optional<double> film_closes_m, const OwenSobol& sequence, PathTracer<Scene, Medium, Readout>& path,
      const std::vector<DirectionDensity>* densities) const {
    constexpr bool connected = ConnectedReadout<Readout>;  // an opening is too small to be found between rays
    const FilmLaunch launch(body.scene, film_closes_m);
    Splatting splatting(path);
    for (const RayPattern::Beam& beam : pattern.beams()) {
      const bool air = beam.source.in_air();
      if (config_.exit_rays > 0 && !connected && !air) {
        splatting.run(beam, sequence);
        continue;
      }
      // Few ways from a face and an emitter lead through an opening.
      const bool all = WholeReadout<Readout> && config_.exit_rays > 0 && beam.source.can_be_seen(),
                 direct = all || (!connected && beam.source.has_intensity() && !air);
      double worth = 1.0;  // of the ray at hand, in those that are sent evenly
      const auto start = [&](const PrimaryRay& ray, double share, bool inside) {
        path.run({.ray = ray,
            .mirror = beam.mirror,
            .power_W = share * worth * beam.power_W,
            .inside = inside,
            .gathers_direct = direct,
            .gathers_all = all});
      };
      for (std::uint32_t i = 0; i < beam.rays; ++i) {
        std::array<double, 4> u = RayPattern::numbers(sequence, i);
        worth = 1.0;
        if (air && densities != nullptr) {
          const DirectionDensity::Place place = (*densities)[beam.orbit](u[0], u[1]);
          u[0] = place.u;
          u[1] = place.v;
          worth = 1.0 / place.density;
        }
        const PrimaryRay ray = RayPattern::ray(beam, u, sequence.seed, i);
        if (air) launch(ray, beam.mirror.cwiseProduct(beam.axis), start);
        else start(ray, 1.0, true);
      }
    }
  }
  /// Faces with regions, or seen through openings, that light is gathered from.
  FaceSet gathering_faces(const OpticalScene& surface, Symmetry symmetry, const RayFocus& focus) const {
    const double rays = double(config_.exit_rays) / config_.replicates;
    return FaceSet(surface, symmetry, {.whole = true, .total = rays, .least = 2, .focus = focus}, [&](int t) {
      return config_.exit_rays > 0 && is_dielectric(surface.optics(t)) &&
             (ConnectedReadout<Readout> || surface.has_region(t / surface.triangles_per_face()));
    });
  }
  /// Lambertian faces, with rays by area and, as far as is known, by the light that falls there.
  FaceSet sending_faces(const Body& body, const OpticalScene& surface, const LightNodes& nodes, Symmetry symmetry,
      const RayGuide& guide) const {
    FaceSet::Sampling sampling{.total = double(config_.carrier_rays) / config_.replicates};
    if (!guide.sent_W_m2.empty()) {
      double emitted = 0.0;
      for (const Emitter& e : body.emitters) emitted += e.power_W();
      const double per_watt = sent_per_emitted * double(config_.rays_per_emitter) * double(body.emitters.size()) /
                              config_.replicates / emitted;
      for (double w : guide.sent_W_m2) sampling.density.push_back(sampling.total / guide.area_m2 + per_watt * w);
      sampling.total += per_watt * guide.sent_W;
    }
    return FaceSet(surface, symmetry, sampling, [&](int t) { return nodes.of(t)[0] >= 0; });
  }
  template <class Scene> RadiosityTransport trace_faces(const LitBody<Scene, Medium, Readout>& body,
      const FaceSet& lambertian, const OwenSobol& sequence, PathTracer<Scene, Medium, Readout>& path) const {
    const double images = (body.symmetry.x ? 2.0 : 1.0) * (body.symmetry.y ? 2.0 : 1.0);
    RadiosityTransport transport(body.nodes.size(), body.channels);
    for (std::size_t k = 0; k < lambertian.size(); ++k)
      for (std::uint32_t i = 0; i < lambertian[k].count; ++i) {
        FaceSet::Sample x = lambertian.sample(k, body.surface, sequence, i);
        const bool inside = x.at.face >= 0;
        const Vec3d lit = inside ? Vec3d(-x.normal) : x.normal;
        x.ray.direction =
            reflected(Lambertian{}, -lit, lit, sequence(x.index, 0), sequence(x.index, 1), lambertian[k].mirror);
        path.run({.ray = x.ray,
            .mirror = lambertian[k].mirror,
            .power_W = 1.0 / images,
            .from_emitter = false,
            .inside = inside});
        transport.add(path.accounts().take(), body.nodes.of(x.ray.triangle), LightNodes::shares(x.at), x.area);
      }
    return transport;
  }
  /// Books what paths alone found, of which `direct` W is gathered, too.
  void book_forward(
      const Tally& total, const std::vector<double>& direct, int r, Eigen::Index first, Response& response) const {
    if (response.forward.cols() == 0) return;
    for (std::size_t c = 0; c < total.ledger.channels.size(); ++c) {
      response.forward(r, first + Eigen::Index(c)) = total.ledger.channels[c];
      response.forward_direct(r, first + Eigen::Index(c)) = total.direct[c] + direct[c];
    }
  }
  /// Books replicate `r` of one colour in the channels from `first` on.
  void book(Tally& total, int r, Eigen::Index first, Response& response) const {
    for (std::size_t c = 0; c < total.ledger.channels.size(); ++c) {
      response.replicates(r, first + Eigen::Index(c)) = total.ledger.channels[c];
      response.direct(r, first + Eigen::Index(c)) = total.direct[c];
    }
    total.ledger.channels.clear();
    add_scaled(response.ledgers[std::size_t(r)], total.ledger, 1.0);
  }

  Config config_{};
  Readout readout_{};
  Backend backend_{};
  int first_ = 0, count_ = 0;  // replicates that are traced; 0: all
};

}  // namespace lumo
