// rir SCENE OUT.wav SX SY SZ LX LY LZ
// Writes the binaural room impulse response from a source at (SX, SY, SZ) to a listener at (LX, LY, LZ), in metres, y up.
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <memory>

#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/audio/dry_sounds/sound_clip.h"

using namespace earshot;

int main(int argc, char** argv) try {
  if (argc != 9) {
    std::fputs("usage: rir SCENE OUT.wav SX SY SZ LX LY LZ\n", stderr);
    return 2;
  }
  const auto point = [&](int first) { return glm::dvec3(std::atof(argv[first]), std::atof(argv[first + 1]), std::atof(argv[first + 2])); };

  // The scene, and the scene as one acoustic configuration sees it.
  const auto scene = std::make_shared<const Scene>(load_scene(argv[1]));
  AcousticConfig config = acoustic_preset("balanced");
  config.rir_length_s = 1.f;
  const AcousticScene acoustics(scene, config);

  // What reaches the listener, before any head: paths and late energy.
  const EarlyCandidates candidates(acoustics, SoundSource{scene->to_local(point(3))});
  const glm::vec3 listener = scene->to_local(point(6));
  EnergyResponse response;
  compute_energy_response(acoustics, candidates, listener, response);

  // The same as pressure at two ears; the listener faces -z.
  RirSynthesizer synthesizer(make_synthesis_tables(acoustics.config(), acoustics.bands(), ChannelLayout::binaural, nullptr));
  Rir rir;
  synthesizer.render(response, 0.0, {carrier_key(acoustics.hash(), candidates.source()), listener}, rir);
  write_wav(argv[2], rir.samples, rir.num_channels, rir.sample_rate_hz);
  std::printf("%s: %d channels, %d samples at %.0f Hz, %zu paths\n", argv[2], rir.num_channels, rir.num_samples, rir.sample_rate_hz,
              response.arrivals.size());
} catch (const std::exception& error) {
  std::fprintf(stderr, "rir: %s\n", error.what());
  return 1;
}
