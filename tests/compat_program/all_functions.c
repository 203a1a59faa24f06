/* SPDX-License-Identifier: Apache-2.0 */
/* Calls all functions of libRLRAudioPropagation.so by declarations of its own, as a program does that was compiled for the engine that the
   library replaces.  all_functions FOLDER: writes its files there. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#pragma pack(push, 1)
struct configuration {
  size_t this_size, frequency_bands, direct_sh_order, indirect_sh_order, direct_ray_count, indirect_ray_count, indirect_ray_depth,
      source_ray_count, source_ray_depth, max_diffraction_order, thread_count;
  float sample_rate, max_ir_length, unit_scale, global_volume, hrtf_right[3], hrtf_up[3], hrtf_back[3];
  uint8_t direct, indirect, diffraction, transmission, mesh_simplification, temporal_coherence;
};
struct layout {
  size_t channel_count;
  int type;
};
struct box {
  const char *x_min, *x_max, *y_min, *y_max, *z_min, *z_max;
};
struct ray {
  float origin[3], direction[3], t_min, t_max;
  int hit;
  float normal[3];
};
#pragma pack(pop)
typedef void *context;

int RLRA_ContextConfigurationDefault(struct configuration *);
int RLRA_CreateContext(context *, const struct configuration *);
int RLRA_DestroyContext(context);
int RLRA_ResetContext(context, const struct configuration *);
int RLRA_AddSource(context);
int RLRA_ClearSources(context);
size_t RLRA_GetSourceCount(context);
int RLRA_SetSourcePosition(context, size_t, const float[3]);
int RLRA_SetSourceRadius(context, size_t, float);
int RLRA_AddListener(context, const struct layout *);
int RLRA_ClearListeners(context);
size_t RLRA_GetListenerCount(context);
int RLRA_SetListenerPosition(context, size_t, const float[3]);
int RLRA_SetListenerOrientationQuaternion(context, size_t, const float[4]);
int RLRA_SetListenerRadius(context, size_t, float);
int RLRA_SetListenerHRTF(context, size_t, const char *);
int RLRA_AddObject(context);
int RLRA_ClearObjects(context);
size_t RLRA_GetObjectCount(context);
int RLRA_SetObjectPosition(context, size_t, const float[3]);
int RLRA_SetObjectOrientationQuaternion(context, size_t, const float[4]);
int RLRA_SetObjectMeshOBJ(context, size_t, const char *, const char *);
int RLRA_SetObjectMeshPLY(context, size_t, const char *, const char *);
int RLRA_SetObjectBox(context, size_t, const float[3], const float[3], const struct box *);
int RLRA_AddMeshVertices(context, const float *, size_t);
int RLRA_AddMeshIndices(context, const uint32_t *, size_t, size_t, const char *);
int RLRA_FinalizeObjectMesh(context, size_t);
int RLRA_SetMaterialDatabaseJSON(context, const char *);
int RLRA_WriteSceneMeshOBJ(context, const char *);
int RLRA_Simulate(context);
size_t RLRA_GetIRCount(context);
size_t RLRA_GetIRChannelCount(context, size_t, size_t);
size_t RLRA_GetIRSampleCount(context, size_t, size_t);
const float *RLRA_GetIRChannel(context, size_t, size_t, size_t);
int RLRA_WriteIRWave(context, size_t, size_t, const char *);
int RLRA_WriteIRMetrics(context, size_t, size_t, const char *);
float RLRA_GetIndirectRayEfficiency(context);
int RLRA_TraceRayAnyHit(context, struct ray *);
int RLRA_TraceRayFirstHit(context, struct ray *);

static int num_faults = 0;
static void expect(int is_true, const char *what, int line) {
  if (is_true) return;
  printf("all_functions.c:%d: expected %s\n", line, what);
  ++num_faults;
}
#define EXPECT(condition) expect((condition) != 0, #condition, __LINE__)

static char text[4096];
static const char *in_folder(const char *folder, const char *name) {
  snprintf(text, sizeof text, "%s/%s", folder, name);
  return text;
}
static void write_text(const char *folder, const char *name, const char *content) {
  FILE *file = fopen(in_folder(folder, name), "w");
  if (file == NULL) {
    EXPECT(!"a file that can be written");
    return;
  }
  fputs(content, file);
  fclose(file);
}
static long size_of(const char *folder, const char *name) {
  struct stat status;
  return stat(in_folder(folder, name), &status) == 0 ? (long)status.st_size : -1;
}

static void fill_defaults(struct configuration *config) {
  memset(config, 0xFF, sizeof *config);
  EXPECT(RLRA_ContextConfigurationDefault(config) == 0);
  EXPECT(config->this_size == sizeof *config && sizeof *config == 146);
  EXPECT(config->frequency_bands == 4 && config->indirect_ray_count == 5000 && config->max_diffraction_order == 10);
  EXPECT(config->sample_rate == 44100.f && config->max_ir_length == 4.f && config->unit_scale == 1.f && config->global_volume == 1.f);
  EXPECT(config->hrtf_right[0] == 1.f && config->hrtf_up[1] == 1.f && config->hrtf_back[2] == 1.f);
  EXPECT(config->direct == 1 && config->indirect == 1 && config->transmission == 1 && config->temporal_coherence == 0);
  config->indirect_ray_count = 300;
  config->sample_rate = 16000.f;
  config->max_ir_length = 0.25f;
}

/* A room of a box, a table of vertices and indices, a post of an OBJ file and a sign of a PLY file. */
static void add_objects(context c, const char *folder) {
  const float low[3] = {0, 0, 0}, high[3] = {6, 3, 4}, at[3] = {4, 0, 1}, turned[4] = {0.8f, 0, 0.6f, 0};
  const struct box walls = {"wall", "wall", "floor", NULL, "wall", "unknown"};
  const float table[12] = {2, 0.7f, 1, 3, 0.7f, 1, 3, 0.7f, 2, 2, 0.7f, 2};
  const uint32_t quad[4] = {0, 1, 2, 3}, triangles[6] = {0, 1, 2, 0, 2, 3};
  write_text(folder, "post.obj", "v 0 0 0\nv 0.2 0 0\nv 0.2 2 0\nv 0 2 0\nf 1 2 3 4\n");
  write_text(folder, "sign.ply",
             "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
             "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
  write_text(folder, "materials.json",
             "{\"materials\": [{\"name\": \"plain\", \"labels\": [\"default\"], \"absorption\": [125, 0.2], \"scattering\": [125, 0.3]},"
             "{\"name\": \"soft\", \"labels\": [\"floor\"], \"absorption\": [125, 0.5], \"scattering\": [125, 0.3]}]}");
  EXPECT(RLRA_SetMaterialDatabaseJSON(c, in_folder(folder, "materials.json")) == 0);
  for (int i = 0; i < 4; ++i) EXPECT(RLRA_AddObject(c) == 0);
  EXPECT(RLRA_GetObjectCount(c) == 4);
  EXPECT(RLRA_SetObjectBox(c, 0, low, high, &walls) == 0);
  EXPECT(RLRA_AddMeshVertices(c, table, 4) == 0);
  EXPECT(RLRA_AddMeshIndices(c, quad, 4, 4, "table") == 0);
  EXPECT(RLRA_FinalizeObjectMesh(c, 1) == 0);
  EXPECT(RLRA_AddMeshVertices(c, table, 4) == 0);
  EXPECT(RLRA_AddMeshIndices(c, triangles, 6, 3, "table") == 0);
  EXPECT(RLRA_FinalizeObjectMesh(c, 1) == 0);
  EXPECT(RLRA_SetObjectMeshOBJ(c, 2, in_folder(folder, "post.obj"), "post") == 0);
  EXPECT(RLRA_SetObjectPosition(c, 2, at) == 0);
  EXPECT(RLRA_SetObjectOrientationQuaternion(c, 2, turned) == 0);
  EXPECT(RLRA_SetObjectMeshPLY(c, 3, in_folder(folder, "sign.ply"), NULL) == 0);
  EXPECT(RLRA_SetObjectPosition(c, 3, at) == 0);
  EXPECT(RLRA_SetObjectPosition(c, 4, at) == 2001);
}

static void add_places(context c) {
  const float first[3] = {1, 1, 1}, second[3] = {5, 2, 3}, ears[3] = {3, 1.5f, 2}, left[4] = {0.70710678f, 0, 0.70710678f, 0};
  const struct layout binaural = {2, 3}, ambisonics = {4, 7};
  EXPECT(RLRA_AddSource(c) == 0 && RLRA_AddSource(c) == 0 && RLRA_GetSourceCount(c) == 2);
  EXPECT(RLRA_SetSourcePosition(c, 0, first) == 0 && RLRA_SetSourcePosition(c, 1, second) == 0);
  EXPECT(RLRA_SetSourceRadius(c, 1, 0.2f) == 0 && RLRA_SetSourceRadius(c, 1, -1.f) == 2001);
  EXPECT(RLRA_AddListener(c, &binaural) == 0 && RLRA_AddListener(c, &ambisonics) == 0 && RLRA_GetListenerCount(c) == 2);
  EXPECT(RLRA_SetListenerPosition(c, 0, ears) == 0 && RLRA_SetListenerPosition(c, 1, ears) == 0);
  EXPECT(RLRA_SetListenerOrientationQuaternion(c, 0, left) == 0);
  EXPECT(RLRA_SetListenerRadius(c, 0, 0.1f) == 0);
  EXPECT(RLRA_SetListenerHRTF(c, 0, NULL) == 0);
}

static void check_responses(context c, const char *folder) {
  EXPECT(RLRA_GetIRCount(c) == 0 && RLRA_GetIRChannel(c, 0, 0, 0) == NULL);
  EXPECT(RLRA_Simulate(c) == 0);
  EXPECT(RLRA_GetIRCount(c) == 4);
  for (size_t l = 0; l < 2; ++l)
    for (size_t s = 0; s < 2; ++s) {
      const size_t num_channels = RLRA_GetIRChannelCount(c, l, s), num_samples = RLRA_GetIRSampleCount(c, l, s);
      EXPECT(num_channels == (l == 0 ? 2u : 4u) && num_samples > 1000 && num_samples <= 4000);
      double energy = 0;
      for (size_t channel = 0; channel < num_channels; ++channel) {
        const float *samples = RLRA_GetIRChannel(c, l, s, channel);
        EXPECT(samples != NULL);
        for (size_t i = 0; samples != NULL && i < num_samples; ++i) energy += (double)samples[i] * samples[i];
      }
      EXPECT(isfinite(energy) && energy > 1e-4 && energy < 1);
      EXPECT(RLRA_GetIRChannel(c, l, s, num_channels) == NULL);
    }
  EXPECT(RLRA_GetIRSampleCount(c, 2, 0) == 0 && RLRA_GetIRChannelCount(c, 0, 2) == 0);
  EXPECT(RLRA_GetIndirectRayEfficiency(c) > 0.9f && RLRA_GetIndirectRayEfficiency(c) <= 1.f);
  EXPECT(RLRA_WriteIRWave(c, 1, 0, in_folder(folder, "ir.wav")) == 0);
  EXPECT(size_of(folder, "ir.wav") > (long)(4 * 4 * RLRA_GetIRSampleCount(c, 1, 0)));
  EXPECT(RLRA_WriteIRMetrics(c, 0, 1, in_folder(folder, "metrics.txt")) == 0 && size_of(folder, "metrics.txt") > 100);
  EXPECT(RLRA_WriteSceneMeshOBJ(c, in_folder(folder, "scene.obj")) == 0 && size_of(folder, "scene.obj") > 500);
  EXPECT(RLRA_WriteIRWave(c, 2, 0, in_folder(folder, "none.wav")) == 2001 && size_of(folder, "none.wav") == -1);
}

static void check_rays(context c) {
  struct ray down = {{2.5f, 1.5f, 1.5f}, {0, -4, 0}, 0, 1, 0, {0, 0, 0}}, short_ray = down;
  EXPECT(RLRA_TraceRayFirstHit(c, &down) == 0);
  EXPECT(down.hit == 1 && fabsf(down.t_max - 0.2f) < 1e-6f && down.normal[1] != 0 && down.normal[0] == 0);
  short_ray.t_max = 0.1f;
  EXPECT(RLRA_TraceRayAnyHit(c, &short_ray) == 0 && short_ray.hit == 0 && short_ray.t_max == 0.1f);
  short_ray.direction[1] = 0;
  EXPECT(RLRA_TraceRayAnyHit(c, &short_ray) == 2001);
}

int main(int argc, char **argv) {
  if (argc != 2) return 2;
  mkdir(argv[1], 0777);
  struct configuration config;
  context c = NULL;
  fill_defaults(&config);
  EXPECT(RLRA_CreateContext(&c, &config) == 0 && c != NULL);
  add_objects(c, argv[1]);
  add_places(c);
  check_responses(c, argv[1]);
  check_rays(c);
  EXPECT(RLRA_ClearSources(c) == 0 && RLRA_ClearListeners(c) == 0 && RLRA_ClearObjects(c) == 0);
  EXPECT(RLRA_GetSourceCount(c) == 0 && RLRA_GetListenerCount(c) == 0 && RLRA_GetObjectCount(c) == 0);
  EXPECT(RLRA_GetIRCount(c) == 4); /* until the next simulation */
  EXPECT(RLRA_Simulate(c) == 0 && RLRA_GetIRCount(c) == 0);
  EXPECT(RLRA_ResetContext(c, &config) == 0);
  EXPECT(RLRA_DestroyContext(c) == 0 && RLRA_DestroyContext(c) == 2005);
  printf("%d faults\n", num_faults);
  return num_faults == 0 ? 0 : 1;
}
