#include "computing/provenance.hpp"

#include "report/chart_library.hpp"

#include <CLI/Version.hpp>
#include <Eigen/Core>

#include <dlfcn.h>
#include <sys/utsname.h>

#include <algorithm>
#include <fstream>
#include <string_view>

#ifdef LUMO_PROGRAM_EMBREE
#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif
#endif
#ifdef LUMO_PROGRAM_CHOLMOD
#include <cholmod.h>
#endif
#ifdef LUMO_PROGRAM_TBB
#include <tbb/version.h>
#endif
#ifdef LUMO_PROGRAM_SQLITE
#include <sqlite3.h>
#include <xxhash.h>
#endif
#ifdef LUMO_PROGRAM_POSTGRES
#if __has_include(<postgresql/libpq-fe.h>)
#include <postgresql/libpq-fe.h>
#else
#include <libpq-fe.h>
#endif
#endif
#ifdef LUMO_PROGRAM_ZIP
#include <zip.h>
#endif
#ifdef LUMO_PROGRAM_LZ4
#include <lz4.h>
#endif
#ifdef LUMO_PROGRAM_ZSTD
#include <zstd.h>
#endif

namespace lumo::program {

namespace {

/// OpenBLAS reports on itself through functions that other BLAS libraries lack; the one in use is asked for at run
/// time.
template <class Function> Function* blas_function(const char* symbol) {
  return reinterpret_cast<Function*>(dlsym(RTLD_DEFAULT, symbol));
}

std::string dotted(int a, int b, int c) {
  return std::to_string(a) + "." + std::to_string(b) + "." + std::to_string(c);
}

/// Components by name, which are off until they are found.
class Findings {
 public:
  explicit Findings(std::vector<Component> all) : all_(std::move(all)) {}
  void found(std::string_view name, const std::string& version, const std::string& detail = "") {
    Component& c = at(name);
    c.on = true;
    c.version = version;
    c.detail = detail;
  }
  void lacks(std::string_view name, const std::string& why) { at(name).detail = why; }
  std::vector<Component> all() { return std::move(all_); }

 private:
  Component& at(std::string_view name) {
    return *std::find_if(all_.begin(), all_.end(), [&](const Component& c) { return c.name == name; });
  }
  std::vector<Component> all_;
};

/// Kernel, its release, and the kind of machine.
std::string system_name() {
  utsname u{};
  if (uname(&u) != 0) return "unknown";
  return std::string(u.sysname) + " " + u.release + " " + u.machine;
}

void find_blas(Findings& list) {
  if (const auto config = blas_function<char*()>("openblas_get_config")) {
    std::string version = config(), detail;
    while (!version.empty() && version.back() == ' ') version.pop_back();
    if (const auto core = blas_function<char*()>("openblas_get_corename"))
      detail = std::string("kernels for ") + core();
    if (const auto threads = blas_function<int()>("openblas_get_num_threads"))
      detail += ", threads per call: " + std::to_string(threads());
    list.found("BLAS", version, detail);
  } else if (dlsym(RTLD_DEFAULT, "dgemm_") != nullptr) {
    list.lacks("BLAS", "another BLAS is in use; OpenBLAS is usually many times faster than the reference one");
  }
}

void find_engines([[maybe_unused]] Findings& list) {
#ifdef LUMO_PROGRAM_TETGEN
  list.found("TetGen", LUMO_PROGRAM_TETGEN);
#endif
#ifdef LUMO_PROGRAM_EMBREE
  if (RTCDevice device = rtcNewDevice(nullptr)) {
    const auto v = int(rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_VERSION));
    list.found("Embree", dotted(v / 10000, v / 100 % 100, v % 100));
    rtcReleaseDevice(device);
  } else {
    list.lacks("Embree", "no device: error " + std::to_string(int(rtcGetDeviceError(nullptr))));
  }
#endif
#ifdef LUMO_PROGRAM_CHOLMOD
  int v[3], s[3];
  cholmod_version(v);
  SuiteSparse_version(s);
  list.found("CHOLMOD", dotted(v[0], v[1], v[2]), "SuiteSparse " + dotted(s[0], s[1], s[2]));
#endif
#ifdef LUMO_PROGRAM_TBB
  list.found("oneTBB", TBB_runtime_version(), "interface " + std::to_string(TBB_runtime_interface_version()));
#endif
}

void find_formats(Findings& list) {
#ifdef LUMO_PROGRAM_SQLITE
  list.found("SQLite", sqlite3_libversion());
  list.found("xxHash", dotted(XXH_VERSION_MAJOR, XXH_VERSION_MINOR, XXH_VERSION_RELEASE));
#endif
#ifdef LUMO_PROGRAM_POSTGRES
  const int libpq = PQlibVersion();
  list.found("libpq", std::to_string(libpq / 10000) + "." + std::to_string(libpq % 10000));
#endif
#ifdef LUMO_PROGRAM_OPENCV
  list.found("OpenCV", LUMO_PROGRAM_OPENCV);
#endif
#ifdef LUMO_PROGRAM_ZIP
  list.found("libzip", zip_libzip_version());
#endif
#ifdef LUMO_PROGRAM_LZ4
  list.found("LZ4", LZ4_versionString());
#endif
#ifdef LUMO_PROGRAM_ZSTD
  list.found("Zstandard", ZSTD_versionString());
#endif
  if (const std::string version = chart_library_version(); !version.empty()) list.found("plotly.js", version);
  list.found("CLI11", CLI11_VERSION);
  list.found(
      "nlohmann-json", dotted(NLOHMANN_JSON_VERSION_MAJOR, NLOHMANN_JSON_VERSION_MINOR, NLOHMANN_JSON_VERSION_PATCH));
}

}  // namespace

std::vector<Component> components() {
  Findings list({{"Eigen", "MPL-2.0", "libeigen3-dev", "vectors and matrices"},
      {"TetGen", "AGPL-3.0", "libtet1.5-dev", "tetrahedral meshes"},
      {"Embree", "Apache-2.0", "libembree-dev", "ray tracing"},
      {"CHOLMOD", "LGPL-2.1 / GPL-2 (supernodal)", "libsuitesparse-dev", "sparse Cholesky factors"},
      {"BLAS", "BSD-3-Clause", "libopenblas-dev", "dense kernels of CHOLMOD"},
      {"oneTBB", "Apache-2.0", "libtbb-dev", "threads"},
      {"SQLite", "public domain", "libsqlite3-dev", "stores of campaigns and studies"},
      {"xxHash", "BSD-2-Clause", "libxxhash-dev", "their digests"},
      {"libpq", "PostgreSQL", "libpq-dev", "stores that many machines share"},
      {"plotly.js", "MIT", "python3-plotly", "charts of reports"},
      {"OpenCV", "Apache-2.0", "libopencv-dev", "pictures, videos, cameras"},
      {"libzip", "BSD-3-Clause", "libzip-dev", "3MF files of lumo fabricate"},
      {"LZ4", "BSD-2-Clause", "liblz4-dev", "chunks of MCAP files"},
      {"Zstandard", "BSD-3-Clause / GPL-2", "libzstd-dev", "chunks of MCAP files"},
      {"CLI11", "BSD-3-Clause", "libcli11-dev", "this command line"},
      {"nlohmann-json", "MIT", "nlohmann-json3-dev", "JSON output, sessions of logs"}});
  list.found("Eigen", dotted(EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION));
  find_blas(list);
  find_engines(list);
  find_formats(list);
  return list.all();
}

std::string compiler() {
#if defined(__clang__)
  return "clang " __clang_version__;
#else
  return "g++ " __VERSION__;
#endif
}

std::string processor() {
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);)
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  return "unknown";
}

std::vector<Feature> features() {
  std::vector<Feature> list;
#if defined(__x86_64__)
  __builtin_cpu_init();
  bool avx = false, avx2 = false, fma = false, avx512 = false, sse42 = false;
#ifdef __SSE4_2__
  sse42 = true;
#endif
#ifdef __AVX__
  avx = true;
#endif
#ifdef __AVX2__
  avx2 = true;
#endif
#ifdef __FMA__
  fma = true;
#endif
#ifdef __AVX512F__
  avx512 = true;
#endif
  list = {{"sse4.2", __builtin_cpu_supports("sse4.2") != 0, sse42}, {"avx", __builtin_cpu_supports("avx") != 0, avx},
      {"avx2", __builtin_cpu_supports("avx2") != 0, avx2}, {"fma", __builtin_cpu_supports("fma") != 0, fma},
      {"avx512f", __builtin_cpu_supports("avx512f") != 0, avx512}};
#endif
  return list;
}

Json provenance() {
  Json j = {{"processor", processor()}, {"system", system_name()}, {"compiler", compiler()}};
  for (const Component& c : components())
    if (c.on && (c.name == "TetGen" || c.name == "Embree" || c.name == "CHOLMOD")) j[c.name] = c.version;
  return j;
}

}  // namespace lumo::program
