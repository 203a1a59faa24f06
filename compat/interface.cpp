// SPDX-License-Identifier: Apache-2.0
// The functions of rlr_audio_propagation.h.

#include <memory>
#include <string>

#include "compat/call_error.h"
#include "compat/context_registry.h"
#include "compat/interface_calls.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/files.h"

namespace compat = earshot::compat;
using compat::Context;
using compat::run_call;
using compat::run_for;
using compat::value_for;

namespace {

void check_pointer(const void* pointer, const char* name) { compat::check(pointer != nullptr, std::string(name) + " is null"); }

/// Three or four numbers of the caller; throws CallError for a null pointer.
glm::dvec3 vector_of(const float* xyz, const char* name) {
  check_pointer(xyz, name);
  return {xyz[0], xyz[1], xyz[2]};
}
glm::dquat quaternion_of(const float* wxyz) {
  check_pointer(wxyz, "the quaternion");
  return {static_cast<double>(wxyz[0]), static_cast<double>(wxyz[1]), static_cast<double>(wxyz[2]), static_cast<double>(wxyz[3])};
}

std::string path_of(const char* path) {
  check_pointer(path, "the path");
  compat::check(*path != 0, "the path is empty");
  return path;
}

/// More than any array in memory holds.
void check_count(std::size_t count) { compat::check(count <= 0xFFFFFFFFu, "more than 4 billion numbers; simplify the mesh"); }

/// Throws CallError where there is no such response.
const compat::PairResponse& response_of(const Context& context, std::size_t listener, std::size_t source) {
  const compat::PairResponse* response = context.response(listener, source);
  compat::check(response != nullptr, "there is no response of listener " + std::to_string(listener) + " to source " +
                                         std::to_string(source) + "; simulate first");
  return *response;
}

}  // namespace

extern "C" {

RLRA_Error RLRA_ContextConfigurationDefault(RLRA_ContextConfiguration* config) {
  if (config == nullptr) return RLRA_InvalidParameter;
  *config = compat::default_configuration();
  return RLRA_Success;
}

RLRA_Error RLRA_CreateContext(RLRA_Context* context, const RLRA_ContextConfiguration* config) {
  return run_call(__func__, [&] {
    check_pointer(context, "the context");
    check_pointer(config, "the configuration");
    *context = compat::add_context(std::make_shared<compat::SharedContext>(*config));
  });
}

RLRA_Error RLRA_DestroyContext(RLRA_Context context) { return compat::remove_context(context) ? RLRA_Success : RLRA_Uninitialized; }

RLRA_Error RLRA_ResetContext(RLRA_Context context, const RLRA_ContextConfiguration* config) {
  return run_for(__func__, context, [&](Context& c) {
    check_pointer(config, "the configuration");
    c.reset(*config);
  });
}

RLRA_Error RLRA_AddSource(RLRA_Context context) {
  return run_for(__func__, context, [](Context& c) { c.add_source(); });
}

RLRA_Error RLRA_ClearSources(RLRA_Context context) {
  return run_for(__func__, context, [](Context& c) { c.clear_sources(); });
}

size_t RLRA_GetSourceCount(const RLRA_Context context) {
  return value_for<size_t>(context, 0, [](const Context& c) { return c.num_sources(); });
}

RLRA_Error RLRA_SetSourcePosition(RLRA_Context context, size_t source, const float position[3]) {
  return run_for(__func__, context, [&](Context& c) { c.set_source_position(source, vector_of(position, "the position")); });
}

RLRA_Error RLRA_SetSourceRadius(RLRA_Context context, size_t source, float radius) {
  return run_for(__func__, context, [&](Context& c) { c.set_source_radius(source, static_cast<double>(radius)); });
}

RLRA_Error RLRA_AddListener(RLRA_Context context, const RLRA_ChannelLayout* layout) {
  return run_for(__func__, context, [&](Context& c) {
    check_pointer(layout, "the layout");
    c.add_listener(*layout);
  });
}

RLRA_Error RLRA_ClearListeners(RLRA_Context context) {
  return run_for(__func__, context, [](Context& c) { c.clear_listeners(); });
}

size_t RLRA_GetListenerCount(const RLRA_Context context) {
  return value_for<size_t>(context, 0, [](const Context& c) { return c.num_listeners(); });
}

RLRA_Error RLRA_SetListenerPosition(RLRA_Context context, size_t listener, const float position[3]) {
  return run_for(__func__, context, [&](Context& c) { c.set_listener_position(listener, vector_of(position, "the position")); });
}

RLRA_Error RLRA_SetListenerOrientationQuaternion(RLRA_Context context, size_t listener, const float wxyz[4]) {
  return run_for(__func__, context, [&](Context& c) { c.set_listener_orientation(listener, quaternion_of(wxyz)); });
}

RLRA_Error RLRA_SetListenerRadius(RLRA_Context context, size_t listener, float radius) {
  return run_for(__func__, context, [&](Context& c) { c.set_listener_radius(listener, static_cast<double>(radius)); });
}

RLRA_Error RLRA_SetListenerHRTF(RLRA_Context context, size_t listener, const char* sofa) {
  return run_for(__func__, context, [&](Context& c) { c.set_listener_hrtf(listener, sofa == nullptr ? "" : sofa); });
}

RLRA_Error RLRA_AddObject(RLRA_Context context) {
  return run_for(__func__, context, [](Context& c) { c.add_object(); });
}

RLRA_Error RLRA_ClearObjects(RLRA_Context context) {
  return run_for(__func__, context, [](Context& c) { c.clear_objects(); });
}

size_t RLRA_GetObjectCount(const RLRA_Context context) {
  return value_for<size_t>(context, 0, [](const Context& c) { return c.num_objects(); });
}

RLRA_Error RLRA_SetObjectPosition(RLRA_Context context, size_t object, const float position[3]) {
  return run_for(__func__, context, [&](Context& c) { c.set_object_position(object, vector_of(position, "the position")); });
}

RLRA_Error RLRA_SetObjectOrientationQuaternion(RLRA_Context context, size_t object, const float wxyz[4]) {
  return run_for(__func__, context, [&](Context& c) { c.set_object_orientation(object, quaternion_of(wxyz)); });
}

RLRA_Error RLRA_SetObjectMeshOBJ(RLRA_Context context, size_t object, const char* path, const char* category) {
  return run_for(__func__, context,
                 [&](Context& c) { c.set_object_mesh(object, compat::read_object_mesh(path_of(path), ".obj", category)); });
}

RLRA_Error RLRA_SetObjectMeshPLY(RLRA_Context context, size_t object, const char* path, const char* category) {
  return run_for(__func__, context,
                 [&](Context& c) { c.set_object_mesh(object, compat::read_object_mesh(path_of(path), ".ply", category)); });
}

RLRA_Error RLRA_SetObjectBox(RLRA_Context context, size_t object, const float min[3], const float max[3],
                             const RLRA_BoxMaterialCategories* materials) {
  return run_for(__func__, context, [&](Context& c) {
    c.set_object_mesh(object, compat::make_object_box(vector_of(min, "the minimum"), vector_of(max, "the maximum"), materials));
  });
}

RLRA_Error RLRA_AddMeshVertices(RLRA_Context context, const float* vertices, size_t vertex_count) {
  return run_for(__func__, context, [&](Context& c) {
    if (vertex_count > 0) check_pointer(vertices, "the vertices");
    check_count(vertex_count);
    c.staging().add_vertices({vertices, 3 * vertex_count});
  });
}

RLRA_Error RLRA_AddMeshIndices(RLRA_Context context, const uint32_t* indices, size_t index_count, size_t vertices_per_face,
                               const char* category) {
  return run_for(__func__, context, [&](Context& c) {
    if (index_count > 0) check_pointer(indices, "the indices");
    check_count(index_count);
    c.staging().add_faces({indices, index_count}, vertices_per_face, category);
  });
}

RLRA_Error RLRA_FinalizeObjectMesh(RLRA_Context context, size_t object) {
  return run_for(__func__, context, [&](Context& c) { c.finalize_object_mesh(object); });
}

RLRA_Error RLRA_SetMaterialDatabaseJSON(RLRA_Context context, const char* path) {
  return run_for(__func__, context, [&](Context& c) { c.set_material_database(path_of(path)); });
}

RLRA_Error RLRA_WriteSceneMeshOBJ(const RLRA_Context context, const char* path) {
  return run_for(__func__, context, [&](Context& c) { earshot::write_file_atomically(path_of(path), c.obj_text()); });
}

RLRA_Error RLRA_Simulate(RLRA_Context context) {
  return run_for(__func__, context, [](Context& c) { c.simulate(); });
}

size_t RLRA_GetIRCount(const RLRA_Context context) {
  return value_for<size_t>(context, 0, [](const Context& c) { return c.num_responses(); });
}

size_t RLRA_GetIRChannelCount(const RLRA_Context context, size_t listener, size_t source) {
  return value_for<size_t>(context, 0,
                           [&](const Context& c) { return static_cast<size_t>(response_of(c, listener, source).rir.num_channels); });
}

size_t RLRA_GetIRSampleCount(const RLRA_Context context, size_t listener, size_t source) {
  return value_for<size_t>(context, 0,
                           [&](const Context& c) { return static_cast<size_t>(response_of(c, listener, source).rir.num_samples); });
}

const float* RLRA_GetIRChannel(const RLRA_Context context, size_t listener, size_t source, size_t channel) {
  return value_for<const float*>(context, nullptr, [&](const Context& c) {
    const earshot::Rir& rir = response_of(c, listener, source).rir;
    compat::check(channel < static_cast<size_t>(rir.num_channels), "channel " + std::to_string(channel) + " does not exist");
    return rir.channel(static_cast<int>(channel)).data();
  });
}

RLRA_Error RLRA_WriteIRWave(const RLRA_Context context, size_t listener, size_t source, const char* path) {
  return run_for(__func__, context, [&](Context& c) {
    const earshot::Rir& rir = response_of(c, listener, source).rir;
    earshot::write_wav(path_of(path), rir.samples, rir.num_channels, rir.sample_rate_hz, rir.channel_mask);
  });
}

RLRA_Error RLRA_WriteIRMetrics(const RLRA_Context context, size_t listener, size_t source, const char* path) {
  return run_for(__func__, context, [&](Context& c) { earshot::write_file_atomically(path_of(path), c.metrics_text(listener, source)); });
}

float RLRA_GetIndirectRayEfficiency(const RLRA_Context context) {
  return value_for<float>(context, 0.f, [](const Context& c) { return static_cast<float>(c.ray_efficiency()); });
}

RLRA_Error RLRA_TraceRayAnyHit(const RLRA_Context context, RLRA_Ray* ray) {
  return run_for(__func__, context, [&](Context& c) {
    check_pointer(ray, "the ray");
    c.trace(*ray);
  });
}

RLRA_Error RLRA_TraceRayFirstHit(const RLRA_Context context, RLRA_Ray* ray) {
  return run_for(__func__, context, [&](Context& c) {
    check_pointer(ray, "the ray");
    c.trace(*ray);
  });
}

}  // extern "C"
