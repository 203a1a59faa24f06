// SPDX-License-Identifier: Apache-2.0
// audio OUT.wav [SOUND]
// A dry sound as it is heard in a room.
#include <earshot/audio.h>
#include <earshot/scene.h>

#include <cstdio>

int main(int argc, char** argv) try {
  if (argc < 2) {
    std::fputs("usage: audio OUT.wav [SOUND]\n", stderr);
    return 2;
  }
  const earshot::Scene scene("shoebox:8x3x6@0.2", {.settings = {{"rir_length_s", 0.5}}});
  const earshot::Rir rir = scene.source({2, 1.5, 2}).render({6, 1.6, 4});
  const earshot::Audio dry = earshot::load_sound(argc > 2 ? argv[2] : "synth:speech:3", rir.sample_rate_hz);
  const earshot::Audio heard = earshot::convolve(dry, rir);
  earshot::write_wav(argv[1], heard);
  const earshot::Audio read = earshot::load_audio(argv[1]);
  std::printf("dry %zu frames, heard %d channels of %zu frames, read back %s\n", dry.num_frames(), heard.num_channels, heard.num_frames(),
              read.samples == heard.samples ? "equal" : "different");
} catch (const std::exception& error) {
  std::fprintf(stderr, "audio: %s\n", error.what());
  return 1;
}
