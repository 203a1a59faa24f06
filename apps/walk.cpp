#include <fmt/format.h>

#include <cmath>
#include <fstream>
#include <memory>
#include <numbers>
#include <sstream>

#include "apps/acoustic_options.h"
#include "apps/commands.h"
#include "sim/audio/sound_clip.h"
#include "sim/audio/sound_stream.h"
#include "sim/base/errors.h"
#include "sim/base/progress.h"

namespace earshot {
namespace {

struct Options {
  AcousticOptions acoustics;
  std::string poses, source, sound, out;
  double step_s = 0.05;
};

struct TimedPose {
  double t_s = 0;
  glm::dvec3 position{0};
  double heading_deg = 0;
};

std::vector<TimedPose> read_poses(const std::string& path) {
  std::ifstream stream(path);
  if (!stream) throw InputError(path, "cannot be opened", "name a CSV file with the columns t_s,x,y,z,heading_deg");
  std::vector<TimedPose> poses;
  int line_number = 0;
  for (std::string line; std::getline(stream, line);) {
    ++line_number;
    if (line.empty() || line == "\r" || line.starts_with("#") || line.starts_with("t_s")) continue;
    std::istringstream fields(line);
    TimedPose pose;
    std::array<char, 4> commas{};
    fields >> pose.t_s >> commas[0] >> pose.position.x >> commas[1] >> pose.position.y >> commas[2] >> pose.position.z >> commas[3] >> pose.heading_deg;
    const double sum = pose.t_s + pose.position.x + pose.position.y + pose.position.z + pose.heading_deg;
    if (fields.fail() || commas != std::array{',', ',', ',', ','} || !std::isfinite(sum))
      throw InputError(fmt::format("{}:{}", path, line_number), "is not 't_s,x,y,z,heading_deg'", "write five finite numbers");
    if (!poses.empty() && pose.t_s <= poses.back().t_s)
      throw InputError(fmt::format("{}:{}", path, line_number), "time does not rise", "sort the poses by t_s");
    poses.push_back(pose);
  }
  if (poses.size() < 2) throw InputError(path, "holds fewer than two poses", "give a start and an end");
  return poses;
}

/// Linear between poses; the heading turns the short way round.
TimedPose pose_at(const std::vector<TimedPose>& poses, double t_s) {
  std::size_t next = 1;
  while (next + 1 < poses.size() && poses[next].t_s < t_s) ++next;
  const TimedPose &a = poses[next - 1], &b = poses[next];
  const double share = std::clamp((t_s - a.t_s) / (b.t_s - a.t_s), 0.0, 1.0);
  const double turn_deg = std::remainder(b.heading_deg - a.heading_deg, 360.0);
  return {t_s, a.position + share * (b.position - a.position), a.heading_deg + share * turn_deg};
}

void run_walk(const Options& options) {
  require(options.step_s > 0 && options.step_s <= 1, "--step", options.step_s, "must be in (0, 1] s");
  const AcousticConfig config = options.acoustics.config();
  const auto poses = read_poses(options.poses);
  const glm::vec3 source = parse_point(options.source, "--source");
  const SoundClip clip = open_sound(options.sound, config.sample_rate_hz);
  const AcousticScene acoustics = options.acoustics.load(config);
  const EarlyCandidates candidates(acoustics, source);
  RirSynthesizer synthesizer(options.acoustics.tables(acoustics));
  const int num_channels = options.acoustics.layout() == ChannelLayout::mono ? 1 : 2;

  const int block = std::max(1, static_cast<int>(std::lround(options.step_s * config.sample_rate_hz)));
  const double duration_s = poses.back().t_s - poses.front().t_s;
  const auto num_samples = static_cast<std::size_t>(std::lround(duration_s * config.sample_rate_hz));
  const std::size_t num_blocks = (num_samples + static_cast<std::size_t>(block) - 1) / static_cast<std::size_t>(block);
  const int rir_samples = static_cast<int>(std::lround(config.rir_length_s * config.sample_rate_hz));
  StreamConvolver convolver({config.sample_rate_hz, rir_samples, block, block}, num_channels);

  std::vector<float> sound(num_samples * static_cast<std::size_t>(num_channels));
  std::vector<float> part(static_cast<std::size_t>(block) * static_cast<std::size_t>(num_channels));
  EnergyResponse response;
  Rir rir, previous;
  StreamPosition position{0, 0, false};
  Progress progress("walk", "block", num_blocks);
  for (std::size_t i = 0; i < num_blocks; ++i) {
    const TimedPose pose = pose_at(poses, poses.front().t_s + static_cast<double>(i) * block / static_cast<double>(config.sample_rate_hz));
    compute_energy_response(acoustics, candidates, glm::vec3(pose.position), response);
    synthesizer.render(response, pose.heading_deg * std::numbers::pi / 180, acoustics.hash(), rir);
    convolver.convolve(clip, position, rir.samples, previous.samples, rir.num_samples, block, part);
    const std::size_t first = i * static_cast<std::size_t>(block), count = std::min<std::size_t>(static_cast<std::size_t>(block), num_samples - first);
    for (int c = 0; c < num_channels; ++c)
      std::copy_n(part.begin() + static_cast<std::ptrdiff_t>(c) * block, count,
                  sound.begin() + static_cast<std::ptrdiff_t>(static_cast<std::size_t>(c) * num_samples + first));
    position.sample += static_cast<std::uint64_t>(block);
    std::swap(rir, previous);
    progress.update(i + 1);
  }
  write_wav(options.out, sound, num_channels, config.sample_rate_hz);
  fmt::print("{}: {:.2f} s, {} channels at {:.0f} Hz\n", options.out, duration_s, num_channels, config.sample_rate_hz);
}

}  // namespace

void add_walk(CLI::App& app) {
  auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("walk", "What a listener hears who walks through a scene: one gap-free sound");
  options->acoustics.add_to(*command, "fast");
  command->add_option("--poses", options->poses, "CSV with the columns t_s,x,y,z,heading_deg (point between the ears, metres; degrees)")->required();
  command->add_option("--source", options->source, "X,Y,Z in metres")->required();
  command->add_option("--sound", options->sound, "Dry sound: a WAV, FLAC or OGG file, or synth:KIND[:SEED]; it loops")->required();
  command->add_option("--out", options->out, "WAV file to write (32-bit float)")->required();
  command->add_option("--step", options->step_s, "Seconds between two impulse responses; the sound fades from one to the next")->capture_default_str();
  command->callback([options] { run_walk(*options); });
}

}  // namespace earshot
