#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/optics/intersector.hpp"

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <pmmintrin.h>
#include <xmmintrin.h>
#include <Eigen/Geometry>

#include <array>
#include <limits>
#include <memory>
#include <new>
#include <type_traits>
#include <vector>

namespace lumo {

namespace detail {

struct EmbreeRelease {
  void operator()(RTCDevice d) const { rtcReleaseDevice(d); }
  void operator()(RTCScene s) const { rtcReleaseScene(s); }
};

/// Embree wants denormals flushed to zero on the calling thread; puts the caller's setting back.
class FlushDenormals {
 public:
  FlushDenormals() { _mm_setcsr(saved_ | 0x8040u); }
  ~FlushDenormals() { _mm_setcsr(saved_); }
  FlushDenormals(const FlushDenormals&) = delete;
  FlushDenormals& operator=(const FlushDenormals&) = delete;

 private:
  unsigned saved_ = _mm_getcsr();
};

}  // namespace detail

/// Ray scene of Embree: single precision, millimetres about the centre of the scene. Body and carrier faces are two
/// geometries, distinguished by masks: rays inside the body do not see the carrier.
class EmbreeScene {
 public:
  /// Throws InvalidArgument when a corner is not finite, std::bad_alloc, or Error when Embree fails otherwise.
  explicit EmbreeScene(const std::vector<SceneTriangle>& triangles) {
    Eigen::AlignedBox3d box;
    for (const SceneTriangle& t : triangles)
      for (const Vec3d& p : t.corners) {
        if (!p.allFinite()) throw InvalidArgument("optical scene: a corner is not finite");
        box.extend(p);
      }
    if (!box.isEmpty()) center_ = box.center();
    const detail::FlushDenormals flush;
    device_.reset(rtcNewDevice("threads=1"));
    if (!device_) fail("no device", rtcGetDeviceError(nullptr));
    scene_.reset(rtcNewScene(device_.get()));
    rtcSetSceneBuildQuality(scene_.get(), RTC_BUILD_QUALITY_MEDIUM);
    attach(triangles, false);
    attach(triangles, true);
    rtcCommitScene(scene_.get());
    if (const RTCError error = rtcGetDeviceError(device_.get()); error != RTC_ERROR_NONE) fail("no scene", error);
  }

  /// First triangle on the ray from `origin` [m] along the unit vector `direction`; `inside`: the ray runs in the body.
  RayHit first_hit(const Vec3d& origin, const Vec3d& direction, bool inside) const {
    const detail::FlushDenormals flush;
    const Vec3d o = 1e3 * (origin - center_);
    alignas(16) RTCRayHit r;
    r.ray.org_x = float(o.x());
    r.ray.org_y = float(o.y());
    r.ray.org_z = float(o.z());
    r.ray.dir_x = float(direction.x());
    r.ray.dir_y = float(direction.y());
    r.ray.dir_z = float(direction.z());
    r.ray.tnear = 0.0f;
    r.ray.tfar = std::numeric_limits<float>::infinity();
    r.ray.time = 0.0f;
    r.ray.mask = inside ? body_mask : body_mask | carrier_mask;
    r.ray.id = inside ? 1u : 0u;
    r.ray.flags = 0;
    r.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    r.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
#if RTC_VERSION_MAJOR >= 4
    rtcIntersect1(scene_.get(), &r);
#else
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(scene_.get(), &context, &r);
#endif
    if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
    return {1e-3 * double(r.ray.tfar), ids_[r.hit.geomID][r.hit.primID]};
  }

 private:
  static constexpr unsigned body_mask = 1u, carrier_mask = 2u;

  [[noreturn]] static void fail(const char* what, RTCError error) {
    if (error == RTC_ERROR_OUT_OF_MEMORY) throw std::bad_alloc();
    throw Error(message("Embree: ", what, ", error ", int(error)));
  }

  // Rejects faces that the ray's medium rules out. Masks are repeated here: Embree 3 can be built without them.
  static void orient(const RTCFilterFunctionNArguments* args) {
    const float along = RTCRayN_dir_x(args->ray, args->N, 0) * RTCHitN_Ng_x(args->hit, args->N, 0) +
                        RTCRayN_dir_y(args->ray, args->N, 0) * RTCHitN_Ng_y(args->hit, args->N, 0) +
                        RTCRayN_dir_z(args->ray, args->N, 0) * RTCHitN_Ng_z(args->hit, args->N, 0);
    const bool inside = RTCRayN_id(args->ray, args->N, 0) == 1u;
    if (inside ? RTCHitN_geomID(args->hit, args->N, 0) == 1u || !(along > 0.0f) : !(along < 0.0f)) args->valid[0] = 0;
  }

  void attach(const std::vector<SceneTriangle>& triangles, bool in_air_only) {
    std::vector<int>& ids = ids_[in_air_only];
    for (std::size_t i = 0; i < triangles.size(); ++i)
      if (triangles[i].in_air_only == in_air_only) ids.push_back(int(i));
    RTCGeometry geometry = rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_TRIANGLE);
    if (!ids.empty()) {
      auto* corners = static_cast<float*>(rtcSetNewGeometryBuffer(
          geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), 3 * ids.size()));
      auto* indices = static_cast<unsigned*>(rtcSetNewGeometryBuffer(
          geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(unsigned), ids.size()));
      if (corners == nullptr || indices == nullptr) {
        rtcReleaseGeometry(geometry);
        throw std::bad_alloc();
      }
      for (std::size_t i = 0; i < 3 * ids.size(); ++i) {
        const Vec3d p = 1e3 * (triangles[std::size_t(ids[i / 3])].corners[i % 3] - center_);
        for (std::size_t a = 0; a < 3; ++a) corners[3 * i + a] = float(p[Eigen::Index(a)]);
        indices[i] = unsigned(i);
      }
    }
    rtcSetGeometryMask(geometry, in_air_only ? carrier_mask : body_mask);
    rtcSetGeometryIntersectFilterFunction(geometry, &EmbreeScene::orient);
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(scene_.get(), geometry, in_air_only ? 1u : 0u);
    rtcReleaseGeometry(geometry);
  }

  std::unique_ptr<std::remove_pointer_t<RTCDevice>, detail::EmbreeRelease> device_;
  std::unique_ptr<std::remove_pointer_t<RTCScene>, detail::EmbreeRelease> scene_;
  std::array<std::vector<int>, 2> ids_;
  Vec3d center_ = Vec3d::Zero();
};

/// Embree 3 or 4 as an Intersector (Wald et al., "Embree", ACM TOG 33(4), 2014): the fast one.
struct Embree {
  EmbreeScene build(const std::vector<SceneTriangle>& triangles) const { return EmbreeScene(triangles); }
};

static_assert(RayScene<EmbreeScene> && Intersector<Embree>);

}  // namespace lumo
