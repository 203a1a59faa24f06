// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <span>
#include <vector>

#include "sim/acoustics/paths/long_chains.h"

namespace earshot {

/// The rays of one listener, cached while it does not move: the paths of trace_late(), before their vertices are connected to the source,
/// do not depend on the source.  So a source that moves, or several of them, share these rays, and each trace after the second costs the
/// connections alone.  The bits are those of a trace from nothing.
///
/// Filled by the second trace in a row of the same scene, seed and listener, so that listeners that move pay nothing; used by all after it.
/// Traces of up to 256 rays whose last segments are treated as diffuse (preset `fast`).  Bounded: kMaxVertices vertices, 5 MiB with octave
/// bands and 8 MiB with 32 bands; about 0.5 MiB with 64 rays in a house.  One thread at a time.
class ListenerPaths {
 public:
  static constexpr std::size_t kMaxVertices = 32768;

  enum class Use { none, record, replay };
  /// Use of the cache by the next trace.  scene: AcousticScene::hash(), which holds the seed.
  [[nodiscard]] Use next(std::uint64_t scene, glm::vec3 listener) {
    if (scene != scene_ || listener != listener_) {
      scene_ = scene;
      listener_ = listener;
      state_ = State::seen;
      return Use::none;
    }
    if (state_ == State::seen) {
      state_ = State::recorded;  // until something says otherwise
      vertices_.clear();
      reflected_.clear();
      return Use::record;
    }
    return state_ == State::recorded ? Use::replay : Use::none;
  }

  /// A vertex of the trace, in the order in which they are connected.
  struct Vertex {
    static constexpr std::uint32_t kNone = 0xFFFFFFFFu;
    glm::vec3 start{0}, normal{0};
    std::uint32_t triangle = 0;
    float path_m = 0;
    std::uint32_t bounces = 0;
    std::uint32_t first = 0;  ///< ray from the listener
    std::uint32_t slot = 0;   ///< with the stage: names its random numbers
    std::uint32_t stage = 0;
    std::uint32_t parent = kNone;    ///< the vertex before it on its path
    std::uint32_t chain_length = 0;  ///< mirrors before it, if all were
    std::uint32_t blocker = kNone;   ///< the triangle that last hid the source (EmbreeScene::occluded)
    bool all_specular = false;       ///< mirrors only, until here
  };
  /// Adds one; reflected: energy per padded band.  Returns its index.  Past kMaxVertices nothing is kept of this trace.
  std::uint32_t add(const Vertex& vertex, std::span<const float> reflected) {
    if (state_ != State::recorded) return Vertex::kNone;
    if (vertices_.size() == kMaxVertices) {
      state_ = State::too_many;
      vertices_ = {};
      reflected_ = {};
      return Vertex::kNone;
    }
    vertices_.push_back(vertex);
    reflected_.insert(reflected_.end(), reflected.begin(), reflected.end());
    return static_cast<std::uint32_t>(vertices_.size() - 1);
  }
  [[nodiscard]] std::span<Vertex> vertices() { return vertices_; }
  [[nodiscard]] const float* reflected(std::size_t vertex, std::size_t padded_bands) const { return &reflected_[vertex * padded_bands]; }

  /// Per vertex, for the current source: its mirrors in long chains (listener_ray.h).
  std::vector<LongChains::Chain> long_chains;

  /// Counters of the recorded trace that belong to its rays.
  struct Counters {
    std::uint64_t ray_hits = 0, ray_escapes = 0, nonfinite_dropped = 0;
  };
  Counters counters;

 private:
  enum class State { seen, recorded, too_many };
  std::uint64_t scene_ = 0;
  glm::vec3 listener_{0};
  State state_ = State::too_many;  // the first pose is never taken for a second
  std::vector<Vertex> vertices_;
  std::vector<float> reflected_;
};

/// Holds ListenerPaths for a response.  A copy of a response starts without them, as one thread may use them at a time.
class ListenerMemory {
 public:
  ListenerMemory() = default;
  ListenerMemory(const ListenerMemory&) {}
  ListenerMemory(ListenerMemory&&) = default;
  ListenerMemory& operator=(const ListenerMemory&) { return *this; }
  ListenerMemory& operator=(ListenerMemory&&) = default;
  ~ListenerMemory() = default;

  [[nodiscard]] ListenerPaths& paths() {
    if (!paths_) paths_ = std::make_shared<ListenerPaths>();
    return *paths_;
  }
  /// The same paths for responses of several sources, computed one after the other.
  void use_memory_of(ListenerMemory& other) {
    if (!other.paths_) other.paths_ = std::make_shared<ListenerPaths>();
    paths_ = other.paths_;
  }

 private:
  std::shared_ptr<ListenerPaths> paths_;
};

}  // namespace earshot
