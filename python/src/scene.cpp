// Scenes, sources, batches of responses.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <tuple>

#include "python/src/acoustic_model.h"
#include "python/src/bindings.h"
#include "sim/base/errors.h"

namespace earshot::python {
namespace {

using Numbers = Input<double>;

std::vector<ListenerPose> poses_of(const Numbers& positions, const Numbers& angles_deg) {
  if (positions.ndim() != 2 || positions.shape(1) != 3 || angles_deg.ndim() != 2 || angles_deg.shape(1) != 3 ||
      positions.shape(0) != angles_deg.shape(0))
    throw InputError("listeners", "have a wrong shape", "give positions [n, 3] and as many angles [n, 3]");
  std::vector<ListenerPose> poses(positions.shape(0));
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const double *at = positions.data() + 3 * i, *angle = angles_deg.data() + 3 * i;
    poses[i] = {glm::dvec3(at[0], at[1], at[2]), angle[0], angle[1], angle[2]};
  }
  return poses;
}

Array<float> rirs_of(std::vector<Rir> rirs) {
  const std::size_t channels = rirs.empty() ? 0 : static_cast<std::size_t>(rirs.front().num_channels);
  std::size_t samples = 0;
  for (const Rir& rir : rirs) samples = std::max(samples, static_cast<std::size_t>(rir.num_samples));
  if (rirs.size() == 1) return array_of(std::move(rirs.front().samples), {1, channels, samples});
  std::vector<float> all(rirs.size() * channels * samples, 0.f);
  for (std::size_t i = 0; i < rirs.size(); ++i)
    for (std::size_t channel = 0; channel < channels; ++channel)
      std::ranges::copy(rirs[i].channel(static_cast<int>(channel)),
                        all.begin() + static_cast<std::ptrdiff_t>((i * channels + channel) * samples));
  const std::size_t count = rirs.size();
  return array_of(std::move(all), {count, channels, samples});
}

std::tuple<double, double, double> triple(glm::dvec3 v) { return {v.x, v.y, v.z}; }

/// up: y, z, or empty for what the scene says.
SceneOverrides overrides_of(std::optional<double> unit_m, std::optional<double> simplify_m, const std::string& up) {
  if (!up.empty() && up != "y" && up != "z") throw InputError("up", "is '" + up + "'", "write y or z");
  SceneOverrides overrides;
  overrides.unit_m = unit_m;
  if (simplify_m) overrides.simplify_m = static_cast<float>(*simplify_m);
  if (!up.empty()) overrides.up = up == "z" ? MeshImportOptions::Up::z : MeshImportOptions::Up::y;
  return overrides;
}

Array<double> random_places(SceneModel& scene, int count, double height_m, std::uint64_t seed) {
  std::vector<double> numbers;
  {
    const nb::gil_scoped_release released;
    for (const glm::dvec3 place : random_positions(scene.scene(), count, height_m, seed))
      numbers.insert(numbers.end(), {place.x, place.y, place.z});
  }
  const std::size_t rows = numbers.size() / 3;
  return array_of(std::move(numbers), {rows, 3});
}

nb::list plan_of(SceneModel& scene) {
  std::shared_ptr<const AcousticScene> acoustics;
  {
    const nb::gil_scoped_release released;
    acoustics = scene.acoustics(scene.config().sh_order);
  }
  nb::list plan;
  for (const EffectDecision& decision : acoustics->plan().decisions)
    plan.append(nb::make_tuple(decision.effect, decision.decision, decision.on, decision.change, decision.unit, name_of(decision.kind),
                               decision.saved_ms, decision.why));
  return plan;
}

Array<float> render_all(SourceModel& source, const Numbers& positions, const Numbers& angles_deg, const std::string& channels,
                        const std::string& hrtf, int threads) {
  const std::vector<ListenerPose> poses = poses_of(positions, angles_deg);
  std::vector<Rir> rirs;
  {
    const nb::gil_scoped_release released;
    rirs = source.render(poses, channels, hrtf, threads);
  }
  return rirs_of(std::move(rirs));
}

std::vector<ListenerPose> places_of(const Numbers& positions) {
  if (positions.ndim() != 2 || positions.shape(1) != 3) throw InputError("listeners", "have a wrong shape", "give positions [n, 3]");
  std::vector<ListenerPose> poses(positions.shape(0));
  for (std::size_t i = 0; i < poses.size(); ++i)
    poses[i].position = {positions.data()[3 * i], positions.data()[3 * i + 1], positions.data()[3 * i + 2]};
  return poses;
}

nb::dict dict_of(const AccuracyErrors& errors) {
  nb::dict dict;
  for (std::size_t kind = 0; kind < kNumAccuracyKinds; ++kind) {
    const AccuracyUnit& unit = unit_of(static_cast<AccuracyKind>(kind));
    dict[(std::string(unit.name) + (unit.scale > 1 ? "_pct" : "_db")).c_str()] = errors[kind] * unit.scale;
  }
  return dict;
}

nb::dict dict_of(const AccuracyChoice& choice) {
  nb::dict dict;
  dict["method"] = choice.method;
  dict["settings"] = settings_of(choice);
  dict["predicted"] = dict_of(choice.predicted);
  dict["per_source_ms"] = choice.per_source_ms;
  dict["per_response_ms"] = choice.per_pose_ms;
  return dict;
}

nb::dict plan_accuracy(SourceModel& source, const std::string& target, const Numbers& positions, double responses) {
  const std::vector<ListenerPose> places = places_of(positions);
  AccuracyPlan plan;
  {
    const nb::gil_scoped_release released;
    plan = source.plan_accuracy(target, places, responses);
  }
  nb::list tried;
  for (const AccuracyChoice& choice : plan.tried) tried.append(dict_of(choice));
  nb::dict dict;
  dict["tried"] = tried;
  dict["chosen"] = plan.chosen;
  dict["reference_error"] = dict_of(plan.reference_error);
  dict["calibration_s"] = plan.calibration_s;
  return dict;
}

std::vector<std::shared_ptr<ResponseModel>> respond_all(SourceModel& source, const Numbers& positions, const std::string& channels,
                                                        int threads) {
  const std::vector<ListenerPose> poses = places_of(positions);
  const nb::gil_scoped_release released;
  std::vector<std::shared_ptr<ResponseModel>> responses;
  for (ResponseModel& response : source.respond(poses, channels, threads))
    responses.push_back(std::make_shared<ResponseModel>(std::move(response)));
  return responses;
}

}  // namespace

void bind_scene(nb::module_& m) {
  using namespace nb::literals;
  const auto released = nb::call_guard<nb::gil_scoped_release>();
  nb::class_<SceneModel>(m, "SceneModel")
      .def(
          "__init__",
          [](SceneModel* self, const std::string& spec, const std::string& preset, const std::vector<std::string>& settings,
             std::optional<double> rate_hz, std::optional<std::uint64_t> seed, std::optional<double> unit_m,
             std::optional<double> simplify_m,
             const std::string& up) { new (self) SceneModel(spec, preset, settings, rate_hz, seed, overrides_of(unit_m, simplify_m, up)); },
          "spec"_a, "preset"_a, "settings"_a, "rate_hz"_a.none(), "seed"_a.none(), "unit_m"_a.none(), "simplify_m"_a.none(), "up"_a,
          released)
      .def_prop_ro("name", [](const SceneModel& s) { return s.scene().name(); })
      .def_prop_ro("hash", [](const SceneModel& s) { return s.scene().hash(); })
      .def_prop_ro("num_triangles", [](const SceneModel& s) { return s.scene().mesh().triangles.size(); })
      .def_prop_ro("warnings", &SceneModel::warnings)
      .def_prop_ro("bounds",
                   [](const SceneModel& s) {
                     const Bounds& bounds = s.scene().bounds();
                     return std::tuple(triple(s.scene().to_world(bounds.lower)), triple(s.scene().to_world(bounds.upper)));
                   })
      .def_prop_ro("sample_rate_hz", [](const SceneModel& s) { return static_cast<double>(s.config().sample_rate_hz); })
      .def_prop_ro("seed", [](const SceneModel& s) { return s.config().seed; })
      .def(
          "rir_length_s", [](SceneModel& s) { return static_cast<double>(s.acoustics(s.config().sh_order)->config().rir_length_s); },
          released)
      .def(
          "bands_hz", [](SceneModel& s) { return s.acoustics(s.config().sh_order)->bands().centre_hz; }, released)
      .def("plan", &plan_of)
      .def("random_positions", &random_places, "count"_a, "height_m"_a, "seed"_a);

  nb::class_<SourceModel>(m, "SourceModel")
      .def(
          "__init__",
          [](SourceModel* self, std::shared_ptr<SceneModel> scene, double x, double y, double z, const std::string& pattern,
             double heading_deg, double pitch_deg, double radius_m) {
            new (self) SourceModel(std::move(scene), {x, y, z}, pattern, heading_deg, pitch_deg, radius_m);
          },
          "scene"_a, "x"_a, "y"_a, "z"_a, "pattern"_a, "heading_deg"_a, "pitch_deg"_a, "radius_m"_a)
      .def("render", &render_all, "positions"_a, "angles_deg"_a, "channels"_a, "hrtf"_a, "threads"_a)
      .def("respond", &respond_all, "positions"_a, "channels"_a, "threads"_a)
      .def("plan_accuracy", &plan_accuracy, "target"_a, "positions"_a, "responses"_a);
}

}  // namespace earshot::python
