// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>

#include "apps/commands.h"
#include "apps/options/accuracy_planning.h"
#include "apps/options/acoustic_options.h"
#include "apps/options/output_options.h"
#include "apps/options/parse_point.h"
#include "apps/options/print_warning.h"
#include "apps/options/source_options.h"
#include "apps/options/timed_path.h"
#include "apps/sound/walk_places.h"
#include "apps/sound/walk_source.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/source_field/field_for_poses.h"
#include "sim/acoustics/source_field/source_field_store.h"
#include "sim/acoustics/synthesis/path_glide.h"
#include "sim/acoustics/synthesis/synthesis_tables.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/audio/stream/sound_stream.h"
#include "sim/base/errors.h"
#include "sim/base/process/progress.h"
#include "sim/base/text/log.h"
#include "sim/scene/checks/scene_check.h"

namespace earshot {
namespace {

struct WalkArguments {
  AcousticOptions acoustics;
  SourceOptions radiation;
  std::vector<std::string> sources, source_paths, sounds;
  std::string poses, out, field_store;
  double step_s = 0.05, field_store_gb = 20;
  int refine_every = 0;
};

/// The reference (preset `high`) stays without reuse unless the user sets it: there a response depends on its pose alone.
WalkLateSound choose_late_sound(const AcousticScene& acoustics, bool moving, int refine_every) {
  const AcousticConfig& config = acoustics.config();
  if (!moving && uses_source_field(acoustics)) return refine_every > 0 ? WalkLateSound::refined : WalkLateSound::gathered;
  const bool listener_rooted = config.source_rays == 0 && config.specular_exponent == 0.f;
  const bool reuse = config.temporal_reuse == Switch::on || (config.temporal_reuse == Switch::automatic && moving && listener_rooted);
  return reuse ? WalkLateSound::reused : WalkLateSound::traced;
}

/// From where the file of the scene has it to where the scene has it.
void shift(std::vector<TimedPose>& path, const Scene& scene) {
  for (TimedPose& pose : path) pose.position -= scene.origin_m();
}

std::vector<WalkSource> make_sources(const WalkArguments& options, const AcousticScene& acoustics, int block_samples) {
  const std::size_t count = options.sources.size() + options.source_paths.size();
  if (count == 0)
    throw InputError("--source", "is missing", "give a static source with --source X,Y,Z or a moving one with --source-path FILE.csv");
  if (options.sounds.size() != 1 && options.sounds.size() != count)
    throw InputError("--sound", fmt::format("is given {} times for {} sources", options.sounds.size(), count),
                     "give it once for all or once per source");
  std::vector<WalkSource> sources;
  for (std::size_t i = 0; i < count; ++i) {
    const bool moving = i >= options.sources.size();
    std::vector<TimedPose> path;
    if (moving)
      path = read_timed_path(options.source_paths[i - options.sources.size()]);
    else
      path = {{.t_s = 0, .position = parse_point(options.sources[i], "--source"), .heading_deg = 0}};
    shift(path, acoustics.scene());
    SoundSource at_start = options.radiation.source(i, count, glm::vec3(path[0].position));
    SoundClip clip = open_sound(options.sounds.size() == 1 ? options.sounds[0] : options.sounds[i], acoustics.config().sample_rate_hz);
    const WalkLateSound late = choose_late_sound(acoustics, moving, options.refine_every);
    sources.emplace_back(WalkSourceSetup{.path = std::move(path),
                                         .at_start = std::move(at_start),
                                         .moving = moving,
                                         .late = late,
                                         .refine_every = options.refine_every,
                                         .clip = std::move(clip),
                                         .scene_hash = acoustics.hash()},
                         block_samples);
  }
  return sources;
}

/// The scene as the plan for --accuracy has it: one source at rest, poses as the listener takes them.
AcousticScene planned(const WalkArguments& options, const AcousticScene& acoustics, const AccuracyTarget& target,
                      const std::vector<TimedPose>& poses, std::size_t num_moments) {
  if (options.sources.size() != 1 || !options.source_paths.empty())
    throw InputError("--accuracy", "works with one static source only", "give a single --source, or leave out --accuracy");
  if (options.refine_every > 0 || acoustics.config().temporal_reuse == Switch::on)
    throw InputError("--accuracy", "cannot be combined with --refine-every or temporal_reuse=on", "leave out either these or --accuracy");
  static_cast<void>(make_sources(options, acoustics, 1));  // errors of its sounds appear before the slow planner runs
  SoundSource source = options.radiation.source(0, 1, acoustics.scene().to_local(parse_point(options.sources[0], "--source")));
  std::vector<glm::vec3> places;
  for (std::size_t i = 0; i < num_moments; ++i) {
    const double fraction = static_cast<double>(i) / static_cast<double>(num_moments - 1);
    places.emplace_back(pose_at(poses, poses.front().t_s + fraction * (poses.back().t_s - poses.front().t_s)).position);
  }
  return planned_scene(acoustics, plan_and_print(acoustics, target, source, places, static_cast<double>(num_moments)));
}

/// The poses of a walk and the blocks of its sound.
struct WalkTimes {
  std::vector<TimedPose> poses;  ///< in the coordinates of the scene, once it is known
  float sample_rate_hz = 0;
  std::size_t num_samples = 0, num_blocks = 0;
  int block_samples = 0;

  [[nodiscard]] double duration_s() const { return poses.back().t_s - poses.front().t_s; }
  [[nodiscard]] double time_s(std::size_t sample) const {
    return poses.front().t_s + static_cast<double>(sample) / static_cast<double>(sample_rate_hz);
  }
  /// The sample behind the first `num` blocks; the last block may be shorter.
  [[nodiscard]] std::size_t end_of_block(std::size_t num) const {
    return std::min(num * static_cast<std::size_t>(block_samples), num_samples);
  }
};

WalkTimes times_of(const WalkArguments& options, float sample_rate_hz) {
  WalkTimes times{.poses = read_timed_path(options.poses), .sample_rate_hz = sample_rate_hz};
  const double rate_hz{sample_rate_hz};
  times.block_samples = std::max(1, static_cast<int>(std::lround(options.step_s * rate_hz)));
  constexpr double longest_s = 3600;
  if (!(times.duration_s() * rate_hz >= 1 && times.duration_s() <= longest_s))
    throw InputError(options.poses, fmt::format("lasts {} s", times.duration_s()),
                     fmt::format("use a time range t_s of at least one sample and at most {} s", longest_s));
  const auto block = static_cast<std::size_t>(times.block_samples);
  times.num_samples = static_cast<std::size_t>(std::lround(times.duration_s() * rate_hz));
  times.num_blocks = (times.num_samples + block - 1) / block;
  return times;
}

/// Warnings about the scene, and about the places at the ends of the blocks.
std::vector<std::string> find_oddities(const WalkArguments& options, const AcousticScene& acoustics, const WalkTimes& times) {
  std::vector<std::vector<TimedPose>> sources;
  for (const std::string& source : options.sources) sources.push_back({{.t_s = 0, .position = parse_point(source, "--source")}});
  for (const std::string& path : options.source_paths) sources.push_back(read_timed_path(path));
  for (std::vector<TimedPose>& path : sources) shift(path, acoustics.scene());
  std::vector<double> times_s;
  for (std::size_t i = 0; i <= times.num_blocks; ++i) times_s.push_back(times.time_s(times.end_of_block(i)));
  std::vector<std::string> warnings = check_walk_places(acoustics, times.poses, sources, times_s);
  const std::vector<std::string> of_scene = scene_warnings(acoustics.scene());
  warnings.insert(warnings.begin(), of_scene.begin(), of_scene.end());
  return warnings;
}

/// The sum of all sources along the walk, [num_channels, num_samples].
std::vector<float> render(const WalkArguments& options, const WalkTimes& times, const AcousticScene& acoustics,
                          const std::shared_ptr<const SynthesisTables>& tables, std::vector<WalkSource>& sources) {
  RirSynthesizer synthesizer(tables);
  PathGlider glider(tables, times.block_samples);
  const auto moment_at = [&](std::size_t sample) {
    const double t_s = times.time_s(sample);
    const TimedPose listener = pose_at(times.poses, t_s);
    return WalkMoment{
        .t_s = t_s, .listener = glm::vec3(listener.position), .orientation = options.acoustics.orientation(listener.heading_deg, 0, 0)};
  };
  for (WalkSource& source : sources) source.begin(acoustics, synthesizer, glider, moment_at(0));
  const auto num_channels = static_cast<std::size_t>(options.acoustics.layout().num_channels());
  std::vector<float> sound(times.num_samples * num_channels), mix;
  Progress progress("walk", "block", times.num_blocks);
  for (std::size_t i = 0; i < times.num_blocks; ++i) {
    const std::size_t first = times.end_of_block(i), count = times.end_of_block(i + 1) - first;
    mix.assign(count * num_channels, 0.f);
    const WalkMoment end = moment_at(first + count);
    for (WalkSource& source : sources)
      source.add_block(acoustics, synthesizer, glider, end, {.index = i, .num_samples = static_cast<int>(count)}, mix);
    for (std::size_t c = 0; c < num_channels; ++c)
      std::copy_n(mix.begin() + static_cast<std::ptrdiff_t>(c * count), count,
                  sound.begin() + static_cast<std::ptrdiff_t>(c * times.num_samples + first));
    progress.update(i + 1);
  }
  return sound;
}

void run_walk(const WalkArguments& options) {
  require(options.step_s > 0 && options.step_s <= 1, "--step", options.step_s, "must be in (0, 1] s");
  require(options.refine_every >= 0, "--refine-every", options.refine_every, "must not be negative");
  require(options.field_store_gb >= 0 && options.field_store_gb <= 1e9, "--field-store-gb", options.field_store_gb, "must be in [0, 1e9]");
  AcousticConfig config = options.acoustics.config();
  WalkTimes times = times_of(options, config.sample_rate_hz);
  const std::size_t num_moments = times.num_blocks + 1;

  const std::optional<AccuracyTarget> target = options.acoustics.accuracy_target();
  config.field = field_switch_for_poses(config.field, options.source_paths.empty() ? num_moments : 0);
  const AcousticScene loaded = options.acoustics.load(config);
  shift(times.poses, loaded.scene());
  const std::shared_ptr<const SynthesisTables> tables = options.acoustics.tables(loaded);  // of what no plan chooses
  for (const std::string& warning : find_oddities(options, loaded, times)) print_warning(warning);
  const AcousticScene acoustics = target ? planned(options, loaded, *target, times.poses, num_moments) : loaded;
  std::vector<WalkSource> sources = make_sources(options, acoustics, times.block_samples);
  SourceFieldStore fields({.folder = options.field_store,
                           .max_bytes = static_cast<std::uint64_t>(options.field_store_gb * 1e9),
                           .max_memory_bytes = 0,
                           .warn = log_warning});
  for (WalkSource& source : sources) source.prepare(acoustics, fields);
  const std::vector<float> sound = render(options, times, acoustics, tables, sources);
  const int num_channels = tables->layout.num_channels();
  write_wav(options.out, sound, num_channels, config.sample_rate_hz, tables->layout.channel_mask);
  fmt::print("{}: {:.2f} s, {} sources, {} channels at {:.0f} Hz\n", options.out, times.duration_s(), sources.size(), num_channels,
             config.sample_rate_hz);
}

}  // namespace

void add_walk(CLI::App& app) {
  auto options = std::make_shared<WalkArguments>();
  CLI::App* command =
      app.add_subcommand("walk", "Render the sound at a moving listener as one gap-free signal, for one or more static or moving sources");
  options->acoustics.add_to(*command, "fast");
  options->acoustics.add_accuracy_to(*command);
  command
      ->add_option("--poses", options->poses,
                   "CSV file with the columns t_s,x,y,z,heading_deg (seconds; point between the ears in metres; degrees)")
      ->required();
  command->add_option("--source", options->sources, "Position of a static source: X,Y,Z in metres; may be repeated");
  command->add_option("--source-path", options->source_paths,
                      "Path of a moving source: CSV file like --poses, whose heading_deg is its front; may be repeated.  Moving sources "
                      "are counted after static ones");
  options->radiation.add_to(*command);
  command
      ->add_option("--sound", options->sounds,
                   "Dry sound: a WAV, FLAC or OGG file, or synth:KIND[:SEED]; it loops.  Give one for all sources or one per source")
      ->required();
  command->add_option("--out", options->out, "WAV file to write (32-bit float)")->type_name(kOutputFile)->required();
  command
      ->add_option("--step", options->step_s,
                   "Seconds between two impulse responses.  Between them strong paths glide and the rest crossfades; the sound of a step "
                   "ends at the pose at its end")
      ->capture_default_str();
  command
      ->add_option(
          "--field-store", options->field_store,
          "Folder of source fields of static sources (field=on, or field=auto over many blocks); missing fields are computed and written")
      ->type_name(kOutputFolder);
  command
      ->add_option("--field-store-gb", options->field_store_gb,
                   "Size limit of --field-store in GB; the least recently used fields are removed first")
      ->capture_default_str();
  command
      ->add_option("--refine-every", options->refine_every,
                   "Start with a coarse source field and replace it every N steps by a finer one with up to twice the photons; 0: use the "
                   "complete field from the start")
      ->capture_default_str();
  command->callback([options] { run_walk(*options); });
}

}  // namespace earshot
