#pragma once

/// The only place that knows which Embree is installed: 4.x, or 3.13 as in Debian 12.
#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#define PHOTONFARM_EMBREE_MAJOR 4
#else
#include <embree3/rtcore.h>
#define PHOTONFARM_EMBREE_MAJOR 3
#endif

namespace pf {

/// Closest hit of one ray; filter functions of the geometries run.
inline void embree_intersect(RTCScene scene, RTCRayHit& ray_hit) {
#if PHOTONFARM_EMBREE_MAJOR == 4
  rtcIntersect1(scene, &ray_hit, nullptr);
#else
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(scene, &context, &ray_hit);
#endif
}

/// Closest hits of the rays whose `valid` is -1 (aligned to 32 bytes).
inline void embree_intersect(const int* valid, RTCScene scene, RTCRayHit8& packet, bool coherent) {
#if PHOTONFARM_EMBREE_MAJOR == 4
  RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  if (coherent) arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
  rtcIntersect8(valid, scene, &packet, &arguments);
#else
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  if (coherent) context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  rtcIntersect8(valid, scene, &context, &packet);
#endif
}

/// Sets ray.tfar to -infinity when anything is hit.
inline void embree_occluded(RTCScene scene, RTCRay& ray) {
#if PHOTONFARM_EMBREE_MAJOR == 4
  rtcOccluded1(scene, &ray, nullptr);
#else
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded1(scene, &context, &ray);
#endif
}

}  // namespace pf
