// SPDX-License-Identifier: Apache-2.0
// Random sequences of calls, with handles, indices, numbers, texts and layouts that are right and wrong: each ends with a code, none with a
// signal, and a context that was used so still answers.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "compat/rlr_audio_propagation.h"
#include "sim/base/random.h"
#include "sim/base/temporary_folder.h"

namespace earshot {
namespace {

/// Files that random calls name: whole, damaged and missing ones.
class RandomCallFiles {
 public:
  RandomCallFiles() : folder_(temporary_parent(), "random_calls") {
    write("room.obj",
          "v 0 0 0\nv 4 0 0\nv 4 3 0\nv 0 3 0\nv 0 0 5\nv 4 0 5\nv 4 3 5\nv 0 3 5\nf 1 2 3 4\nf 8 7 6 5\nf 5 6 2 1\nf 7 8 4 3\n");
    write("cut.obj", "v 0 0 0\nv 1 0 0\nf 1 2 9\n");
    write("one.ply",
          "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
          "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
    write("materials.json", R"({"materials": [{"name": "a", "labels": ["default"], "absorption": [125, 0.5], "scattering": [125, 0.5]}]})");
    write("broken.json", R"({"materials": [{"name": "a")");
    paths.push_back(file("none.obj"));
    paths.push_back(file("out/x"));
    paths.push_back(file(""));
    paths.emplace_back("");
  }
  std::vector<std::string> paths;

 private:
  [[nodiscard]] std::string file(const std::string& name) const { return (folder_.path() / name).string(); }
  void write(const std::string& name, const std::string& text) {
    std::ofstream(file(name)) << text;
    paths.push_back(file(name));
  }
  TemporaryFolder folder_;
};

/// Makes a random sequence of calls for a few contexts; a function of its number.
class RandomCaller {
 public:
  RandomCaller(std::uint32_t sequence, const RandomCallFiles& files)
      : random_(1, Purpose::test, sequence), files_(files), simulates_(sequence % 20 == 0) {}
  RandomCaller(const RandomCaller&) = delete;
  RandomCaller& operator=(const RandomCaller&) = delete;
  ~RandomCaller() {
    for (RLRA_Context context : contexts_) RLRA_DestroyContext(context);
  }

  void run() {
    note(create());
    const std::uint32_t num_calls = 8 + below(24);
    for (std::uint32_t i = 0; i < num_calls; ++i) call();
  }
  [[nodiscard]] std::size_t num_done() const { return num_done_; }
  [[nodiscard]] std::size_t num_refused() const { return num_refused_; }
  [[nodiscard]] bool codes_are_known() const { return codes_are_known_; }

 private:
  std::uint32_t below(std::uint32_t count) { return random_.below(count, draw_++); }
  bool happens(std::uint32_t one_in) { return below(one_in) == 0; }

  void note(RLRA_Error code) {
    ++(code == RLRA_Success ? num_done_ : num_refused_);
    static const std::set<int> known = {0, 2000, 2001, 2002, 2003, 2004, 2005, 2018, 2019};
    codes_are_known_ = codes_are_known_ && known.contains(static_cast<int>(code));
  }

  float number() {
    if (happens(24)) {
      constexpr std::array<float, 8> odd{NAN, INFINITY, -INFINITY, 1e38f, -1e30f, 1e-40f, -0.f, 2e9f};
      return odd[below(odd.size())];
    }
    return 5.f * random_.uniform(draw_++) - (happens(4) ? 2.f : 0.f);
  }
  const float* numbers() {
    for (float& value : numbers_) value = number();
    return happens(30) ? nullptr : numbers_.data();
  }
  std::size_t index() {
    if (happens(12)) return std::array<std::size_t, 3>{7, SIZE_MAX, 1u << 31}[below(3)];
    return below(2);
  }
  RLRA_Context context() {
    if (happens(40)) return nullptr;
    if (happens(40)) return reinterpret_cast<RLRA_Context>(std::uintptr_t{0xABCDEF} + below(100));
    if (happens(60)) return destroyed_;
    return contexts_.empty() ? nullptr : contexts_[below(static_cast<std::uint32_t>(contexts_.size()))];
  }
  const char* path() {
    if (happens(20)) return nullptr;
    return files_.paths[below(static_cast<std::uint32_t>(files_.paths.size()))].c_str();
  }
  const char* category() {
    constexpr std::array<const char*, 6> names{"wall",  "default", "",
                                               nullptr, "#\n\xff", "a rather long name of a category, which is no material"};
    return names[below(names.size())];
  }

  RLRA_ContextConfiguration configuration() {
    RLRA_ContextConfiguration made;
    note(RLRA_ContextConfigurationDefault(&made));
    made.indirectRayCount = below(40);
    made.indirectRayDepth = below(60);
    made.sampleRate = 8000.f;
    made.maxIRLength = 0.05f + 0.1f * random_.uniform(draw_++);
    made.frequencyBands = 1 + below(6);
    made.indirectSHOrder = below(3);
    made.maxDiffractionOrder = below(3);
    made.direct = static_cast<RLR_Bool>(below(2));
    made.indirect = static_cast<RLR_Bool>(below(256));
    made.diffraction = static_cast<RLR_Bool>(below(2));
    made.transmission = static_cast<RLR_Bool>(below(2));
    made.meshSimplification = static_cast<RLR_Bool>(below(2));
    made.temporalCoherence = static_cast<RLR_Bool>(below(2));
    if (happens(8)) made.globalVolume = number();
    if (happens(8)) made.unitScale = number();
    if (happens(12)) made.sampleRate = number();
    if (happens(12)) made.maxIRLength = number();
    if (happens(12)) made.thisSize = below(200);
    if (happens(12)) made.frequencyBands = std::array<std::size_t, 3>{0, 99, SIZE_MAX}[below(3)];
    if (happens(12)) made.hrtfUp[below(3)] = number();
    return made;
  }
  RLRA_Error create() {
    const RLRA_ContextConfiguration made = configuration();
    RLRA_Context handle = nullptr;
    const RLRA_Error code = RLRA_CreateContext(happens(50) ? nullptr : &handle, happens(50) ? nullptr : &made);
    if (handle != nullptr) contexts_.push_back(handle);
    return code;
  }
  void destroy() {
    if (contexts_.empty()) return note(RLRA_DestroyContext(destroyed_));
    destroyed_ = contexts_.back();
    contexts_.pop_back();
    note(RLRA_DestroyContext(destroyed_));
  }

  void call() {
    switch (below(8)) {
      case 0:
        return call_context();
      case 1:
        return call_source();
      case 2:
      case 3:
        return call_listener();
      case 4:
      case 5:
        return call_object();
      case 6:
        return call_mesh();
      default:
        return call_response();
    }
  }

  void call_context() {
    switch (below(6)) {
      case 0:
        return note(create());
      case 1:
        return destroy();
      case 2: {
        const RLRA_ContextConfiguration made = configuration();
        return note(RLRA_ResetContext(context(), happens(10) ? nullptr : &made));
      }
      case 3:
        return note(RLRA_SetMaterialDatabaseJSON(context(), path()));
      case 4:
        return note(RLRA_WriteSceneMeshOBJ(context(), path()));
      default:
        return note(RLRA_ContextConfigurationDefault(nullptr));
    }
  }
  void call_source() {
    switch (below(6)) {
      case 0:
      case 1:
        return note(RLRA_AddSource(context()));
      case 2:
        return happens(4) ? note(RLRA_ClearSources(context())) : note(RLRA_AddSource(context()));
      case 3:
        return note(RLRA_SetSourceRadius(context(), index(), number()));
      default:
        (void)RLRA_GetSourceCount(context());
        return note(RLRA_SetSourcePosition(context(), index(), numbers()));
    }
  }
  void call_listener() {
    switch (below(7)) {
      case 0:
      case 1: {
        constexpr std::array<std::size_t, 5> counts{1, 4, 9, 0, SIZE_MAX};
        const RLRA_ChannelLayout layout{counts[below(happens(4) ? 5 : 2)],
                                        static_cast<RLRA_ChannelLayoutType>(happens(5) ? below(8) : std::array{1u, 3u, 7u}[below(3)])};
        return note(RLRA_AddListener(context(), happens(30) ? nullptr : &layout));
      }
      case 2:
        return happens(4) ? note(RLRA_ClearListeners(context())) : note(RLRA_SetListenerRadius(context(), index(), number()));
      case 3:
        return note(RLRA_SetListenerHRTF(context(), index(), happens(2) ? nullptr : ""));
      case 4:
        (void)RLRA_GetListenerCount(context());
        return note(RLRA_SetListenerOrientationQuaternion(context(), index(), numbers()));
      default:
        return note(RLRA_SetListenerPosition(context(), index(), numbers()));
    }
  }
  void call_object() {
    switch (below(8)) {
      case 0:
      case 1:
        return note(RLRA_AddObject(context()));
      case 2:
        return happens(6) ? note(RLRA_ClearObjects(context())) : note(RLRA_SetObjectPosition(context(), index(), numbers()));
      case 3:
        return note(RLRA_SetObjectOrientationQuaternion(context(), index(), numbers()));
      case 4:
        return note(RLRA_SetObjectMeshOBJ(context(), index(), path(), category()));
      case 5:
        return note(RLRA_SetObjectMeshPLY(context(), index(), path(), category()));
      default: {
        const RLRA_BoxMaterialCategories names{category(), category(), category(), category(), category(), category()};
        std::array<float, 3> low{}, high{};
        for (std::size_t axis = 0; axis < 3; ++axis) low[axis] = number(), high[axis] = low[axis] + number() + 2.f;
        (void)RLRA_GetObjectCount(context());
        return note(RLRA_SetObjectBox(context(), index(), happens(30) ? nullptr : low.data(), high.data(), happens(3) ? nullptr : &names));
      }
    }
  }
  void call_mesh() {
    const std::size_t num_vertices = below(9);
    std::vector<float> vertices(3 * num_vertices);
    for (float& value : vertices) value = number();
    std::vector<std::uint32_t> indices(below(13));
    for (std::uint32_t& value : indices) value = happens(30) ? 0xFFFFFFFFu : below(static_cast<std::uint32_t>(num_vertices) + 1);
    RLRA_Context handle = context();
    note(RLRA_AddMeshVertices(handle, happens(20) ? nullptr : vertices.data(), num_vertices));
    note(RLRA_AddMeshIndices(handle, happens(20) ? nullptr : indices.data(), indices.size(), happens(10) ? below(6) : 3 + below(2),
                             category()));
    note(RLRA_FinalizeObjectMesh(handle, index()));
  }
  void call_response() {
    RLRA_Context handle = context();
    const std::size_t listener = index(), source = index();
    if (simulates_ && happens(2)) note(RLRA_Simulate(handle));
    (void)RLRA_GetIRCount(handle);
    (void)RLRA_GetIndirectRayEfficiency(handle);
    const std::size_t channels = RLRA_GetIRChannelCount(handle, listener, source),
                      samples = RLRA_GetIRSampleCount(handle, listener, source);
    for (std::size_t channel = 0; channel < channels + 1; ++channel) {
      const float* heard = RLRA_GetIRChannel(handle, listener, source, channel);
      if ((heard != nullptr) != (channel < channels)) codes_are_known_ = false;
      for (std::size_t i = 0; heard != nullptr && i < samples; ++i) codes_are_known_ = codes_are_known_ && !std::isnan(heard[i]);
    }
    if (happens(4)) note(RLRA_WriteIRWave(handle, listener, source, path()));
    if (happens(4)) note(RLRA_WriteIRMetrics(handle, listener, source, path()));
    RLRA_Ray ray{};
    for (int i = 0; i < 3; ++i) ray.origin[i] = number(), ray.direction[i] = number() - 1.f;
    ray.tMin = happens(3) ? number() : 0.f;
    ray.tMax = happens(3) ? number() : 1e30f;
    note(RLRA_TraceRayFirstHit(handle, happens(20) ? nullptr : &ray));
    note(RLRA_TraceRayAnyHit(handle, &ray));
  }

  RandomStream random_;
  const RandomCallFiles& files_;
  bool simulates_;
  std::uint32_t draw_ = 0;
  std::array<float, 4> numbers_{};
  std::vector<RLRA_Context> contexts_;
  RLRA_Context destroyed_ = nullptr;
  std::size_t num_done_ = 0, num_refused_ = 0;
  bool codes_are_known_ = true;
};

/// Sequences first to first + count - 1.
void run_sequences(std::uint32_t first, std::uint32_t count) {
  const RandomCallFiles files;
  std::size_t num_done = 0, num_refused = 0;
  for (std::uint32_t sequence = first; sequence < first + count; ++sequence) {
    RandomCaller caller(sequence, files);
    caller.run();
    num_done += caller.num_done();
    num_refused += caller.num_refused();
    ASSERT_TRUE(caller.codes_are_known()) << "sequence " << sequence;
  }
  // Neither kind is a rarity, so that the sequences get somewhere.
  EXPECT_GT(num_refused, 3 * std::size_t{count});
  EXPECT_GT(num_done, 3 * std::size_t{count});
}

TEST(RandomCalls, NoSequenceOfCallsCrashes) { run_sequences(10'000, 400); }
TEST(RandomCalls, TenThousandSequencesDoNotCrash) { run_sequences(0, 10'000); }

}  // namespace
}  // namespace earshot
