// SPDX-License-Identifier: Apache-2.0
// rir SCENE OUT.wav SX SY SZ LX LY LZ
// Writes the binaural room impulse response from a source at (SX, SY, SZ) to a listener at (LX, LY, LZ), in metres, y up, and lists its
// first paths.
#include <earshot/audio.h>
#include <earshot/rir.h>
#include <earshot/scene.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>

int main(int argc, char** argv) try {
  if (argc != 9) {
    std::fputs("usage: rir SCENE OUT.wav SX SY SZ LX LY LZ\n", stderr);
    return 2;
  }
  const auto point = [&](int first) {
    return earshot::Vec3{std::atof(argv[first]), std::atof(argv[first + 1]), std::atof(argv[first + 2])};
  };
  const earshot::Scene scene(argv[1], {.settings = {{"rir_length_s", 1}}});
  const earshot::Response response = scene.source(point(3)).response(point(6));  // before any head
  const earshot::Rir rir = response.render();                                    // at two ears; the listener faces -z
  earshot::write_wav(argv[2], rir);

  static constexpr const char* kinds[] = {"direct", "reflection", "diffraction", "transmission"};
  const auto& arrivals = response.arrivals();
  for (std::size_t i = 0; i < std::min<std::size_t>(arrivals.size(), 5); ++i)
    std::printf("  %6.2f ms  %-12s order %d\n", 1000 * arrivals[i].delay_s, kinds[static_cast<int>(arrivals[i].kind)], arrivals[i].order);
  const earshot::LateEnergy late = response.late();
  std::printf("%s: %d channels, %d samples at %.0f Hz, %zu paths, late field of %d bins of %.0f ms\n", argv[2], rir.num_channels,
              rir.num_samples, rir.sample_rate_hz, arrivals.size(), late.num_bins, 1000 * late.bin_s);
} catch (const std::exception& error) {
  std::fprintf(stderr, "rir: %s\n", error.what());
  return 1;
}
