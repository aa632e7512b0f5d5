// Memory that runs out in the middle of a press or a trace. This program has its own operator new.
#include "catch.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/optics/tracer.hpp"
#include "mechanics/bodies.hpp"
#include "optics/scenes.hpp"

#include <cstdlib>
#include <new>

namespace {

long live = 0;         // pieces of memory that are not given back
long until_none = -1;  // calls until there is no memory; negative: there is
bool ran_out = false;

void* piece(std::size_t size, std::size_t alignment) {
  if (until_none == 0) {
    ran_out = true;
    throw std::bad_alloc();
  }
  if (until_none > 0) --until_none;
  void* const p = std::aligned_alloc(alignment, (size + alignment) / alignment * alignment);
  if (!p) throw std::bad_alloc();
  ++live;
  return p;
}

void give_back(void* p) {
  live -= p != nullptr;
  std::free(p);
}

}  // namespace

void* operator new(std::size_t size) { return piece(size, alignof(std::max_align_t)); }
void* operator new(std::size_t size, std::align_val_t alignment) { return piece(size, std::size_t(alignment)); }
void operator delete(void* p) noexcept { give_back(p); }
void operator delete(void* p, std::size_t) noexcept { give_back(p); }
void operator delete(void* p, std::align_val_t) noexcept { give_back(p); }
void operator delete(void* p, std::size_t, std::align_val_t) noexcept { give_back(p); }

using namespace lumo;

namespace {

struct Ended {
  int out = 0, odd = 0, leaked = 0, whole = 0;
};

// `work` with no memory from the call `first`, the next, … on: it ends by std::bad_alloc or a typed error, and gives
// everything back.
template <class Work> Ended without_memory(int first, int last, const Work& work) {
  work();  // what is made once and kept
  Ended ended;
  for (int n = first; n <= last; ++n) {
    const long before = live;
    ran_out = false;
    until_none = n;
    try {
      work();
    } catch (const std::bad_alloc&) {
      ++ended.out;
    } catch (const Error&) {
      ++ended.out;
    } catch (...) {
      ++ended.odd;
    }
    until_none = -1;
    ended.leaked += live != before;
    ended.whole += !ran_out;
  }
  return ended;
}

constexpr int calls = 2000;

}  // namespace

TEST_CASE("a press without memory ends by a typed error, and leaks nothing") {
  const Vec3d size(6e-3, 6e-3, 4e-3);
  const Body body = test::block_body(size);
  const TetMesh mesh = test::block_mesh(size, test::even(3), test::even(3), test::even(2), 2, false);
  const Simulator simulator{NeoHookean{1e5, 2e6}, SDFContact{}};
  const Scenario<Sphere> contact{Sphere{20e-3}, 0.0, 3e-3, {0.05}, TiltPlane::xz, 3e-3};
  const Ended ended = without_memory(0, calls, [&] { simulator.press(body, mesh, contact); });
  CHECK(ended.odd == 0);
  CHECK(ended.leaked == 0);
  CHECK(ended.out + ended.whole == calls + 1);
  CHECK(ended.out > calls / 2);
}

TEST_CASE("a trace without memory ends by a typed error, and leaks nothing") {
  auto lit = optics_test::box(Vec3d(0.01, 0.02, 0.005), {1.41, 14.5}, 2);
  lit.body.patches[4].optics = Lambertian{0.7};
  lit.body.emitters = {RectangleEmitter{{0, 0, 0}, {1e-3, 0, 0}, {0, 1e-3, 0}}};
  lit.body.regions = 1;
  lit.body.region = [](const Vec3d&, const Vec3d& n) { return n.x() > 0.5 ? 0 : -1; };
  Tracer<BeerLambert>::Config few;
  few.rays_per_emitter = few.carrier_rays = few.exit_rays = 64;
  const Tracer<BeerLambert> tracer(few);
  const Ended ended = without_memory(0, calls, [&] { tracer.trace(lit.body, lit.mesh); });
  CHECK(ended.odd == 0);
  CHECK(ended.leaked == 0);
  CHECK(ended.out + ended.whole == calls + 1);
  CHECK(ended.out > 100);
}
