#include "commands/doctor.hpp"

#include "report/chart_library.hpp"
#include "console/version.hpp"

#include <CLI/Version.hpp>
#include <Eigen/Core>

#include <dlfcn.h>
#include <sys/utsname.h>

#include <fstream>
#include <thread>
#include <vector>

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

struct Component {
  std::string name, version, licence, package, use, detail;
  bool on = false;
};

/// OpenBLAS tells about itself through functions that other BLAS libraries lack; the one in use is asked for at run time.
template <class Function>
Function* blas_function(const char* symbol) {
  return reinterpret_cast<Function*>(dlsym(RTLD_DEFAULT, symbol));
}

Component blas() {
  Component c{"BLAS", "", "BSD-3-Clause", "libopenblas-dev", "dense kernels of CHOLMOD", ""};
  if (const auto config = blas_function<char*()>("openblas_get_config")) {
    c.on = true;
    std::string text = config();
    while (!text.empty() && text.back() == ' ') text.pop_back();
    c.version = text;
    if (const auto core = blas_function<char*()>("openblas_get_corename")) c.detail = std::string("kernels for ") + core();
    if (const auto threads = blas_function<int()>("openblas_get_num_threads")) c.detail += ", threads per call: " + std::to_string(threads());
  } else if (dlsym(RTLD_DEFAULT, "dgemm_") != nullptr) {
    c.detail = "another BLAS is in use; OpenBLAS is usually many times faster than the reference one";
  }
  return c;
}

std::vector<Component> components() {
  std::vector<Component> list;
  const auto triple = [](int a, int b, int c) { return std::to_string(a) + "." + std::to_string(b) + "." + std::to_string(c); };
  list.push_back({"Eigen", triple(EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION), "MPL-2.0", "libeigen3-dev", "vectors and matrices", "", true});

  Component tetgen{"TetGen", "", "AGPL-3.0", "libtet1.5-dev", "tetrahedral meshes", ""};
#ifdef LUMO_PROGRAM_TETGEN
  tetgen.on = true, tetgen.version = LUMO_PROGRAM_TETGEN;
#endif
  list.push_back(tetgen);

  Component embree{"Embree", "", "Apache-2.0", "libembree-dev", "ray tracing", ""};
#ifdef LUMO_PROGRAM_EMBREE
  embree.on = true, embree.version = RTC_VERSION_STRING;
  if (RTCDevice device = rtcNewDevice(nullptr)) {
    const auto v = int(rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_VERSION));
    embree.version = triple(v / 10000, v / 100 % 100, v % 100);
    rtcReleaseDevice(device);
  } else {
    embree.on = false, embree.detail = "no device: error " + std::to_string(int(rtcGetDeviceError(nullptr)));
  }
#endif
  list.push_back(embree);

  Component cholmod{"CHOLMOD", "", "LGPL-2.1 / GPL-2 (supernodal)", "libsuitesparse-dev", "sparse Cholesky factors", ""};
#ifdef LUMO_PROGRAM_CHOLMOD
  cholmod.on = true;
  int v[3];
  cholmod_version(v);
  cholmod.version = triple(v[0], v[1], v[2]);
  int s[3];
  SuiteSparse_version(s);
  cholmod.detail = "SuiteSparse " + triple(s[0], s[1], s[2]);
#endif
  list.push_back(cholmod);
  list.push_back(blas());

  Component tbb{"oneTBB", "", "Apache-2.0", "libtbb-dev", "threads", ""};
#ifdef LUMO_PROGRAM_TBB
  tbb.on = true;
  const int interface = TBB_runtime_interface_version();
  tbb.version = TBB_runtime_version();
  tbb.detail = "interface " + std::to_string(interface);
#endif
  list.push_back(tbb);
  Component sqlite{"SQLite", "", "public domain", "libsqlite3-dev", "stores of campaigns and studies", ""};
  Component xxhash{"xxHash", "", "BSD-2-Clause", "libxxhash-dev", "their digests", ""};
#ifdef LUMO_PROGRAM_SQLITE
  sqlite.on = true, sqlite.version = sqlite3_libversion();
  xxhash.on = true, xxhash.version = triple(XXH_VERSION_MAJOR, XXH_VERSION_MINOR, XXH_VERSION_RELEASE);
#endif
  list.push_back(sqlite);
  list.push_back(xxhash);
  Component plotly{"plotly.js", chart_library_version(), "MIT", "python3-plotly", "charts of reports", ""};
  plotly.on = !plotly.version.empty();
  list.push_back(plotly);
  Component opencv{"OpenCV", "", "Apache-2.0", "libopencv-dev", "pictures, videos, cameras", ""};
#ifdef LUMO_PROGRAM_OPENCV
  opencv.on = true, opencv.version = LUMO_PROGRAM_OPENCV;
#endif
  list.push_back(opencv);
  Component libzip{"libzip", "", "BSD-3-Clause", "libzip-dev", "3MF files of lumo fabricate", ""};
#ifdef LUMO_PROGRAM_ZIP
  libzip.on = true, libzip.version = zip_libzip_version();
#endif
  list.push_back(libzip);
  Component lz4{"LZ4", "", "BSD-2-Clause", "liblz4-dev", "chunks of MCAP files", ""};
#ifdef LUMO_PROGRAM_LZ4
  lz4.on = true, lz4.version = LZ4_versionString();
#endif
  list.push_back(lz4);
  Component zstd{"Zstandard", "", "BSD-3-Clause / GPL-2", "libzstd-dev", "chunks of MCAP files", ""};
#ifdef LUMO_PROGRAM_ZSTD
  zstd.on = true, zstd.version = ZSTD_versionString();
#endif
  list.push_back(zstd);
  list.push_back({"CLI11", CLI11_VERSION, "BSD-3-Clause", "libcli11-dev", "this command line", "", true});
  list.push_back({"nlohmann-json", triple(NLOHMANN_JSON_VERSION_MAJOR, NLOHMANN_JSON_VERSION_MINOR, NLOHMANN_JSON_VERSION_PATCH), "MIT", "nlohmann-json3-dev", "JSON output, sessions of logs", "", true});
  return list;
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

/// Kernel, its release, and the kind of machine.
std::string system_name() {
  utsname u{};
  if (uname(&u) != 0) return "unknown";
  return std::string(u.sysname) + " " + u.release + " " + u.machine;
}

struct Feature {
  const char* name;
  bool here, used;
};

/// Vector instructions of the processor, and those that this program was compiled for.
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
  list = {{"sse4.2", __builtin_cpu_supports("sse4.2") != 0, sse42},
          {"avx", __builtin_cpu_supports("avx") != 0, avx},
          {"avx2", __builtin_cpu_supports("avx2") != 0, avx2},
          {"fma", __builtin_cpu_supports("fma") != 0, fma},
          {"avx512f", __builtin_cpu_supports("avx512f") != 0, avx512}};
#endif
  return list;
}

#ifdef NDEBUG
constexpr bool assertions = false;
#else
constexpr bool assertions = true;
#endif

}  // namespace

Json provenance() {
  Json j = {{"processor", processor()}, {"system", system_name()}, {"compiler", compiler()}};
  for (const Component& c : components())
    if (c.on && (c.name == "TetGen" || c.name == "Embree" || c.name == "CHOLMOD")) j[c.name] = c.version;
  return j;
}

std::string doctor(bool as_json) {
  const auto parts = components();
  const unsigned threads = std::thread::hardware_concurrency();
  std::vector<std::string> off;
  for (const auto& c : parts)
    if (!c.on) off.push_back(c.name + " (" + c.use + "): apt install " + c.package + ", then configure and build again");

  if (as_json) {
    Json j{{"lumo", version}, {"compiler", compiler()}, {"assertions", assertions}, {"processor", processor()}, {"threads", threads}};
    j["cpu_flags"] = Json::object();
    for (const auto& f : features()) j["cpu_flags"][f.name] = {{"available", f.here}, {"compiled_for", f.used}};
    j["components"] = Json::array();
    for (const auto& c : parts)
      j["components"].push_back({{"name", c.name},
                                 {"on", c.on},
                                 {"version", c.version.empty() ? Json(nullptr) : Json(c.version)},
                                 {"licence", c.licence},
                                 {"package", c.package},
                                 {"use", c.use},
                                 {"detail", c.detail.empty() ? Json(nullptr) : Json(c.detail)}});
    j["off"] = off;
    return j.dump(2) + "\n";
  }

  const auto padded = [](std::string s, std::size_t width) { return s.append(s.size() < width ? width - s.size() : 0, ' '); };
  std::string text = padded("lumo", 15) + version + "\n" + padded("compiler", 15) + compiler() + (assertions ? ", with assertions (slow)" : "") + "\n";
  text += padded("processor", 15) + processor() + ", " + std::to_string(threads) + " threads\n" + padded("instructions", 15);
  for (const auto& f : features())
    if (f.here) text += std::string(f.name) + (f.used ? " " : " (not used) ");
  text += "\n\n";
  for (const auto& c : parts) {
    text += (c.on ? "[on]  " : "[off] ") + padded(c.name, 15) + (c.version.empty() ? "-" : c.version);
    if (!c.detail.empty()) text += " (" + c.detail + ")";
    text += ": " + c.use + "; " + c.licence + "\n";
  }
  text += off.empty() ? "\nEverything is on.\n" : "\nOff:\n";
  for (const auto& line : off) text += "  " + line + "\n";
  return text;
}

}  // namespace lumo::program
