// Batches of environments: arrays on the engine's own memory.
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cstdint>
#include <memory>
#include <span>

#include "envs/batch/batched_env.h"
#include "envs/config/batch_config.h"
#include "python/src/bindings.h"
#include "sim/base/errors.h"

namespace earshot::python {
namespace {

/// Arrays refer to this object and keep it alive, so that none outlives the memory it shows.
class Batch {
 public:
  Batch(const std::string& yaml, const std::string& where, const std::vector<std::string>& overrides,
        const std::vector<std::string>& env_overrides, const std::string& split, int num_envs, int first_env)
      : Batch(read(yaml, where, overrides, env_overrides, split, num_envs, first_env), num_envs, first_env) {}

  BatchedEnv env;

 private:
  static BatchParts read(const std::string& yaml, const std::string& where, const std::vector<std::string>& overrides,
                         const std::vector<std::string>& env_overrides, const std::string& split, int num_envs, int first_env) {
    require(num_envs >= 1 && num_envs <= 65536, "num_envs", num_envs, "must be in [1, 65536]");
    require(first_env >= 0 && first_env <= 1'000'000'000, "first_env", first_env, "must be in [0, 1e9]");
    return read_batch(yaml, where, overrides, env_overrides, split);
  }
  Batch(const BatchParts& parts, int num_envs, int first_env)
      : env(parts.config, parts.set, parts.scenes, num_envs, first_env, num_envs + first_env) {}
};

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

/// Rows of a sensor, [rows, shape]: the memory of the batch itself.
nb::ndarray<nb::numpy> rows_of(nb::handle_t<Batch> self, const std::string& sensor, bool last) {
  const BatchedEnv& env = nb::inst_ptr<Batch>(self)->env;
  const SensorSpec* found = find_sensor(env.sensors(), sensor);
  if (!found) throw nb::key_error(("there is no sensor '" + sensor + "'").c_str());
  const SensorSpec& spec = *found;
  const std::span<const std::byte> bytes = last ? env.final_rows(sensor) : env.rows(sensor);
  std::vector<std::size_t> shape{static_cast<std::size_t>(env.num_rows())};
  shape.insert(shape.end(), spec.shape.begin(), spec.shape.end());
  return nb::ndarray<nb::numpy>(const_cast<std::byte*>(bytes.data()), shape.size(), shape.data(), self, nullptr, dtype_of(spec.type));
}

template <class T>
nb::ndarray<nb::numpy, T> view_of(nb::handle self, std::span<const T> values) {
  const std::size_t shape[1] = {values.size()};
  return nb::ndarray<nb::numpy, T>(const_cast<T*>(values.data()), 1, shape, self);
}

nb::list sensors_of(const Batch& batch) {
  nb::list sensors;
  for (const SensorSpec& spec : batch.env.sensors())
    sensors.append(
        nb::make_tuple(spec.name, std::string(name_of(spec.type)), spec.shape, spec.units, spec.low, spec.high, spec.privileged));
  return sensors;
}

nb::list finished_of(const Batch& batch) {
  nb::list finished;
  for (const FinishedEpisode& episode : batch.env.finished()) {
    const EpisodeMetrics& m = episode.metrics;
    nb::dict metrics;
    metrics["success"] = m.success;
    metrics["spl"] = m.spl;
    metrics["soft_spl"] = m.soft_spl;
    metrics["sna"] = m.sna;
    metrics["distance_to_goal_m"] = m.dtg_m;
    metrics["success_when_silent"] = m.success_when_silent;
    metrics["episode_return"] = m.reward;
    metrics["steps"] = m.steps;
    metrics["collisions"] = m.collisions;
    metrics["stopped"] = m.stopped;
    metrics["episode_index"] = episode.episode_index;
    finished.append(nb::make_tuple(episode.env, episode.agent, metrics));
  }
  return finished;
}

std::span<const std::int32_t> flat(const Input<std::int32_t>& actions) { return {actions.data(), actions.size()}; }

using BatchClass = nb::class_<Batch>;

void bind_stepping(BatchClass& batch) {
  using namespace nb::literals;
  batch.def(
      "reset", [](Batch& b) { b.env.reset(); }, nb::call_guard<nb::gil_scoped_release>());
  batch.def(
      "reset_masked",
      [](Batch& b, const Input<std::uint8_t>& mask, const Input<std::uint64_t>& seeds) {
        const std::span<const std::uint8_t> flags(mask.data(), mask.size());
        const std::span<const std::uint64_t> values(seeds.data(), seeds.size());
        const nb::gil_scoped_release free;
        b.env.reset(flags, values);
      },
      "mask"_a, "seeds"_a);
  batch.def(
      "step",
      [](Batch& b, const Input<std::int32_t>& actions) {
        const nb::gil_scoped_release free;
        b.env.step(flat(actions));
      },
      "actions"_a);
  batch.def(
      "send",
      [](Batch& b, const Input<std::int32_t>& envs, const Input<std::int32_t>& actions) {
        const nb::gil_scoped_release free;
        b.env.send(flat(envs), flat(actions));
      },
      "envs"_a, "actions"_a);
  batch.def(
      "recv",
      [](Batch& b, int min_ready, bool as_sent) {
        std::vector<std::int32_t> ready;
        {
          const nb::gil_scoped_release free;
          const auto envs = b.env.recv(min_ready, as_sent ? RecvOrder::as_sent : RecvOrder::as_ready);
          ready.assign(envs.begin(), envs.end());
        }
        const std::size_t count = ready.size();
        return array_of(std::move(ready), {count});
      },
      "min_ready"_a, "as_sent"_a);
}

void bind_properties(BatchClass& batch) {
  batch.def_prop_ro("num_envs", [](const Batch& b) { return b.env.num_envs(); });
  batch.def_prop_ro("num_agents", [](const Batch& b) { return b.env.config().agents; });
  batch.def_prop_ro("num_rows", [](const Batch& b) { return b.env.num_rows(); });
  batch.def_prop_ro("autoreset", [](const Batch& b) {
    switch (b.env.config().autoreset) {
      case Autoreset::next_step:
        return "next_step";
      case Autoreset::off:
        return "off";
      case Autoreset::same_step:
        break;
    }
    return "same_step";
  });
  batch.def_prop_ro("config_text", [](const Batch& b) { return config_text(b.env.config()); });
}

void bind_arrays(BatchClass& batch) {
  using namespace nb::literals;
  batch.def("sensors", &sensors_of);
  batch.def(
      "rows", [](nb::handle_t<Batch> self, const std::string& sensor) { return rows_of(self, sensor, false); }, "sensor"_a);
  batch.def(
      "final_rows", [](nb::handle_t<Batch> self, const std::string& sensor) { return rows_of(self, sensor, true); }, "sensor"_a);
  batch.def("rewards", [](nb::handle_t<Batch> self) { return view_of(self, nb::inst_ptr<Batch>(self)->env.rewards()); });
  batch.def("terminated", [](nb::handle_t<Batch> self) { return view_of(self, nb::inst_ptr<Batch>(self)->env.terminated()); });
  batch.def("truncated", [](nb::handle_t<Batch> self) { return view_of(self, nb::inst_ptr<Batch>(self)->env.truncated()); });
  batch.def("active", [](nb::handle_t<Batch> self) { return view_of(self, nb::inst_ptr<Batch>(self)->env.active()); });
  batch.def("collided", [](nb::handle_t<Batch> self) { return view_of(self, nb::inst_ptr<Batch>(self)->env.collided()); });
  batch.def("quarantined", [](nb::handle_t<Batch> self) { return view_of(self, nb::inst_ptr<Batch>(self)->env.quarantined()); });
  batch.def("acted", [](nb::handle_t<Batch> self) { return view_of(self, nb::inst_ptr<Batch>(self)->env.acted()); });
}

void bind_episodes(BatchClass& batch) {
  using namespace nb::literals;
  batch.def("finished", &finished_of);
  batch.def(
      "pose",
      [](const Batch& b, int row) {
        const Pose pose = b.env.agent(row).pose;
        const glm::dvec3 at = b.env.source(row).scene->scene->to_world(pose.position);
        return nb::make_tuple(at.x, at.y, at.z, static_cast<double>(pose.heading_rad));
      },
      "row"_a);
  batch.def(
      "scene_name", [](const Batch& b, int row) { return b.env.source(row).scene->scene->name(); }, "row"_a);
  batch.def(
      "episode_index", [](const Batch& b, int row) { return b.env.agent(row).episode_index; }, "row"_a);
}

void bind_state(BatchClass& batch) {
  using namespace nb::literals;
  batch.def(
      "snapshot",
      [](const Batch& b, int env) {
        const std::string state = b.env.snapshot(env);
        return nb::bytes(state.data(), state.size());
      },
      "env"_a);
  batch.def(
      "restore",
      [](Batch& b, int env, const nb::bytes& state) {
        const std::string_view text(state.c_str(), state.size());
        const nb::gil_scoped_release free;
        b.env.restore(env, text);
      },
      "env"_a, "state"_a);
  batch.def("save_state", [](const Batch& b) {
    const std::string state = b.env.save_state();
    return nb::bytes(state.data(), state.size());
  });
  batch.def(
      "restore_state",
      [](Batch& b, const nb::bytes& state) {
        const std::string_view text(state.c_str(), state.size());
        const nb::gil_scoped_release free;
        b.env.restore(text);
      },
      "state"_a);
}

}  // namespace

void bind_batch(nb::module_& m) {
  using namespace nb::literals;
  BatchClass batch(m, "Batch");
  using Texts = std::vector<std::string>;
  batch.def(nb::init<const std::string&, const std::string&, const Texts&, const Texts&, const std::string&, int, int>(), "yaml"_a,
            "where"_a, "overrides"_a, "env_overrides"_a, "split"_a, "num_envs"_a, "first_env"_a, nb::call_guard<nb::gil_scoped_release>());
  bind_stepping(batch);
  bind_properties(batch);
  bind_arrays(batch);
  bind_episodes(batch);
  bind_state(batch);
}

}  // namespace earshot::python
