/* SPDX-License-Identifier: Apache-2.0 */
#pragma once

/// @file
/// The C interface of libRLRAudioPropagation.so, a library of Earshot that takes the place of the engine of SoundSpaces 2.0.  Names,
/// layouts and codes are those of that engine, so that a program which was compiled for it runs with this library.  Written for C and C++.
///
/// Axes: right-handed, y up, -z in front.  Positions are in units of the caller: one is unitScale metres.  Quaternions are w, x, y, z and
/// turn local axes to those of the world; their length is of no account, but must not be zero.
///
/// Errors: a function returns RLRA_Success or a code, and leaves the context as it was.  A line on stderr says what is wrong and what to
/// do, each line once.  An index that is out of range, a null pointer where none is allowed and a number that is not finite are
/// RLRA_InvalidParameter; a handle that is null, destroyed or was never given out is RLRA_Uninitialized.  Functions that return a count, a
/// number or a pointer return 0 in these cases.  No exception leaves a function.
///
/// Threads: any thread may call for any context; calls for one context wait for each other.
///
/// Environment, read by RLRA_CreateContext and RLRA_ResetContext: EARSHOT_SEED, a whole number, seeds rays and noise (default 0); the same
/// seed gives the same bits.  EARSHOT_PRESET, one of fast, balanced and high, takes the place of the caller's settings of quality.

#include <stddef.h>
#include <stdint.h>

#define RLRA_EXPORT __attribute__((visibility("default")))

#ifdef __cplusplus
extern "C" {
#endif

typedef uint8_t RLR_Bool;  ///< 0 or 1
/// A handle; no address.
typedef struct RLRA_ContextHandle* RLRA_Context;

typedef enum RLRA_Error {
  RLRA_Success = 0,
  RLRA_UnknownError = 2000,
  RLRA_InvalidParameter = 2001,
  RLRA_InvalidSampleRate = 2002,  ///< outside [8000, 96000] Hz
  RLRA_MissingLibrary = 2003,     ///< never returned
  RLRA_NotAligned = 2004,         ///< never returned: no alignment is asked for
  RLRA_Uninitialized = 2005,
  RLRA_OutOfMemory = 2018,
  RLRA_Unsupported = 2019
} RLRA_Error;

typedef enum RLRA_ChannelLayoutType {
  RLRA_Layout_Unknown = 0,
  RLRA_Layout_Mono = 1,
  RLRA_Layout_Stereo = 2,
  RLRA_Layout_Binaural = 3,
  RLRA_Layout_Quad = 4,
  RLRA_Layout_Surround51 = 5,
  RLRA_Layout_Surround71 = 6,
  RLRA_Layout_Ambisonics = 7
} RLRA_ChannelLayoutType;

#pragma pack(push, 1)

/// docs/reference/rlr_library.md says what each field does here.
typedef struct RLRA_ContextConfiguration {
  size_t thisSize;  ///< sizeof(RLRA_ContextConfiguration); another value is an error
  size_t frequencyBands;
  size_t directSHOrder, indirectSHOrder;
  size_t directRayCount, indirectRayCount, indirectRayDepth;
  size_t sourceRayCount, sourceRayDepth;
  size_t maxDiffractionOrder;
  size_t threadCount;
  float sampleRate;   ///< Hz, [8000, 96000]
  float maxIRLength;  ///< s, (0, 60]
  float unitScale;    ///< metres per unit, [1e-6, 1e6]
  float globalVolume;
  float hrtfRight[3], hrtfUp[3], hrtfBack[3];  ///< orthogonal, of any length, right-handed
  RLR_Bool direct, indirect, diffraction, transmission;
  RLR_Bool meshSimplification;
  RLR_Bool temporalCoherence;
} RLRA_ContextConfiguration;

typedef struct RLRA_ChannelLayout {
  size_t channelCount;  ///< decides for ambisonics alone: (order + 1)^2, order 0 to 9
  RLRA_ChannelLayoutType type;
} RLRA_ChannelLayout;

/// Categories of the faces of a box.  NULL: the default material.
typedef struct RLRA_BoxMaterialCategories {
  const char *xMin, *xMax, *yMin, *yMax, *zMin, *zMax;
} RLRA_BoxMaterialCategories;

/// A ray origin + t direction with tMin < t < tMax.
typedef struct RLRA_Ray {
  float origin[3], direction[3];  ///< of any length but zero
  float tMin, tMax;               ///< tMax: of the hit, once there is one
  int hit;                        ///< 0 or 1
  float normal[3];                ///< of the hit, of any length, by the order of the corners of the triangle
} RLRA_Ray;

#pragma pack(pop)

/// @name Contexts
/// @{
RLRA_EXPORT RLRA_Error RLRA_ContextConfigurationDefault(RLRA_ContextConfiguration* config);
RLRA_EXPORT RLRA_Error RLRA_CreateContext(RLRA_Context* context, const RLRA_ContextConfiguration* config);
RLRA_EXPORT RLRA_Error RLRA_DestroyContext(RLRA_Context context);
/// As a new context with this configuration: no sources, listeners, objects, materials and responses.
RLRA_EXPORT RLRA_Error RLRA_ResetContext(RLRA_Context context, const RLRA_ContextConfiguration* config);
/// @}

/// @name Sources: at the origin at first, omnidirectional
/// @{
RLRA_EXPORT RLRA_Error RLRA_AddSource(RLRA_Context context);
RLRA_EXPORT RLRA_Error RLRA_ClearSources(RLRA_Context context);
RLRA_EXPORT size_t RLRA_GetSourceCount(const RLRA_Context context);
RLRA_EXPORT RLRA_Error RLRA_SetSourcePosition(RLRA_Context context, size_t source, const float position[3]);
/// radius: 0 (a point) to 10 m.
RLRA_EXPORT RLRA_Error RLRA_SetSourceRadius(RLRA_Context context, size_t source, float radius);
/// @}

/// @name Listeners: at the origin at first, looking along -z
/// @{
RLRA_EXPORT RLRA_Error RLRA_AddListener(RLRA_Context context, const RLRA_ChannelLayout* layout);
RLRA_EXPORT RLRA_Error RLRA_ClearListeners(RLRA_Context context);
RLRA_EXPORT size_t RLRA_GetListenerCount(const RLRA_Context context);
RLRA_EXPORT RLRA_Error RLRA_SetListenerPosition(RLRA_Context context, size_t listener, const float position[3]);
RLRA_EXPORT RLRA_Error RLRA_SetListenerOrientationQuaternion(RLRA_Context context, size_t listener, const float wxyz[4]);
/// Checked, and without effect: listeners are points.
RLRA_EXPORT RLRA_Error RLRA_SetListenerRadius(RLRA_Context context, size_t listener, float radius);
/// sofa: a SOFA file with two receivers; NULL or empty: a rigid sphere.  RLRA_Unsupported for a listener that is not binaural.
RLRA_EXPORT RLRA_Error RLRA_SetListenerHRTF(RLRA_Context context, size_t listener, const char* sofa);
/// @}

/// @name Objects: rigid, at the origin and without geometry at first
/// @{
RLRA_EXPORT RLRA_Error RLRA_AddObject(RLRA_Context context);
RLRA_EXPORT RLRA_Error RLRA_ClearObjects(RLRA_Context context);
RLRA_EXPORT size_t RLRA_GetObjectCount(const RLRA_Context context);
RLRA_EXPORT RLRA_Error RLRA_SetObjectPosition(RLRA_Context context, size_t object, const float position[3]);
RLRA_EXPORT RLRA_Error RLRA_SetObjectOrientationQuaternion(RLRA_Context context, size_t object, const float wxyz[4]);
/// category: of all surfaces; NULL, empty or unknown: the default material.
RLRA_EXPORT RLRA_Error RLRA_SetObjectMeshOBJ(RLRA_Context context, size_t object, const char* path, const char* category);
RLRA_EXPORT RLRA_Error RLRA_SetObjectMeshPLY(RLRA_Context context, size_t object, const char* path, const char* category);
/// min below max on each axis.  materials: NULL for the default material everywhere.
RLRA_EXPORT RLRA_Error RLRA_SetObjectBox(RLRA_Context context, size_t object, const float min[3], const float max[3],
                                         const RLRA_BoxMaterialCategories* materials);
/// Adds vertices to the mesh that is being built: x, y, z of each.
RLRA_EXPORT RLRA_Error RLRA_AddMeshVertices(RLRA_Context context, const float* vertices, size_t vertex_count);
/// Adds faces of one category to it.  Indices count all vertices added since the last RLRA_FinalizeObjectMesh.  vertices_per_face: 3 or 4;
/// indices beyond a whole number of faces are left out.
RLRA_EXPORT RLRA_Error RLRA_AddMeshIndices(RLRA_Context context, const uint32_t* indices, size_t index_count, size_t vertices_per_face,
                                           const char* category);
/// Makes it the geometry of an object.  The next mesh begins, also where an index is out of range (RLRA_InvalidParameter).
RLRA_EXPORT RLRA_Error RLRA_FinalizeObjectMesh(RLRA_Context context, size_t object);
/// @}

/// @name Materials and geometry
/// @{
/// A database of materials (docs/reference/formats.md, section 2), at any time: it holds from the next RLRA_Simulate on.
RLRA_EXPORT RLRA_Error RLRA_SetMaterialDatabaseJSON(RLRA_Context context, const char* path);
/// All objects in their places, in metres, as an OBJ file: an object for each object, a material name for each category, a colour for each
/// category.  `earshot rir` with this file gives the bits of RLRA_Simulate (docs/reference/rlr_library.md).
RLRA_EXPORT RLRA_Error RLRA_WriteSceneMeshOBJ(const RLRA_Context context, const char* path);
/// @}

/// @name Responses: of all listeners and all sources
/// @{
/// Takes the place of the responses before; where it fails, there are none.
RLRA_EXPORT RLRA_Error RLRA_Simulate(RLRA_Context context);
RLRA_EXPORT size_t RLRA_GetIRCount(const RLRA_Context context);
RLRA_EXPORT size_t RLRA_GetIRChannelCount(const RLRA_Context context, size_t listener, size_t source);
RLRA_EXPORT size_t RLRA_GetIRSampleCount(const RLRA_Context context, size_t listener, size_t source);
/// Pressure: a unit source in the open has globalVolume / (4 pi r) at r metres.  Sample n is n / sampleRate after emission.  Valid until
/// the next RLRA_Simulate, RLRA_ResetContext or RLRA_DestroyContext of this context.
RLRA_EXPORT const float* RLRA_GetIRChannel(const RLRA_Context context, size_t listener, size_t source, size_t channel);
/// 32-bit float WAV.
RLRA_EXPORT RLRA_Error RLRA_WriteIRWave(const RLRA_Context context, size_t listener, size_t source, const char* path);
/// Text: lines that begin with # and name the settings, then a table of a row per band; "nan" for a value that does not exist.
RLRA_EXPORT RLRA_Error RLRA_WriteIRMetrics(const RLRA_Context context, size_t listener, size_t source, const char* path);
/// Fraction of the segments of traced rays that meet a surface, the mean over all responses; 0 before RLRA_Simulate.
RLRA_EXPORT float RLRA_GetIndirectRayEfficiency(const RLRA_Context context);
/// @}

/// @name Rays against the objects in their places, also before RLRA_Simulate
/// @{
/// Both find the nearest hit.  Without a hit, `hit` is 0 and the rest of the ray stays as it was.
RLRA_EXPORT RLRA_Error RLRA_TraceRayAnyHit(const RLRA_Context context, RLRA_Ray* ray);
RLRA_EXPORT RLRA_Error RLRA_TraceRayFirstHit(const RLRA_Context context, RLRA_Ray* ray);
/// @}

#ifdef __cplusplus
}
#endif
