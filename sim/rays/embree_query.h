// SPDX-License-Identifier: Apache-2.0
#pragma once

// The two interfaces of Embree in one shape, for sim/rays alone.  Embree 3 takes flags and filter of a query in its context, Embree 4 in
// arguments beside the context.

#include <cstddef>
#include <cstring>

#include "sim/rays/embree_handles.h"

namespace earshot {

#if EARSHOT_EMBREE_MAJOR >= 4
using EmbreeContext = RTCRayQueryContext;
inline constexpr RTCSceneFlags kFilterPerQuery = RTC_SCENE_FLAG_FILTER_FUNCTION_IN_ARGUMENTS;
#else
using EmbreeContext = RTCIntersectContext;
inline constexpr RTCSceneFlags kFilterPerQuery = RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION;
#endif

/// Whether hits on this geometry go to the filter of the query; the scene needs kFilterPerQuery.
inline void allow_filter_per_query([[maybe_unused]] RTCGeometry geometry) {
#if EARSHOT_EMBREE_MAJOR >= 4
  rtcSetGeometryEnableFilterFunctionFromArguments(geometry, true);
#endif
}

/// Nearest hit of one ray.  filter: nullptr, or decides about each hit; it finds `context` by address in its arguments.
inline void intersect_one(RTCScene scene, EmbreeContext& context, RTCFilterFunctionN filter, RTCRayHit& query) {
#if EARSHOT_EMBREE_MAJOR >= 4
  rtcInitRayQueryContext(&context);
  RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  arguments.context = &context;
  arguments.filter = filter;
  rtcIntersect1(scene, &query, &arguments);
#else
  rtcInitIntersectContext(&context);
  context.filter = filter;
  rtcIntersect1(scene, &context, &query);
#endif
}

/// Whether anything blocks the ray: `tfar` is then negative.  filter: as in intersect_one.
inline void occlude_one(RTCScene scene, EmbreeContext& context, RTCFilterFunctionN filter, RTCRay& ray) {
#if EARSHOT_EMBREE_MAJOR >= 4
  rtcInitRayQueryContext(&context);
  RTCOccludedArguments arguments;
  rtcInitOccludedArguments(&arguments);
  arguments.context = &context;
  arguments.filter = filter;
  rtcOccluded1(scene, &ray, &arguments);
#else
  rtcInitIntersectContext(&context);
  context.filter = filter;
  rtcOccluded1(scene, &context, &ray);
#endif
}

#if EARSHOT_EMBREE_MAJOR >= 4
/// A packet of sixteen as two of eight.  Without AVX-512, Embree 4 traces sixteen rays one by one (Embree 3 as two packets): pictures then
/// cost 1.6 times as much.
inline void intersect_as_eights(const int* valid, RTCScene scene, RTCRayHit16& query, RTCIntersectArguments& arguments) {
  constexpr std::size_t kLaneBytes = 4, kFields = sizeof(RTCRayHit8) / (8 * kLaneBytes);
  static_assert(sizeof(RTCRayHit16) == kFields * 16 * kLaneBytes);
  auto* all = reinterpret_cast<std::byte*>(&query);
  for (std::size_t half = 0; half < 2; ++half, valid += 8, all += 8 * kLaneBytes) {
    RTCRayHit8 eight;
    auto* lanes = reinterpret_cast<std::byte*>(&eight);
    for (std::size_t field = 0; field < kFields; ++field)
      std::memcpy(lanes + field * 8 * kLaneBytes, all + field * 16 * kLaneBytes, 8 * kLaneBytes);
    rtcIntersect8(valid, scene, &eight, &arguments);
    for (std::size_t field = 0; field < kFields; ++field)
      std::memcpy(all + field * 16 * kLaneBytes, lanes + field * 8 * kLaneBytes, 8 * kLaneBytes);
  }
}
#endif

/// Nearest hits of a packet of coherent rays, without a filter.  valid: -1 for a ray that is traced, 0 for one that is not; aligned as the
/// packet is.
template <class Packet>
void intersect_coherent(const int* valid, RTCScene scene, Packet& query) {
  static_assert(std::is_same_v<Packet, RTCRayHit8> || std::is_same_v<Packet, RTCRayHit16>);
#if EARSHOT_EMBREE_MAJOR >= 4
  EmbreeContext context;
  rtcInitRayQueryContext(&context);
  RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
  arguments.context = &context;
  if constexpr (std::is_same_v<Packet, RTCRayHit8>) {
    rtcIntersect8(valid, scene, &query, &arguments);
  } else {
    intersect_as_eights(valid, scene, query, arguments);
  }
#else
  EmbreeContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  if constexpr (std::is_same_v<Packet, RTCRayHit8>) {
    rtcIntersect8(valid, scene, &context, &query);
  } else {
    rtcIntersect16(valid, scene, &context, &query);
  }
#endif
}

}  // namespace earshot
