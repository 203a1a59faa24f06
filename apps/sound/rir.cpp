// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <iterator>
#include <memory>
#include <optional>
#include <set>
#include <string_view>

#include "apps/commands.h"
#include "apps/options/accuracy_planning.h"
#include "apps/options/acoustic_options.h"
#include "apps/options/output_options.h"
#include "apps/options/parameter_options.h"
#include "apps/options/parse_point.h"
#include "apps/options/print_warning.h"
#include "apps/options/source_options.h"
#include "apps/sound/echogram_svg.h"
#include "apps/sound/late_edges_option.h"
#include "apps/sound/rir_json.h"
#include "datasets/rir_corpus_response.h"
#include "sim/acoustics/metrics/response_series.h"
#include "sim/acoustics/response/place_check.h"
#include "sim/acoustics/source_field/field_for_poses.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/output_paths.h"
#include "sim/base/process/progress.h"
#include "sim/base/text/json.h"
#include "sim/scene/checks/scene_check.h"

namespace earshot {
namespace {

struct RirArguments {
  AcousticOptions acoustics;
  SourceOptions radiation;
  std::vector<std::string> sources, listeners;
  std::vector<double> heading_deg = {0};
  double pitch_deg = 0, roll_deg = 0;
  std::string out, metrics, plot;
  ParameterOptions parameters;
  double gain = 1;
  bool components = false, late_edges = false;
};

/// A part of a response: kinds of arrivals, and whether the late field is included.
struct Component {
  const char* name;
  std::optional<ArrivalKind> kind;  ///< nullopt: the late field
};
constexpr std::array<Component, 5> kComponents{{{"direct", ArrivalKind::direct},
                                                {"early", ArrivalKind::reflection},
                                                {"diffracted", ArrivalKind::diffraction},
                                                {"transmitted", ArrivalKind::transmission},
                                                {"late", std::nullopt}}};

std::string with_suffix(const std::string& file, const std::string& suffix) {
  std::filesystem::path path = file;
  path.replace_extension(suffix + path.extension().string());
  return path.string();
}

bool is_single(const RirArguments& options) { return options.sources.size() == 1 && options.listeners.size() == 1; }

std::string wav_of(const RirArguments& options, std::size_t source, std::size_t listener) {
  return is_single(options) ? options.out : with_suffix(options.out, fmt::format(".s{}.l{}", source, listener));
}

std::string plot_of(const RirArguments& options, const std::string& wav) {
  return is_single(options) ? options.plot : std::filesystem::path(wav).replace_extension(".svg").string();
}

/// Every file that is written.
std::vector<OutputPath> outputs_of(const RirArguments& options) {
  std::vector<OutputPath> outputs;
  if (!options.metrics.empty()) outputs.push_back({"--metrics", options.metrics});
  for (std::size_t s = 0; s < options.sources.size(); ++s)
    for (std::size_t l = 0; l < options.listeners.size(); ++l) {
      const std::string wav = wav_of(options, s, l);
      outputs.push_back({"--out", wav});
      if (!options.plot.empty()) outputs.push_back({"--plot", plot_of(options, wav)});
      for (const Component& component : kComponents)
        if (options.components) outputs.push_back({"--components", with_suffix(wav, fmt::format(".{}", component.name))});
    }
  return outputs;
}

/// The response with everything but one part silenced.  Silent arrivals stay, because the late field begins no earlier than the direct one.
EnergyResponse part_of(const EnergyResponse& response, const Component& component) {
  EnergyResponse part = response;
  for (Arrival& arrival : part.arrivals)
    if (arrival.kind != component.kind) arrival.amplitude.fill(0.f);
  if (component.kind) part.late.scale(0.f);
  return part;
}

OrderedJson effects_json(const EnergyResponse& response, const AcousticConfig& config) {
  OrderedJson json = OrderedJson::object();
  for (const Component& component : kComponents) {
    std::size_t count = 0;
    for (const Arrival& arrival : response.arrivals) count += arrival.kind == component.kind;
    if (component.kind)
      json[component.name] = fmt::format("{} path{}", count, count == 1 ? "" : "s");
    else
      json[component.name] = response.stats.rays == 0
                                 ? std::string("off")
                                 : fmt::format("{} {}", response.stats.rays, response.effects.field_gathers > 0 ? "photons" : "rays");
  }
  json["air_absorption"] = config.air_absorption == Switch::off ? "off" : "on";
  return json;
}

/// One source and one listener: WAV files, and their part of the metrics file.
class PairRenderer {
 public:
  PairRenderer(const RirArguments& options, const AcousticScene& acoustics)
      : options_(options), synthesizer_(options.acoustics.tables(acoustics)) {
    if (!options.metrics.empty() && options.acoustics.layout().kind != ListenerKind::mono)
      omni_.emplace(AcousticOptions::omni_tables(acoustics));
  }

  /// planned: the response that the synthesizer's tables fit.  field: of the source; null: the late field is traced.  warnings: of the
  /// scene and places.
  OrderedJson render(const AcousticScene& planned, const EarlyCandidates& candidates, const SourceField* field, glm::vec3 listener,
                     double heading_deg, const std::string& file, std::vector<std::string> warnings) {
    const ListenerOrientation orientation = options_.acoustics.orientation(heading_deg, options_.pitch_deg, options_.roll_deg);
    const auto begin = std::chrono::steady_clock::now();
    EnergyResponse response;
    constexpr std::uint64_t steps = 1000;
    Progress progress("rir", "permille", steps);
    compute_energy_response(planned, candidates, field, listener, response,
                            [&](double fraction) { progress.update(static_cast<std::uint64_t>(fraction * steps)); });
    Rir rir;
    const CarrierKey key(carrier_key(planned.hash(), candidates.source()), listener);
    synthesizer_.render(response, orientation, key, rir);
    const double render_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
    write(file, rir);
    if (options_.components) {
      Rir part;
      for (const Component& component : kComponents) {
        synthesizer_.render(part_of(response, component), orientation, key, part);
        write(with_suffix(file, fmt::format(".{}", component.name)), part);
      }
    }
    ParameterRequest request = options_.parameters.request();
    request.lateral_axis = lateral_axis(candidates.source(), listener);
    const RoomMetrics energy = measure(planned, response, request);
    print(file, rir, response, energy, render_ms);
    LateEdges edges;
    if (options_.late_edges) print_late_edges(edges = late_edges(planned, candidates.sound_source(), listener), energy.bands_hz);
    for (const std::string& warning : warnings_of(planned, candidates.source(), listener, response)) {
      print_warning(warning);
      warnings.push_back(warning);
    }
    if (!options_.plot.empty()) write_plot(planned, file, response);
    if (options_.metrics.empty()) return {};
    const glm::dvec3 origin = planned.scene().origin_m();
    const ListenerLayout layout = options_.acoustics.layout();
    OrderedJson json{{"bands_hz", energy.bands_hz},
                     {"origin_m", {origin.x, origin.y, origin.z}},
                     {"channels", layout.channel_names()},
                     {"energy", metrics_json(energy, request)}};
    Rir omni;
    if (omni_) omni_->render(response, orientation, key, omni);
    add_sample_metrics(omni_ ? omni : rir, rir, layout, layout.channel_names(), reading_of(planned, response, energy, request, rir), json);
    const RenderEars render_ears = [&](const EnergyResponse& heard, std::uint64_t carriers, Rir& ears) {
      synthesizer_.render(heard, orientation, {key.source ^ (carriers * kCarrierStep), listener}, ears);
    };
    const MetricErrors errors = standard_errors(planned, candidates, field, listener, response, request,
                                                layout.kind == ListenerKind::binaural ? render_ears : RenderEars());
    json.update({{"drr_db", number_or_null(energy.drr_db)},
                 {"direct_delay_s", number_or_null(energy.direct_delay_s)},
                 {"direct_amplitude", number_or_null(energy.direct_amplitude)},
                 {"ray_efficiency", response.stats.ray_efficiency()},
                 {"standard_error", standard_errors_json(errors, field != nullptr, request)},
                 {"render_ms", render_ms},
                 {"effects", effects_json(response, planned.config())},
                 {"warnings", warnings},
                 {"seed", planned.config().seed}});
    if (options_.late_edges) add_late_edges(edges, json);
    return json;
  }

 private:
  /// Time zero of samples is that of the energy response, at the latest their last one.
  [[nodiscard]] static RirMeasurement reading_of(const AcousticScene& planned, const EnergyResponse& response, const RoomMetrics& energy,
                                                 const ParameterRequest& request, const Rir& rir) {
    const double last_s = (rir.num_samples - 1) / static_cast<double>(rir.sample_rate_hz);
    RirMeasurement how{.direct_delay_s = std::min(energy.first_arrival_s.value_or(0.0), last_s),
                       .has_direct = energy.direct_delay_s.has_value(),
                       .low_octave = planned.config().low_octave,
                       .request = request,
                       .is_green = true};
    for (const Arrival& arrival : response.arrivals)
      if (arrival.kind == ArrivalKind::direct) how.distance_m = static_cast<double>(arrival.distance_m);
    return how;
  }
  /// A response without any sound, and what was not finite: with all that it takes to see it again.
  [[nodiscard]] static std::vector<std::string> warnings_of(const AcousticScene& planned, glm::vec3 source, glm::vec3 listener,
                                                            const EnergyResponse& response) {
    const auto text = [&](glm::vec3 place) {
      const glm::dvec3 p = planned.scene().to_world(place);
      return fmt::format("{},{},{}", p.x, p.y, p.z);
    };
    std::vector<std::string> warnings;
    if (response.arrivals.empty() && std::ranges::all_of(response.late.values(), [](float energy) { return energy == 0.f; }))
      warnings.push_back(fmt::format("the response is silent: no sound of source {} reaches listener {}", text(source), text(listener)));
    if (response.stats.nonfinite_dropped > 0)
      warnings.push_back(
          fmt::format("{} contributions are not finite and were left out; please report them: scene {}, source {}, listener {}, seed {}",
                      response.stats.nonfinite_dropped, planned.scene().name(), text(source), text(listener), planned.config().seed));
    return warnings;
  }
  void write(const std::string& file, const Rir& rir) const {
    std::vector<float> samples = rir.samples;
    for (float& sample : samples) sample *= static_cast<float>(options_.gain);
    write_wav(file, samples, rir.num_channels, rir.sample_rate_hz, rir.channel_mask);
  }
  void write_plot(const AcousticScene& planned, const std::string& file, const EnergyResponse& response) const {
    write_file_atomically(plot_of(options_, file),
                          echogram_svg(fmt::format("{}, {} rays", planned.scene().name(), planned.config().rays), planned, response));
  }
  static void print(const std::string& file, const Rir& rir, const EnergyResponse& response, const RoomMetrics& energy, double render_ms) {
    fmt::print("{}: {} channels, {} samples at {:.0f} Hz, {} arrivals, ray efficiency {:.3f}, {:.1f} ms\n", file, rir.num_channels,
               rir.num_samples, rir.sample_rate_hz, response.arrivals.size(), response.stats.ray_efficiency(), render_ms);
    for (std::size_t b = 0; b < energy.bands.size(); ++b)
      fmt::print("  {:>6.0f} Hz  RT60 {}  DRR {}\n", energy.bands_hz[b],
                 energy.bands[b].rt60_s ? fmt::format("{:.3f} s", *energy.bands[b].rt60_s) : "-",
                 energy.bands[b].drr_db ? fmt::format("{:.2f} dB", *energy.bands[b].drr_db) : "-");
  }

  const RirArguments& options_;
  RirSynthesizer synthesizer_;
  std::optional<RirSynthesizer> omni_;  ///< of metrics if no channel is an omnidirectional microphone
};

std::shared_ptr<const SourceField> field_of(const AcousticScene& acoustics, const EarlyCandidates& candidates, std::size_t responses) {
  Progress progress("source field", "%", 100);
  return field_for_poses(acoustics, candidates, responses,
                         [&](double fraction) { progress.update(static_cast<std::uint64_t>(100 * fraction)); });
}

/// Of every pair of a source and a listener, source by source; throws InputError before anything is written.
std::vector<std::vector<std::string>> check_places(const AcousticScene& acoustics, const std::vector<SoundSource>& sources,
                                                   const std::vector<glm::vec3>& listeners) {
  const PlaceCheck check(acoustics);
  std::vector<std::vector<std::string>> warnings;
  for (const SoundSource& source : sources) {
    for (const glm::vec3 listener : listeners) {
      const NamedPlace from{"source", source.position}, to{"listener", listener};
      std::vector<std::string>& of_pair = warnings.emplace_back(check.check(from, to));
      for (const NamedPlace& place : {from, to})
        if (auto line = check.inside_solid(place)) of_pair.push_back(std::move(*line));
    }
  }
  return warnings;
}

/// Each line once: warnings about a source are the same for all listeners.
void print_warnings(const std::vector<std::string>& odd_in_scene, const std::vector<std::vector<std::string>>& place_warnings) {
  for (const std::string& warning : odd_in_scene) print_warning(warning);
  std::set<std::string_view> printed;
  for (const std::vector<std::string>& of_pair : place_warnings)
    for (const std::string& warning : of_pair)
      if (printed.insert(warning).second) print_warning(warning);
}

/// That of the options; lateral parameters ask for harmonics that --set may lower again.
AcousticConfig config_of(const RirArguments& options) {
  if (options.parameters.request().any() && options.metrics.empty())
    throw InputError("--parameters", "has no effect without a file for them", "add --metrics FILE");
  if (options.parameters.request().interaural && options.acoustics.layout().kind != ListenerKind::binaural)
    throw InputError("--parameters", "interaural needs two ears", "use --channels binaural");
  AcousticOptions acoustics = options.acoustics;
  if (options.parameters.request().lateral) acoustics.least_order = AxisWeight::needed_order(AxisWeight::Kind::cosine);
  return acoustics.config();
}

void run_rir(const RirArguments& options) {
  options.acoustics.refuse_settings({"temporal_reuse", "glide_paths"}, "has no effect on single responses",
                                    "leave it out, or use it with 'earshot walk'");
  require(std::isfinite(options.gain), "--gain", options.gain, "must be a finite number");
  for (const double heading_deg : options.heading_deg)
    (void)options.acoustics.orientation(heading_deg, options.pitch_deg, options.roll_deg);  // before any work
  check_outputs(outputs_of(options));
  if (options.heading_deg.size() != 1 && options.heading_deg.size() != options.listeners.size())
    throw InputError("--heading", fmt::format("is given {} times for {} listeners", options.heading_deg.size(), options.listeners.size()),
                     "give it once for all or once per listener");
  const AcousticConfig config = config_of(options);
  if (options.late_edges) check_late_edges(config);
  const std::optional<AccuracyTarget> target = options.acoustics.accuracy_target();
  std::vector<glm::dvec3> listeners, source_points;
  std::vector<SoundSource> sources;
  for (const std::string& listener : options.listeners) listeners.push_back(parse_point(listener, "--listener"));
  for (std::size_t i = 0; i < options.sources.size(); ++i) {
    source_points.push_back(parse_point(options.sources[i], "--source"));
    sources.push_back(options.radiation.source(i, options.sources.size(), glm::vec3(0)));
  }
  const AcousticScene acoustics = options.acoustics.load(config);
  const Scene& scene = acoustics.scene();
  for (std::size_t i = 0; i < sources.size(); ++i) sources[i].position = scene.to_local(source_points[i]);
  std::vector<glm::vec3> places;
  for (const glm::dvec3 listener : listeners) places.push_back(scene.to_local(listener));

  const std::vector<std::vector<std::string>> place_warnings = check_places(acoustics, sources, places);
  const std::vector<std::string> odd_in_scene = scene_warnings(scene);
  PairRenderer renderer(options, acoustics);  // errors of its files appear before the slow planner runs
  std::vector<std::optional<AccuracyPlan>> plans(sources.size());
  for (std::size_t s = 0; target && s < sources.size(); ++s)
    plans[s] = plan_and_print(acoustics, *target, sources[s], places, static_cast<double>(places.size()));

  print_warnings(odd_in_scene, place_warnings);
  const bool single = is_single(options);
  OrderedJson pairs = OrderedJson::array();
  for (std::size_t s = 0; s < sources.size(); ++s) {
    const std::optional<AccuracyPlan>& plan = plans[s];
    const AcousticScene planned = plan ? planned_scene(acoustics, *plan) : acoustics;
    const EarlyCandidates candidates(planned, sources[s]);
    const std::shared_ptr<const SourceField> field = field_of(planned, candidates, listeners.size());
    for (std::size_t l = 0; l < listeners.size(); ++l) {
      const double heading_deg = options.heading_deg[options.heading_deg.size() == 1 ? 0 : l];
      std::vector<std::string> warnings = odd_in_scene;
      std::ranges::copy(place_warnings[s * places.size() + l], std::back_inserter(warnings));
      OrderedJson pair =
          renderer.render(planned, candidates, field.get(), places[l], heading_deg, wav_of(options, s, l), std::move(warnings));
      if (plan && !pair.is_null()) pair["accuracy"] = accuracy_json(*target, *plan);
      if (single) {
        pairs = std::move(pair);
        continue;
      }
      pair["source"] = s;
      pair["listener"] = l;
      pairs.push_back(std::move(pair));
    }
  }
  if (!options.metrics.empty()) {
    OrderedJson report{{"schema_version", 1}};
    report.update(single ? pairs : OrderedJson{{"pairs", pairs}});
    write_file_atomically(options.metrics, json_text(report, 1) + "\n");
  }
}

}  // namespace

void add_rir(CLI::App& app) {
  auto options = std::make_shared<RirArguments>();
  CLI::App* command = app.add_subcommand("rir", "Compute room impulse responses between points of a scene");
  options->acoustics.add_to(*command, "balanced");
  options->acoustics.add_accuracy_to(*command);
  command->add_option("--source", options->sources, "Position of a source: X,Y,Z in metres; may be repeated")->required();
  command->add_option("--listener", options->listeners, "Position of a listener between the ears: X,Y,Z in metres; may be repeated")
      ->required();
  command
      ->add_option(
          "--heading", options->heading_deg,
          "Heading of the listener in degrees, counter-clockwise from -z seen from above; once for all listeners or once per listener")
      ->capture_default_str()
      ->delimiter(',');
  command->add_option("--pitch", options->pitch_deg, "Pitch of the listener in degrees, positive is up")->capture_default_str();
  command->add_option("--roll", options->roll_deg, "Roll of the listener in degrees, positive moves the right ear down")
      ->capture_default_str();
  options->radiation.add_to(*command);
  command
      ->add_option("--out", options->out,
                   "WAV file to write (32-bit float; a unit source has pressure 1 / (4 pi r)). With several sources or listeners: "
                   "OUT.s0.l0.wav and so on")
      ->type_name(kOutputFile)
      ->required();
  command->add_option("--gain", options->gain, "Factor applied to the samples of WAV files")->capture_default_str();
  command
      ->add_option("--metrics", options->metrics,
                   "JSON file to write, with room-acoustic parameters per band (several pairs: a list under \"pairs\")")
      ->type_name(kOutputFile);
  options->parameters.add_to(
      *command,
      "Further parameters in the metrics file, with their standard errors: lateral (J_LF, J_LFC, LG), stage (ST_early, ST_late, "
      "of a listener at 1 m), speech (MTI, STI), interaural (errors of IACC)");
  command
      ->add_option("--plot", options->plot,
                   "SVG plot to write: arrivals by kind, late field and decay of each band (several pairs: one file next to each WAV)")
      ->type_name(kOutputFile);
  command->add_flag(
      "--components", options->components,
      "Also write OUT.direct.wav, OUT.early.wav, OUT.diffracted.wav, OUT.transmitted.wav and OUT.late.wav, whose sum is the response");
  command->add_flag("--late-edges", options->late_edges,
                    "Also print per band how much late sound goes round edges, which traced rays do not: an estimate, 0.1 to 0.5 s");
  command->callback([options] { run_rir(*options); });
}

}  // namespace earshot
