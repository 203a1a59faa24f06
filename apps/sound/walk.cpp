#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>

#include "apps/commands.h"
#include "apps/options/accuracy_planning.h"
#include "apps/options/acoustic_options.h"
#include "apps/options/parse_point.h"
#include "apps/options/source_options.h"
#include "apps/options/timed_path.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/response/temporal_reuse.h"
#include "sim/acoustics/source_field/field_for_poses.h"
#include "sim/acoustics/source_field/refining_field.h"
#include "sim/acoustics/source_field/source_field_store.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/acoustics/synthesis/path_glide.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/audio/stream/sound_stream.h"
#include "sim/base/errors.h"
#include "sim/base/process/progress.h"
#include "sim/base/text/log.h"

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

/// How the late sound of a source is found.
enum class LateSound {
  traced,    ///< at each pose, for itself
  reused,    ///< traced, and blended along the walk
  gathered,  ///< from a field that is complete before the walk begins
  refined,   ///< from a field that gets better while the walk goes on, by a fixed schedule
};

/// The reference (preset `high`) stays without reuse unless the user sets it: there a response depends on its pose alone.
LateSound choose_late_sound(const AcousticScene& acoustics, bool moving, int refine_every) {
  const AcousticConfig& config = acoustics.config();
  if (!moving && uses_source_field(acoustics)) return refine_every > 0 ? LateSound::refined : LateSound::gathered;
  const bool listener_rooted = config.source_rays == 0 && config.specular_exponent == 0.f;
  const bool reuse = config.temporal_reuse == Switch::on || (config.temporal_reuse == Switch::automatic && moving && listener_rooted);
  return reuse ? LateSound::reused : LateSound::traced;
}

/// A source before its sound is rendered.
struct WalkSourceSetup {
  std::vector<TimedPose> path;
  SoundSource at_start;
  bool moving = false;
  LateSound late = LateSound::traced;
  int refine_every = 0;  ///< blocks, with LateSound::refined
  SoundClip clip;
  std::uint64_t carrier_key = 0;
};

/// One block of the walk: when it begins, and how the listener stands then.
struct WalkBlock {
  double t_s = 0;
  std::size_t index = 0;
  int num_samples = 0;
  glm::vec3 listener{0};
  ListenerOrientation orientation;
};

/// One source with its response and convolver.  A source at rest keeps its candidates; a moving one gets new ones where it is.
class WalkSource {
 public:
  explicit WalkSource(WalkSourceSetup setup)
      : path_(std::move(setup.path)),
        source_(std::move(setup.at_start)),
        moving_(setup.moving),
        late_(setup.late),
        refine_every_(setup.refine_every),
        clip_(std::move(setup.clip)),
        oversampled_(clip_),
        carrier_key_(setup.carrier_key) {}

  /// Of a source at rest: what belongs to it and not to the pose.  Once, before the first block.
  void prepare(const AcousticScene& acoustics, SourceFieldStore& fields) {
    if (moving_) return;
    candidates_ = std::make_unique<EarlyCandidates>(acoustics, source_);
    if (late_ == LateSound::gathered) {
      Progress progress("source field", "%", 100);
      field_ = fields.get(acoustics, *candidates_, [&](double fraction) { progress.update(static_cast<std::uint64_t>(100 * fraction)); });
    } else if (late_ == LateSound::refined) {
      refining_ = std::make_unique<RefiningField>(acoustics, *candidates_);
    }
  }

  /// Adds the sound of this source at the listener during the block to `mix` [channels, block.num_samples].
  void add_block(const AcousticScene& acoustics, RirSynthesizer& synthesizer, PathGlider& glider, const WalkBlock& block,
                 std::vector<float>& mix) {
    const int samples = block.num_samples;
    if (moving_) {
      const TimedPose pose = pose_at(path_, block.t_s);
      source_.position = glm::vec3(pose.position);
      source_.orientation = orientation_of(pose.heading_deg, 0, 0);
      candidates_ = std::make_unique<EarlyCandidates>(acoustics, source_, SourceMotion::moves);
    }
    respond(acoustics, block.listener, block.index);
    const std::span<const std::uint8_t> glides = glider.choose(response_, &gliding_);
    synthesizer.render(response_, block.orientation,
                       {carrier_key_, block.listener, moving_ ? std::optional(source_.position) : std::nullopt}, rir_, nullptr, glides);
    glider.advance(response_, glides, block.orientation, gliding_);
    if (!convolver_) convolver_.emplace(StreamConfig{rir_.sample_rate_hz, rir_.num_samples, samples, samples}, rir_.num_channels);
    part_.resize(static_cast<std::size_t>(samples) * static_cast<std::size_t>(rir_.num_channels));
    convolver_->convolve(clip_, position_, rir_.samples, previous_.samples, rir_.num_samples, samples, part_);
    glider.render(oversampled_, position_, samples, samples, gliding_, part_);
    mix.resize(part_.size());
    for (std::size_t i = 0; i < part_.size(); ++i) mix[i] += part_[i];
    position_.sample += static_cast<std::uint64_t>(samples);
    std::swap(rir_, previous_);
  }

 private:
  void respond(const AcousticScene& acoustics, glm::vec3 listener, std::size_t block_index) {
    if (late_ == LateSound::reused) return reuse_.compute(acoustics, *candidates_, listener, response_);
    if (late_ == LateSound::refined) {
      // Snapshot n from block n * refine_every on: the sound does not depend on the speed of the thread.
      auto snapshot =
          refining_->wait_for(static_cast<int>(std::min<std::size_t>(block_index / static_cast<std::size_t>(refine_every_), 1000)));
      if (snapshot != field_) responds_to_.reset();
      field_ = std::move(snapshot);
    }
    if (!moving_ && responds_to_ == listener) return;  // turned in place, or at rest
    compute_energy_response(acoustics, *candidates_, field_.get(), listener, response_);
    responds_to_ = listener;
  }

  std::vector<TimedPose> path_;
  SoundSource source_;
  bool moving_;
  LateSound late_;
  int refine_every_;
  SoundClip clip_;
  OversampledSound oversampled_;
  std::uint64_t carrier_key_;
  std::unique_ptr<EarlyCandidates> candidates_;  // at a stable address: the refining thread reads it
  std::shared_ptr<const SourceField> field_;
  std::unique_ptr<RefiningField> refining_;
  TemporalReuse reuse_;
  EnergyResponse response_;
  std::optional<glm::vec3> responds_to_;
  Rir rir_, previous_;
  GlidingPaths gliding_;
  StreamPosition position_{0, 0, false};
  std::optional<StreamConvolver> convolver_;
  std::vector<float> part_;
};

/// From where the file of the scene has it to where the scene has it.
void shift(std::vector<TimedPose>& path, const Scene& scene) {
  for (TimedPose& pose : path) pose.position -= scene.origin_m();
}

std::vector<WalkSource> make_sources(const WalkArguments& options, const AcousticScene& acoustics) {
  const std::size_t count = options.sources.size() + options.source_paths.size();
  if (count == 0)
    throw InputError("--source", "is missing", "give a source at rest with --source X,Y,Z or a moving one with --source-path FILE.csv");
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
    const LateSound late = choose_late_sound(acoustics, moving, options.refine_every);
    sources.emplace_back(WalkSourceSetup{.path = std::move(path),
                                         .at_start = std::move(at_start),
                                         .moving = moving,
                                         .late = late,
                                         .refine_every = options.refine_every,
                                         .clip = std::move(clip),
                                         .carrier_key = carrier_key(acoustics.hash(), i)});
  }
  return sources;
}

/// The scene as the plan for --accuracy has it: one source at rest, poses as the listener takes them.
AcousticScene planned(const WalkArguments& options, const AcousticScene& acoustics, const AccuracyTarget& target,
                      const std::vector<TimedPose>& poses, std::size_t num_blocks) {
  if (options.sources.size() != 1 || !options.source_paths.empty())
    throw InputError("--accuracy", "plans a walk for one source at rest", "give one --source, or leave it out");
  if (options.refine_every > 0 || acoustics.config().temporal_reuse == Switch::on)
    throw InputError("--accuracy", "says nothing of fields that are refined on the way and of responses that are blended",
                     "leave out --refine-every and temporal_reuse=on, or --accuracy");
  static_cast<void>(make_sources(options, acoustics));  // what is wrong with its sounds shows before the planner takes its time
  SoundSource source = options.radiation.source(0, 1, acoustics.scene().to_local(parse_point(options.sources[0], "--source")));
  std::vector<glm::vec3> places;
  for (std::size_t i = 0; i < num_blocks; ++i) {
    const double fraction = static_cast<double>(i) / static_cast<double>(num_blocks);
    places.emplace_back(pose_at(poses, poses.front().t_s + fraction * (poses.back().t_s - poses.front().t_s)).position);
  }
  return planned_scene(acoustics, plan_and_print(acoustics, target, source, places, static_cast<double>(num_blocks)));
}

void run_walk(const WalkArguments& options) {
  require(options.step_s > 0 && options.step_s <= 1, "--step", options.step_s, "must be in (0, 1] s");
  require(options.refine_every >= 0, "--refine-every", options.refine_every, "must not be negative");
  require(options.field_store_gb >= 0 && options.field_store_gb <= 1e9, "--field-store-gb", options.field_store_gb, "must be in [0, 1e9]");
  AcousticConfig config = options.acoustics.config();
  auto poses = read_timed_path(options.poses);
  const int block = std::max(1, static_cast<int>(std::lround(options.step_s * config.sample_rate_hz)));
  const double duration_s = poses.back().t_s - poses.front().t_s;
  constexpr double longest_s = 3600;
  if (!(duration_s * config.sample_rate_hz >= 1 && duration_s <= longest_s))
    throw InputError(options.poses, fmt::format("lasts {} s", duration_s),
                     fmt::format("let t_s run over at least one sample and at most {} s", longest_s));
  const auto num_samples = static_cast<std::size_t>(std::lround(duration_s * config.sample_rate_hz));
  const std::size_t num_blocks = (num_samples + static_cast<std::size_t>(block) - 1) / static_cast<std::size_t>(block);

  const std::optional<AccuracyTarget> target = options.acoustics.accuracy_target();
  config.field = field_switch_for_poses(config.field, options.source_paths.empty() ? num_blocks : 0);
  const AcousticScene loaded = options.acoustics.load(config);
  shift(poses, loaded.scene());
  const std::shared_ptr<const SynthesisTables> tables = options.acoustics.tables(loaded);  // of what no plan chooses
  const AcousticScene acoustics = target ? planned(options, loaded, *target, poses, num_blocks) : loaded;
  RirSynthesizer synthesizer(tables);
  PathGlider glider(tables, block);
  std::vector<WalkSource> sources = make_sources(options, acoustics);
  SourceFieldStore fields({.folder = options.field_store,
                           .max_bytes = static_cast<std::uint64_t>(options.field_store_gb * 1e9),
                           .max_memory_bytes = 0,
                           .warn = log_warning});
  for (WalkSource& source : sources) source.prepare(acoustics, fields);
  std::size_t num_channels = 0;
  std::vector<float> sound, mix;
  Progress progress("walk", "block", num_blocks);
  for (std::size_t i = 0; i < num_blocks; ++i) {
    const double t_s = poses.front().t_s + static_cast<double>(i) * block / static_cast<double>(config.sample_rate_hz);
    const TimedPose listener = pose_at(poses, t_s);
    const WalkBlock walk_block{.t_s = t_s,
                               .index = i,
                               .num_samples = block,
                               .listener = glm::vec3(listener.position),
                               .orientation = options.acoustics.orientation(listener.heading_deg, 0, 0)};
    std::fill(mix.begin(), mix.end(), 0.f);
    for (WalkSource& source : sources) source.add_block(acoustics, synthesizer, glider, walk_block, mix);
    num_channels = mix.size() / static_cast<std::size_t>(block);
    sound.resize(num_samples * num_channels);
    const std::size_t first = i * static_cast<std::size_t>(block),
                      count = std::min<std::size_t>(static_cast<std::size_t>(block), num_samples - first);
    for (std::size_t c = 0; c < num_channels; ++c)
      std::copy_n(mix.begin() + static_cast<std::ptrdiff_t>(c * static_cast<std::size_t>(block)), count,
                  sound.begin() + static_cast<std::ptrdiff_t>(c * num_samples + first));
    progress.update(i + 1);
  }
  write_wav(options.out, sound, static_cast<int>(num_channels), config.sample_rate_hz);
  fmt::print("{}: {:.2f} s, {} sources, {} channels at {:.0f} Hz\n", options.out, duration_s, sources.size(), num_channels,
             config.sample_rate_hz);
}

}  // namespace

void add_walk(CLI::App& app) {
  auto options = std::make_shared<WalkArguments>();
  CLI::App* command = app.add_subcommand(
      "walk", "Sound at a listener on a path through a scene: one gap-free signal of one or more sources, at rest or moving");
  options->acoustics.add_to(*command, "fast");
  options->acoustics.add_accuracy_to(*command);
  command->add_option("--poses", options->poses, "CSV with the columns t_s,x,y,z,heading_deg (point between the ears, metres; degrees)")
      ->required();
  command->add_option("--source", options->sources, "X,Y,Z in metres of a source at rest; may be repeated");
  command->add_option("--source-path", options->source_paths,
                      "CSV like --poses of a source that moves; may be repeated; counted after those at rest; its front is at heading_deg");
  options->radiation.add_to(*command);
  command
      ->add_option("--sound", options->sounds,
                   "Dry sound: a WAV, FLAC or OGG file, or synth:KIND[:SEED]; it loops.  Once for all sources, or once per source")
      ->required();
  command->add_option("--out", options->out, "WAV file to write (32-bit float)")->required();
  command
      ->add_option("--step", options->step_s,
                   "Seconds between two impulse responses; strong paths glide from one to the next, the rest fades")
      ->capture_default_str();
  command->add_option(
      "--field-store", options->field_store,
      "Folder of the late fields of sources at rest (field=on, or auto over many blocks): read if they are there, written if not");
  command->add_option("--field-store-gb", options->field_store_gb, "Bound of that folder; the least recently used go first")
      ->capture_default_str();
  command
      ->add_option("--refine-every", options->refine_every,
                   "Start with a coarse field and take the next of its snapshots, each with up to twice the photons, every so many steps; "
                   "0: the complete field from the start")
      ->capture_default_str();
  command->callback([options] { run_walk(*options); });
}

}  // namespace earshot
