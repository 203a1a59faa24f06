// SPDX-License-Identifier: Apache-2.0
// Batches of environments: arrays on the engine's own memory.
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cstdint>
#include <memory>
#include <span>
#include <utility>

#include "earshot/env.h"
#include "python/src/running_batch.h"

namespace earshot::python {
namespace {

/// Arrays refer to the Python object and keep it alive, so that none outlives the memory it shows.
using Self = nb::handle_t<BatchHandle>;

nb::dlpack::dtype dtype_of(SensorType type) {
  switch (type) {
    case SensorType::uint8:
      return nb::dtype<std::uint8_t>();
    case SensorType::uint16:
      return nb::dtype<std::uint16_t>();
    case SensorType::int32:
      return nb::dtype<std::int32_t>();
    case SensorType::float32:
      break;
  }
  return nb::dtype<float>();
}

const char* name_of(SensorType type) {
  switch (type) {
    case SensorType::uint8:
      return "uint8";
    case SensorType::uint16:
      return "uint16";
    case SensorType::int32:
      return "int32";
    case SensorType::float32:
      break;
  }
  return "float32";
}

/// Rows of a sensor, [rows, shape]: the memory of the batch itself.
nb::ndarray<nb::numpy> rows_of(Self self, const std::string& sensor, bool last) {
  const VectorEnv& env = *nb::inst_ptr<BatchHandle>(self)->batch->env;
  for (const SensorInfo& info : env.sensors()) {
    if (info.name != sensor) continue;
    const std::span<const std::byte> bytes = last ? env.final_rows(sensor) : env.rows(sensor);
    std::vector<std::size_t> shape{static_cast<std::size_t>(env.num_rows())};
    shape.insert(shape.end(), info.shape.begin(), info.shape.end());
    return nb::ndarray<nb::numpy>(const_cast<std::byte*>(bytes.data()), shape.size(), shape.data(), self, nullptr, dtype_of(info.type));
  }
  throw nb::key_error(("there is no sensor '" + sensor + "'").c_str());
}

/// An array [rows] that the batch owns.
template <class T, std::span<const T> (VectorEnv::*values)() const>
nb::ndarray<nb::numpy, T> view_of(Self self) {
  const std::span<const T> rows = (*nb::inst_ptr<BatchHandle>(self)->batch->env.*values)();
  const std::size_t shape[1] = {rows.size()};
  return nb::ndarray<nb::numpy, T>(const_cast<T*>(rows.data()), 1, shape, self);
}

nb::list sensors_of(const BatchHandle& self) {
  nb::list sensors;
  for (const SensorInfo& info : self.batch->env->sensors())
    sensors.append(nb::make_tuple(info.name, name_of(info.type), info.shape, info.units, info.low, info.high, info.privileged));
  return sensors;
}

nb::list finished_of(const BatchHandle& self) {
  nb::list finished;
  for (const EpisodeResult& episode : look(self, "Batch.finished", [](const VectorEnv& env) { return env.finished(); })) {
    nb::dict metrics;
    metrics["success"] = episode.success;
    metrics["spl"] = episode.spl;
    metrics["soft_spl"] = episode.soft_spl;
    metrics["sna"] = episode.sna;
    metrics["distance_to_goal_m"] = episode.distance_to_goal_m;
    metrics["success_when_silent"] = episode.success_when_silent;
    metrics["episode_return"] = episode.episode_return;
    metrics["steps"] = episode.steps;
    metrics["collisions"] = episode.collisions;
    metrics["stopped"] = episode.stopped;
    metrics["episode_index"] = episode.episode_index;
    finished.append(nb::make_tuple(episode.env, episode.agent, metrics));
  }
  return finished;
}

template <class T>
std::vector<T> copy_of(const Input<T>& values) {
  return {values.data(), values.data() + values.size()};
}
nb::bytes bytes_of(const std::string& text) { return nb::bytes(text.data(), text.size()); }
std::string text_of(const nb::bytes& bytes) { return {bytes.c_str(), bytes.size()}; }

using BatchClass = nb::class_<BatchHandle>;

/// Of a wait that a signal ends nothing is handed back: the envs stay under way, for the next recv().
Array<std::int32_t> receive(const BatchHandle& handle, int min_ready, bool as_sent) {
  const Entered entered(handle, "Batch.recv");
  entered.call([=](RunningBatch& batch) { batch.env->wait_ready(min_ready, as_sent); });
  std::vector<std::int32_t> ready;
  {
    const RunningCall running;
    const nb::gil_scoped_release released;
    ready = handle.batch->env->recv(min_ready, as_sent);
  }
  const std::size_t count = ready.size();
  return array_of(std::move(ready), {count});
}

void bind_stepping(BatchClass& batch) {
  using namespace nb::literals;
  using Ints = Input<std::int32_t>;
  batch.def("reset", [](const BatchHandle& self) { call(self, "Batch.reset", [](RunningBatch& running) { running.env->reset(); }); });
  batch.def(
      "reset_masked",
      [](const BatchHandle& self, const Input<std::uint8_t>& mask, const Input<std::uint64_t>& seeds) {
        call(self, "Batch.reset_masked",
             [mask = copy_of(mask), seeds = copy_of(seeds)](RunningBatch& running) { running.env->reset(mask, seeds); });
      },
      "mask"_a, "seeds"_a);
  batch.def(
      "step",
      [](const BatchHandle& self, const Ints& actions) {
        call(self, "Batch.step", [actions = copy_of(actions)](RunningBatch& running) { running.env->step(actions); });
      },
      "actions"_a);
  batch.def(
      "send",
      [](const BatchHandle& self, const Ints& envs, const Ints& actions) {
        call(self, "Batch.send",
             [envs = copy_of(envs), actions = copy_of(actions)](RunningBatch& running) { running.env->send(envs, actions); });
      },
      "envs"_a, "actions"_a);
  batch.def("recv", &receive, "min_ready"_a, "as_sent"_a);
}

void bind_properties(BatchClass& batch) {
  batch.def_prop_ro("num_envs", [](const BatchHandle& self) { return self.batch->env->num_envs(); });
  batch.def_prop_ro("num_agents", [](const BatchHandle& self) { return self.batch->env->num_agents(); });
  batch.def_prop_ro("num_rows", [](const BatchHandle& self) { return self.batch->env->num_rows(); });
  batch.def_prop_ro("autoreset", [](const BatchHandle& self) { return self.batch->env->autoreset(); });
  batch.def_prop_ro("config_text", [](const BatchHandle& self) { return self.batch->env->config_text(); });
}

void bind_arrays(BatchClass& batch) {
  using namespace nb::literals;
  using Flag = std::uint8_t;
  batch.def("sensors", &sensors_of);
  batch.def(
      "rows", [](Self self, const std::string& sensor) { return rows_of(self, sensor, false); }, "sensor"_a);
  batch.def(
      "final_rows", [](Self self, const std::string& sensor) { return rows_of(self, sensor, true); }, "sensor"_a);
  batch.def("rewards", &view_of<float, &VectorEnv::rewards>);
  batch.def("terminated", &view_of<Flag, &VectorEnv::terminated>);
  batch.def("truncated", &view_of<Flag, &VectorEnv::truncated>);
  batch.def("active", &view_of<Flag, &VectorEnv::active>);
  batch.def("collided", &view_of<Flag, &VectorEnv::collided>);
  batch.def("quarantined", &view_of<Flag, &VectorEnv::quarantined>);
  batch.def("acted", &view_of<Flag, &VectorEnv::acted>);
}

void bind_episodes(BatchClass& batch) {
  using namespace nb::literals;
  batch.def("finished", &finished_of);
  batch.def(
      "pose",
      [](const BatchHandle& self, int row) {
        const AgentPose pose = look(self, "Batch.pose", [&](const VectorEnv& env) { return env.pose(row); });
        return nb::make_tuple(pose.position.x, pose.position.y, pose.position.z, pose.heading_rad);
      },
      "row"_a);
  batch.def(
      "scene_name",
      [](const BatchHandle& self, int row) {
        return look(self, "Batch.scene_name", [&](const VectorEnv& env) { return env.scene_name(row); });
      },
      "row"_a);
  batch.def(
      "episode_index",
      [](const BatchHandle& self, int row) {
        return look(self, "Batch.episode_index", [&](const VectorEnv& env) { return env.episode_index(row); });
      },
      "row"_a);
}

/// Single episodes and places, for simulators that choose them by themselves.
void bind_places(BatchClass& batch) {
  using namespace nb::literals;
  batch.def(
      "begin_episode",
      [](const BatchHandle& self, int number, std::uint64_t index) {
        call(self, "Batch.begin_episode", [=](RunningBatch& running) { running.env->begin_episode(number, index); });
      },
      "env"_a, "index"_a);
  batch.def(
      "place",
      [](const BatchHandle& self, int number, double x, double y, double z, double heading_rad, int steps) {
        call(self, "Batch.place", [=](RunningBatch& running) { running.env->place(number, {{x, y, z}, heading_rad}, steps); });
      },
      "env"_a, "x"_a, "y"_a, "z"_a, "heading_rad"_a, "steps"_a);
  batch.def(
      "navigation",
      [](const BatchHandle& self, int row) {
        return look(self, "Batch.navigation", [&](const VectorEnv& env) { return env.navigation(row); });
      },
      "row"_a);
}

void bind_state(BatchClass& batch) {
  using namespace nb::literals;
  batch.def(
      "snapshot",
      [](const BatchHandle& self, int number) {
        return bytes_of(look(self, "Batch.snapshot", [&](const VectorEnv& env) { return env.snapshot(number); }));
      },
      "env"_a);
  batch.def(
      "restore",
      [](const BatchHandle& self, int number, const nb::bytes& state) {
        call(self, "Batch.restore", [=, text = text_of(state)](RunningBatch& running) { running.env->restore(number, text); });
      },
      "env"_a, "state"_a);
  batch.def("save_state", [](const BatchHandle& self) {
    return bytes_of(look(self, "Batch.save_state", [](const VectorEnv& env) { return env.save_state(); }));
  });
  batch.def("input_files", [](const BatchHandle& self) {
    std::vector<std::pair<std::string, std::uint64_t>> pairs;
    const auto files = call(self, "Batch.input_files", [](RunningBatch& running) { return running.env->input_files(); });
    for (const InputFile& file : files) pairs.emplace_back(file.name, file.hash);
    return pairs;
  });
  batch.def(
      "restore_state",
      [](const BatchHandle& self, const nb::bytes& state) {
        call(self, "Batch.restore_state", [text = text_of(state)](RunningBatch& running) { running.env->restore_state(text); });
      },
      "state"_a);
}

}  // namespace

void bind_batch(nb::module_& m) {
  using namespace nb::literals;
  BatchClass batch(m, "Batch");
  using Texts = std::vector<std::string>;
  batch.def(
      "__init__",
      [](BatchHandle* self, const std::string& yaml, const std::string& where, const Texts& overrides, const Texts& env_overrides,
         const std::string& split, int num_envs, int first_env) {
        new (self) BatchHandle{interruptible([=](const std::stop_token&) {
          const VectorEnvOptions options{split, first_env, Settings(env_overrides)};
          return std::make_shared<RunningBatch>(VectorEnv({yaml, where, Settings(overrides)}, num_envs, options));
        })};
      },
      "yaml"_a, "where"_a, "overrides"_a, "env_overrides"_a, "split"_a, "num_envs"_a, "first_env"_a);
  bind_stepping(batch);
  bind_properties(batch);
  bind_arrays(batch);
  bind_episodes(batch);
  bind_places(batch);
  bind_state(batch);
}

}  // namespace earshot::python
