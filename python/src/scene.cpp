// SPDX-License-Identifier: Apache-2.0
// Scenes, sources, batches of responses.
#include "earshot/scene.h"

#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <tuple>
#include <utility>

#include "python/src/interruptible.h"

namespace earshot::python {
namespace {

using Numbers = Input<double>;

std::vector<Listener> listeners_of(const Numbers& positions, const Numbers& angles_deg) {
  if (positions.ndim() != 2 || positions.shape(1) != 3 || angles_deg.ndim() != 2 || angles_deg.shape(1) != 3 ||
      positions.shape(0) != angles_deg.shape(0))
    throw InputError("listeners", "have a wrong shape", "give positions [n, 3] and as many angles [n, 3]");
  std::vector<Listener> listeners(positions.shape(0));
  for (std::size_t i = 0; i < listeners.size(); ++i) {
    const double *at = positions.data() + 3 * i, *angle = angles_deg.data() + 3 * i;
    listeners[i] = {{at[0], at[1], at[2]}, angle[0], angle[1], angle[2]};
  }
  return listeners;
}

std::vector<Vec3> places_of(const Numbers& positions) {
  if (positions.ndim() != 2 || positions.shape(1) != 3) throw InputError("listeners", "have a wrong shape", "give positions [n, 3]");
  std::vector<Vec3> places(positions.shape(0));
  for (std::size_t i = 0; i < places.size(); ++i)
    places[i] = {positions.data()[3 * i], positions.data()[3 * i + 1], positions.data()[3 * i + 2]};
  return places;
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

std::tuple<double, double, double> triple(const Vec3& v) { return {v.x, v.y, v.z}; }

Array<double> random_places(const Scene& scene, int count, double height_m, std::uint64_t seed) {
  std::vector<double> numbers = interruptible([=, scene = scene](const std::stop_token& stop) {
    std::vector<double> drawn;
    for (const Vec3& place : scene.random_positions(count, {height_m, seed, stop})) drawn.insert(drawn.end(), {place.x, place.y, place.z});
    return drawn;
  });
  const std::size_t rows = numbers.size() / 3;
  return array_of(std::move(numbers), {rows, 3});
}

nb::list plan_of(const Scene& scene) {
  nb::list plan;
  for (const EffectDecision& line : interruptible([scene = scene](const std::stop_token&) { return scene.plan(); }))
    plan.append(nb::make_tuple(line.effect, line.decision, line.on, line.change, line.unit, line.kind, line.saved_ms, line.why));
  return plan;
}

/// [segments, 2, 3]
Array<double> section_of(const Scene& scene, double height_m) {
  std::vector<double> numbers = interruptible([height_m, scene = scene](const std::stop_token&) {
    std::vector<double> ends;
    for (const auto& segment : scene.section(height_m))
      for (const Vec3& end : segment) ends.insert(ends.end(), {end.x, end.y, end.z});
    return ends;
  });
  const std::size_t rows = numbers.size() / 6;
  return array_of(std::move(numbers), {rows, 2, 3});
}

Array<float> render_all(const Source& source, const Numbers& positions, const Numbers& angles_deg, const std::string& channels,
                        const std::string& hrtf, int threads) {
  return rirs_of(interruptible([=, source = source, listeners = listeners_of(positions, angles_deg)](const std::stop_token& stop) {
    return source.render_all(listeners, {channels, hrtf, threads, stop});
  }));
}

nb::dict dict_of(const AccuracyChoice& choice) {
  nb::dict dict;
  dict["method"] = choice.method;
  dict["settings"] = choice.settings.texts();
  dict["predicted"] = choice.predicted;
  dict["per_source_ms"] = choice.per_source_ms;
  dict["per_response_ms"] = choice.per_response_ms;
  return dict;
}

nb::dict plan_accuracy(const Source& source, const std::string& target, const Numbers& positions, double responses) {
  const AccuracyPlan plan = interruptible([=, source = source, places = places_of(positions)](const std::stop_token& stop) {
    return source.plan_accuracy(target, places, responses, stop);
  });
  nb::list tried;
  for (const AccuracyChoice& choice : plan.tried) tried.append(dict_of(choice));
  nb::dict dict;
  dict["tried"] = tried;
  dict["chosen"] = plan.chosen;
  dict["reference_error"] = plan.reference_error;
  dict["calibration_s"] = plan.calibration_s;
  return dict;
}

std::vector<Response> respond_all(const Source& source, const Numbers& positions, const std::string& channels, int threads) {
  return interruptible([=, source = source, places = places_of(positions)](const std::stop_token& stop) {
    return source.responses(places, {.channels = channels, .threads = threads, .stop = stop});
  });
}

/// Path and hash of each file.
std::vector<std::pair<std::string, std::uint64_t>> files_of(const std::string& channels) {
  std::vector<std::pair<std::string, std::uint64_t>> pairs;
  for (const InputFile& file : interruptible([channels](const std::stop_token&) { return files_of_channels(channels); }))
    pairs.emplace_back(file.name, file.hash);
  return pairs;
}

}  // namespace

void bind_scene(nb::module_& m) {
  using namespace nb::literals;
  m.def("files_of_channels", &files_of, "channels"_a);
  nb::class_<Scene>(m, "SceneModel")
      .def(
          "__init__",
          [](Scene* self, const std::string& spec, const std::string& preset, const std::vector<std::string>& settings,
             std::optional<double> rate_hz, std::optional<std::uint64_t> seed, std::optional<double> unit_m,
             std::optional<double> simplify_m, const std::string& up, std::optional<double> cell_m) {
            new (self) Scene(interruptible([=](const std::stop_token&) {
              return Scene(spec, {preset, Settings(settings), rate_hz, seed, unit_m, simplify_m, up, cell_m});
            }));
          },
          "spec"_a, "preset"_a, "settings"_a, "rate_hz"_a.none(), "seed"_a.none(), "unit_m"_a.none(), "simplify_m"_a.none(), "up"_a,
          "cell_m"_a.none())
      .def_prop_ro("name", &Scene::name)
      .def_prop_ro("hash", &Scene::hash)
      .def_prop_ro("num_triangles", &Scene::num_triangles)
      .def_prop_ro("warnings", &Scene::warnings)
      .def_prop_ro("bounds", [](const Scene& s) { return std::tuple(triple(s.bounds().lower), triple(s.bounds().upper)); })
      .def_prop_ro("sample_rate_hz", &Scene::sample_rate_hz)
      .def_prop_ro("seed", &Scene::seed)
      .def("rir_length_s",
           [](const Scene& scene) { return interruptible([scene](const std::stop_token&) { return scene.rir_length_s(); }); })
      .def("bands_hz", [](const Scene& scene) { return interruptible([scene](const std::stop_token&) { return scene.bands_hz(); }); })
      .def("plan", &plan_of)
      .def("section", &section_of, "height_m"_a)
      .def("random_positions", &random_places, "count"_a, "height_m"_a, "seed"_a);

  nb::class_<Source>(m, "SourceModel")
      .def(
          "__init__",
          [](Source* self, const Scene& scene, double x, double y, double z, const std::string& pattern, double heading_deg,
             double pitch_deg, double radius_m) {
            new (self) Source(interruptible([=](const std::stop_token&) {
              return scene.source({x, y, z}, {pattern, heading_deg, pitch_deg, radius_m});
            }));
          },
          "scene"_a, "x"_a, "y"_a, "z"_a, "pattern"_a, "heading_deg"_a, "pitch_deg"_a, "radius_m"_a)
      .def("render", &render_all, "positions"_a, "angles_deg"_a, "channels"_a, "hrtf"_a, "threads"_a)
      .def("respond", &respond_all, "positions"_a, "channels"_a, "threads"_a)
      .def("plan_accuracy", &plan_accuracy, "target"_a, "positions"_a, "responses"_a);
}

}  // namespace earshot::python
