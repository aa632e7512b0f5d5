#include "lumo/support/tetgen.hpp"

#include "catch.hpp"
#include "geometry/surfaces.hpp"
#include "mesh/mesher_laws.hpp"

#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <map>
#include <optional>
#include <set>
#include <thread>
#include <vector>

using lumo::ForkServer;
using lumo::JobBytes;
using lumo::JobOutcome;
using lumo::LinearTets;
using lumo::MeshError;
using lumo::MeshInput;
using lumo::TetgenMesher;
using lumo::Vec3d;
using Reason = MeshError::Reason;
using namespace mesher_laws;
using namespace surfaces;

namespace {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool sanitized = true;
#elif defined(__has_feature)
constexpr bool sanitized = __has_feature(address_sanitizer) || __has_feature(thread_sanitizer);
#else
constexpr bool sanitized = false;
#endif

std::size_t open_files(int pid) {
  const auto entries = std::filesystem::directory_iterator("/proc/" + std::to_string(pid) + "/fd");
  return static_cast<std::size_t>(std::distance(begin(entries), end(entries)));
}
std::size_t open_files() { return open_files(::getpid()); }

/// Child processes, dead or alive.
std::set<int> children() {
  std::set<int> found;
  for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
    const std::string name = entry.path().filename();
    if (name.find_first_not_of("0123456789") != std::string::npos) continue;
    std::FILE* file = std::fopen((entry.path() / "stat").c_str(), "r");
    if (file == nullptr) continue;
    int parent = 0;
    if (std::fscanf(file, "%*d %*[^)]) %*c %d", &parent) == 1 && parent == ::getpid()) found.insert(std::stoi(name));
    std::fclose(file);
  }
  return found;
}

double seconds_of(const std::function<void()>& action) {
  const auto begin = std::chrono::steady_clock::now();
  action();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

std::optional<Reason> verdict(const TetgenMesher& mesher, const MeshInput& input) {
  try {
    mesher.fill(input);
    return std::nullopt;
  } catch (const MeshError& error) {
    CHECK(std::string(error.what()).find('\n') == std::string::npos);
    return error.reason();
  }
}

double quantile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1, static_cast<std::size_t>(share * static_cast<double>(values.size())))];
}

/// Edge lengths over wanted lengths at their middles.
std::vector<double> relative_lengths(const LinearTets& mesh, const std::function<double(const Vec3d&)>& wanted) {
  std::set<std::pair<int, int>> edges;
  for (const auto& t : mesh.tets)
    for (std::size_t i = 0; i < 4; ++i)
      for (std::size_t j = i + 1; j < 4; ++j) edges.insert(std::minmax(t[i], t[j]));
  std::vector<double> ratios;
  for (const auto& [a, b] : edges)
    ratios.push_back((at(mesh, a) - at(mesh, b)).norm() / wanted(0.5 * (at(mesh, a) + at(mesh, b))));
  return ratios;
}

/// Smallest dihedral angle of each tetrahedron [°].
std::vector<double> smallest_dihedrals(const LinearTets& mesh) {
  std::vector<double> angles;
  for (const auto& t : mesh.tets) {
    std::array<Vec3d, 4> normals;
    for (std::size_t k = 0; k < 4; ++k) {
      const auto& f = lumo::outward_faces[k];
      normals[k] = area(mesh,
          {t[static_cast<std::size_t>(f[0])], t[static_cast<std::size_t>(f[1])], t[static_cast<std::size_t>(f[2])]})
                       .normalized();
    }
    double least = 180.0;
    for (std::size_t i = 0; i < 4; ++i)
      for (std::size_t j = i + 1; j < 4; ++j)
        least =
            std::min(least, std::acos(std::clamp(-normals[i].dot(normals[j]), -1.0, 1.0)) * 180.0 / std::numbers::pi);
    angles.push_back(least);
  }
  return angles;
}

JobBytes echo(std::span<const char> request) { return {request.begin(), request.end()}; }
JobBytes do_abort(std::span<const char>) { std::abort(); }
JobBytes do_segfault(std::span<const char>) {
  ::raise(SIGSEGV);
  return {};
}
JobBytes do_loop(std::span<const char>) {
  for (std::atomic<int> i = 0;; ++i) {
  }
}
JobBytes do_sleep(std::span<const char>) {
  for (;;) ::sleep(100);
}
JobBytes do_throw(std::span<const char>) { throw 42; }
JobBytes do_exit(std::span<const char>) { ::_exit(0); }
JobBytes do_print(std::span<const char> request) {
  std::cout << "this must not be seen" << std::endl;
  std::cerr << "this must not be seen" << std::endl;
  return echo(request);
}
JobBytes do_allocate(std::span<const char>) {
  for (std::vector<JobBytes> hoard;;) hoard.emplace_back(JobBytes(1 << 20, 'x'));
}
JobBytes do_careless_allocate(std::span<const char>) {  // as C code that does not look at malloc's result
  for (static void* volatile hoard;;) {                 // volatile: compilers remove memory that nobody looks at
    hoard = std::malloc(1 << 20);
    std::memset(hoard, 1, 1 << 20);
  }
}

/// In memory that jobs share with the test.
std::atomic<int>& jobs_begun() {
  static auto* count =
      ::new (::mmap(nullptr, sizeof(std::atomic<int>), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0))
          std::atomic<int>(0);
  return *count;
}

JobBytes loses_helper(std::span<const char>) {
  ::kill(::getppid(), SIGKILL);
  for (;;) ::pause();  // goes with the helper
}

JobBytes loses_helper_once(std::span<const char> request) {
  return jobs_begun()++ == 0 ? loses_helper(request) : lumo::tetgen_job(request);
}

TetgenMesher with(ForkServer::Work work) {
  jobs_begun() = 0;  // before the fork
  TetgenMesher mesher;
  mesher.helper = std::make_shared<ForkServer>(work);
  return mesher;
}

}  // namespace

static_assert(lumo::Mesher<TetgenMesher>);
static_assert(!lumo::Mesher<int>);

TEST_CASE("good bodies are filled, with patches and outward faces", "[mesh][tetgen]") {
  const TetgenMesher mesher;
  std::mt19937_64 random(1);
  std::vector<MeshInput> bodies{
      box(Vec3d(0, 0, 0), Vec3d(1, 2, 3)), l_prism(), notched_finger(15), sphere(2), block(4, random)};
  bodies.push_back(box(Vec3d(0, 0, 0), Vec3d(4, 4, 4)));  // with a cavity
  MeshInput cavity = sphere(1, 1.0, Vec3d(2, 2, 2));
  invert(cavity);
  append(bodies.back(), cavity);
  bodies.push_back(sphere(1));  // two bodies
  append(bodies.back(), box(Vec3d(2, 0, 0), Vec3d(3, 1, 1)));
  for (MeshInput& body : bodies) {
    check_laws(mesher.fill(body), body);
    turn(body, random);
    for (Vec3d& v : body.vertices) v = 0.01 * v + Vec3d(0.3, -0.2, 0.1);
    body.edge = [](const Vec3d&) { return 0.003; };
    check_laws(mesher.fill(body), body);
  }
  MeshInput point = box(Vec3d(0, 0, 0), Vec3d(1, 1, 1));  // vertices of no facet are interior points
  point.vertices.emplace_back(0.3, 0.4, 0.6);
  check_laws(mesher.fill(point), point);
}

TEST_CASE("facets that rounding has taken off their planes are filled", "[mesh][tetgen]") {
  const TetgenMesher mesher;  // TetGen alone fails on some of these: seeds 15 and 57
  for (const unsigned seed : {3u, 15u, 57u, 70u}) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    const int n = 5 + static_cast<int>(random() % 60);
    std::vector<std::array<double, 2>> outline;
    for (int i = 0; i < n; ++i) {
      const double angle = 2.0 * std::numbers::pi * (i + 0.8 * unit(random)) / n;
      const double radius = 0.7 + 0.3 * unit(random);
      outline.push_back({radius * std::cos(angle), radius * std::sin(angle)});
    }
    MeshInput body = prism(outline, 0.1 + 2.0 * unit(random));
    turn(body, random);
    check_laws(mesher.fill(body), body);
  }
}

TEST_CASE("given facets are kept when asked for", "[mesh][tetgen]") {
  const TetgenMesher mesher;
  std::mt19937_64 random(2);
  MeshInput body = block(5, random);
  body.keep_surface = true;
  body.edge = [](const Vec3d& p) { return 0.1 + 0.1 * p.z(); };
  const LinearTets mesh = mesher.fill(body);
  check_laws(mesh, body);
  CHECK(mesh.faces.size() == body.facets.size());
  std::set<std::set<int>> given, kept;
  for (const auto& facet : body.facets) given.insert({facet.loop.begin(), facet.loop.end()});
  for (const auto& face : mesh.faces) kept.insert({face.begin(), face.end()});
  CHECK((given == kept));

  body = notched_finger(20);
  body.keep_surface = true;
  check_laws(mesher.fill(body), body);
}

TEST_CASE("the wanted edge length is obeyed, uniform and graded", "[mesh][tetgen]") {
  const TetgenMesher mesher;
  struct Wish {
    MeshInput body;
    std::function<double(const Vec3d&)> edge;
  };
  const std::vector<Wish> wishes{
      {box(Vec3d(0, 0, 0), Vec3d(1, 2, 1)), [](const Vec3d&) { return 0.12; }},
      {box(Vec3d(0, 0, 0), Vec3d(1, 2, 1)), [](const Vec3d& p) { return 0.05 + 0.25 * (1.0 - p.z()); }},
      {box(Vec3d(0, 0, 0), Vec3d(1, 1, 1)),
          [](const Vec3d& p) { return 0.01 + 0.2 * (p - Vec3d(0.5, 0.5, 1.0)).norm(); }},
      {notched_finger(8), [](const Vec3d& p) { return 0.1 + 0.1 * std::abs(p.y() - 1.5); }},
  };
  for (const Wish& wish : wishes) {
    MeshInput body = wish.body;
    body.edge = wish.edge;
    const LinearTets mesh = mesher.fill(body);
    const std::vector<double> ratios = relative_lengths(mesh, wish.edge);
    double mean = 0.0;
    for (double ratio : ratios) mean += ratio / static_cast<double>(ratios.size());
    INFO(mesh.tets.size() << " tetrahedra");
    CHECK(mean > 0.8);
    CHECK(mean < 1.15);
    CHECK(quantile(ratios, 0.05) > 0.45);
    CHECK(quantile(ratios, 0.95) < 1.5);
    CHECK(quantile(ratios, 1.0) < 2.6);
    double ideal = 0.0;  // number of regular tetrahedra of the wanted size that would fill the body
    for (const auto& t : mesh.tets) {
      const double edge = wish.edge(0.25 * (at(mesh, t[0]) + at(mesh, t[1]) + at(mesh, t[2]) + at(mesh, t[3])));
      ideal += volume(mesh, t) * 6.0 * std::numbers::sqrt2 / (edge * edge * edge);
    }
    CHECK(static_cast<double>(mesh.tets.size()) < 2.2 * ideal);
    const std::vector<double> angles = smallest_dihedrals(mesh);
    CHECK(quantile(angles, 0.0) > 8.0);
    CHECK(quantile(angles, 0.05) > 22.0);
  }
}

TEST_CASE("the same input gives the same bits", "[mesh][tetgen]") {
  MeshInput body = notched_finger(10);
  body.edge = [](const Vec3d& p) { return 0.1 + 0.05 * std::abs(p.x()); };
  const TetgenMesher used, fresh;
  used.fill(sphere(1));
  mesher_laws::check_same_bits(used, used, body);
  mesher_laws::check_same_bits(used, fresh, body);
}

TEST_CASE("bad surfaces give typed errors and leave nothing behind", "[mesh][tetgen]") {
  const TetgenMesher mesher{.time_limit_s = 2.0};
  mesher.fill(sphere(0));  // the helper has set itself up by now
  const std::size_t files = open_files();
  const std::size_t helper_files = open_files(mesher.helper->pid());
  const std::set<int> before = children();
  for (const auto& [fault, name] : all_faults) {
    int accepted = 0;
    for (std::uint64_t seed = 0; seed < 60; ++seed) accepted += !verdict(mesher, faulty(fault, seed));
    INFO(name);
    CHECK(accepted == 0);
  }
  CHECK(open_files() == files);
  CHECK(open_files(mesher.helper->pid()) == helper_files);
  CHECK((children() == before));
  CHECK(!verdict(mesher, sphere(1)));
}

TEST_CASE("TetGen may be given anything: its process dies alone", "[mesh][tetgen]") {
  ForkServer server(lumo::tetgen_job);
  server.run({}, {1.0, 0});  // it has set itself up by now
  const std::size_t files = open_files();
  const std::size_t helper_files = open_files(server.pid());
  const int pid = server.pid();
  std::map<JobOutcome, int> outcomes;
  for (const auto& [fault, name] : all_faults)
    for (std::uint64_t seed = 0; seed < 6; ++seed) {
      const MeshInput input = faulty(fault, seed);
      lumo::TetgenRequest request;
      request.knobs = {1.3, 14.0, 0.8, 140.0, 0, 0};
      for (const Vec3d& v : input.vertices)
        request.coordinates.insert(request.coordinates.end(), {v.x(), v.y(), v.z()});
      for (const auto& facet : input.facets) {
        request.counts.push_back(static_cast<int>(facet.loop.size()));
        request.corners.insert(request.corners.end(), facet.loop.begin(), facet.loop.end());
        request.markers.push_back(1);
      }
      ++outcomes[server.run(lumo::encode(request), {0.3, std::uint64_t{1} << 30}).outcome];
    }
  CHECK(outcomes[JobOutcome::crashed] > 0);
  const JobBytes nonsense(1000, '\x7f');
  CHECK(server.run(nonsense, {1.0, 0}).outcome == JobOutcome::crashed);
  CHECK(server.run({}, {1.0, 0}).outcome == JobOutcome::crashed);
  CHECK(server.pid() == pid);  // the helper has lived through it all
  CHECK(open_files() == files);
  CHECK(open_files(pid) == helper_files);
}

TEST_CASE("crashes, hangs and lack of memory are reported each as what it is", "[mesh][tetgen]") {
  const MeshInput body = box(Vec3d(0, 0, 0), Vec3d(1, 1, 1));
  const auto reason = [&](ForkServer::Work work, double time_limit_s = 60.0) {
    TetgenMesher mesher = with(work);
    mesher.time_limit_s = time_limit_s;
    mesher.memory_limit_bytes = std::size_t{64} << 20;
    return verdict(mesher, body);
  };
  CHECK(reason(do_abort) == Reason::crashed);
  CHECK(reason(do_segfault) == Reason::crashed);
  CHECK(reason(do_throw) == Reason::crashed);
  CHECK(reason(do_exit) == Reason::crashed);
  CHECK(reason(do_print) == Reason::crashed);  // an answer that is none
  CHECK(reason(do_loop, 0.2) == Reason::timed_out);
  CHECK(reason(do_sleep, 0.2) == Reason::timed_out);
  if (!sanitized) {
    CHECK(reason(do_allocate) == Reason::out_of_memory);
    CHECK(reason(do_careless_allocate) == Reason::out_of_memory);
  }
  TetgenMesher hasty{.time_limit_s = 0.001};
  MeshInput fine = body;
  fine.edge = [](const Vec3d&) { return 0.03; };
  CHECK(seconds_of([&] { CHECK(verdict(hasty, fine) == Reason::timed_out); }) < 5.0);
  hasty.time_limit_s = 60.0;
  if (!sanitized) {
    for (const std::size_t megabytes : {1u, 4u, 16u, 32u}) {
      hasty.memory_limit_bytes = megabytes << 20;
      CHECK(verdict(hasty, fine) == Reason::out_of_memory);
    }
  }
  hasty.memory_limit_bytes = std::size_t{2} << 30;
  CHECK(!verdict(hasty, body));
}

TEST_CASE("knobs out of range are refused", "[mesh][tetgen]") {
  const MeshInput body = sphere(0);
  CHECK_THROWS_AS(TetgenMesher{.time_limit_s = 0.0}.fill(body), lumo::InvalidArgument);
  CHECK_THROWS_AS(TetgenMesher{.time_limit_s = std::nan("")}.fill(body), lumo::InvalidArgument);
  for (const double ratio : {0.5, 1.19, 101.0})
    CHECK_THROWS_AS(TetgenMesher{.radius_edge_ratio = ratio}.fill(body), lumo::InvalidArgument);
  for (const double angle : {-1.0, 18.1})
    CHECK_THROWS_AS(TetgenMesher{.min_dihedral_deg = angle}.fill(body), lumo::InvalidArgument);
  for (const double ratio : {1.2, 100.0}) CHECK(!verdict(TetgenMesher{.radius_edge_ratio = ratio}, body));
  for (const double angle : {0.0, 18.0}) CHECK(!verdict(TetgenMesher{.min_dihedral_deg = angle}, body));
  CHECK_THROWS_AS(TetgenMesher{.size_factor = 0.0}.fill(body), lumo::InvalidArgument);
  MeshInput wish = body;
  for (const double length : {0.0, -1.0, std::nan(""), HUGE_VAL}) {
    wish.edge = [length](const Vec3d&) { return length; };
    CHECK(verdict(TetgenMesher{}, wish) == Reason::not_finite);
  }
  wish.edge = [](const Vec3d&) -> double { throw std::domain_error("no wish here"); };
  CHECK_THROWS_AS(TetgenMesher{}.fill(wish), std::domain_error);
}

TEST_CASE("a dead helper is replaced", "[mesh][tetgen]") {
  const std::size_t files = open_files();
  const std::set<int> before = children();
  {
    ForkServer server(echo);
    const JobBytes word{'w', 'o', 'r', 'd'};
    const int first = server.pid();
    ::kill(first, SIGKILL);  // while idle
    const auto result = server.run(word, {1.0, 0});
    CHECK((result.outcome == JobOutcome::done || result.outcome == JobOutcome::lost));
    CHECK(server.pid() != first);
    CHECK((server.run(word, {1.0, 0}).data == word));

    ForkServer sleeper(do_sleep);
    const int busy = sleeper.pid();
    std::thread killer([busy] {
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
      ::kill(busy, SIGKILL);
    });
    CHECK(sleeper.run(word, {30.0, 0}).outcome == JobOutcome::lost);
    killer.join();
    CHECK(sleeper.pid() != busy);

    const int stopped = server.pid();  // a helper that does not answer
    ::kill(stopped, SIGSTOP);
    CHECK(server.run(word, {0.1, 0}).outcome == JobOutcome::timed_out);
    CHECK((server.run(word, {1.0, 0}).data == word));
  }
  CHECK(open_files() == files);
  CHECK((children() == before));
}

TEST_CASE("signals to the whole process group leave the helper to its host", "[mesh][tetgen]") {
  ForkServer server(echo);
  const int helper = server.pid();
  const JobBytes word{'w', 'o', 'r', 'd'};
  CHECK((server.run(word, {5.0, 0}).data == word));  // it is up
  for (const int signal : {SIGHUP, SIGTERM, SIGINT}) {
    ::kill(helper, signal);
    CHECK((server.run(word, {5.0, 0}).data == word));
    CHECK(server.pid() == helper);
  }
}

TEST_CASE("a helper that is lost in the middle of a job does not change the mesh", "[mesh][tetgen]") {
  const MeshInput body = sphere(2);
  const LinearTets whole = TetgenMesher{}.fill(body), again = with(loses_helper_once).fill(body);
  CHECK(jobs_begun() == 2);  // jobs: one that took the helper with it, one more
  CHECK((again.vertices == whole.vertices));
  CHECK((again.tets == whole.tets));
  CHECK(verdict(with(loses_helper), body) == Reason::out_of_memory);
}

TEST_CASE("large messages pass, helpers come and go without trace", "[mesh][tetgen]") {
  const std::size_t files = open_files();
  const std::set<int> before = children();
  {
    ForkServer server(echo);
    JobBytes large(20'000'003);
    for (std::size_t i = 0; i < large.size(); ++i) large[i] = static_cast<char>(i * 2654435761u >> 13);
    CHECK((server.run(large, {20.0, 0}).data == large));
    CHECK((server.run({}, {20.0, 0}).data == JobBytes{}));
  }
  for (int i = 0; i < 50; ++i) {
    const TetgenMesher mesher;
    const TetgenMesher copy = mesher;
  }
  CHECK(open_files() == files);
  CHECK((children() == before));
}

TEST_CASE("a forked host gets a helper of its own", "[mesh][tetgen]") {
  const TetgenMesher mesher;
  const MeshInput body = sphere(1);
  const std::size_t count = mesher.fill(body).tets.size();
  const int pid = ::fork();
  REQUIRE(pid >= 0);
  if (pid == 0) {
    int code = 1;
    try {
      code = mesher.fill(body).tets.size() == count ? 0 : 2;
    } catch (...) {
    }
    ::_exit(code);
  }
  CHECK(mesher.fill(body).tets.size() == count);
  int status = -1;
  ::waitpid(pid, &status, 0);
  CHECK(status == 0);
  CHECK(mesher.fill(body).tets.size() == count);
}

TEST_CASE("meshing works while other threads allocate, and from several threads", "[mesh][tetgen]") {
  const TetgenMesher mesher, early;
  const MeshInput body = notched_finger(10);
  const std::vector<std::array<int, 4>> expected = mesher.fill(body).tets;
  std::atomic<bool> stop = false;
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i)
    threads.emplace_back([&] {
      while (!stop) {
        std::vector<std::vector<double>> junk;
        for (std::size_t k = 0; k < 100; ++k) junk.emplace_back(k * 37);
        std::this_thread::yield();
      }
    });
  std::atomic<int> wrong = 0;
  std::vector<std::thread> users;
  for (int i = 0; i < 3; ++i)
    users.emplace_back([&, i] {
      const TetgenMesher late =
          sanitized ? early : TetgenMesher{};  // forked while others allocate; sanitizers' allocators cannot do that
      for (int k = 0; k < 5; ++k) {
        try {
          wrong += (i == 0 ? late : mesher).fill(body).tets != expected;
          if (i == 1 && k == 2) late.helper->run({}, {0.1, 0});
        } catch (...) {
          ++wrong;
        }
      }
    });
  for (std::thread& user : users) user.join();
  stop = true;
  for (std::thread& thread : threads) thread.join();
  CHECK(wrong == 0);
}
