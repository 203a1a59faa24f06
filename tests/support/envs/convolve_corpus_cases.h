// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "datasets/convolve_corpus.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "tests/support/envs/env_cases.h"
#include "tests/support/envs/rir_corpus_cases.h"

namespace earshot::corpus_cases {

/// A small corpus of two rooms, with early parts and shared listeners, and folders of speech at two rates and of noise.
class ConvolveFiles {
 public:
  explicit ConvolveFiles(const std::string& name) : folder_(name) {
    RirCorpusConfig config = tiny();
    config.shoeboxes.count = 2;
    config.split_ms = 20;
    config.shared_listeners = true;
    write_rir_corpus(config, {.out = path("corpus"), .threads = 2, .shard = {}, .progress = {}});
    std::filesystem::create_directories(path("speech/other"));
    std::filesystem::create_directories(path("noise"));
    write("speech/a.wav", "synth:speech:1", 16000, 4000);
    write("speech/b.wav", "synth:speech:2", 16000, 2500);
    write("speech/other/c.wav", "synth:speech:3", 24000, 4500);
    write("noise/engine.wav", "synth:engine:1", 16000, 3000);
    write_text(path("speech/b.txt"), "words of b\n");
  }
  [[nodiscard]] std::filesystem::path path(const std::string& name) const { return folder_.path() / name; }
  [[nodiscard]] ConvolveConfig config() const {
    ConvolveConfig config;
    config.corpus = path("corpus").string();
    config.speech = path("speech").string();
    config.seed = 4;
    config.count = 25;
    config.signals_per_folder = 10;
    return config;
  }

 private:
  void write(const std::string& name, const std::string& sound, float rate_hz, std::size_t samples) const {
    SoundClip clip = synthesize_sound(sound, rate_hz);
    // From where it is loudest on, so that a short part of it is not silent.
    std::size_t peak = 0;
    for (std::size_t i = 0; i < clip.samples.size(); ++i)
      if (std::abs(clip.samples[i]) > std::abs(clip.samples[peak])) peak = i;
    std::vector<float> part(samples);
    for (std::size_t i = 0; i < samples; ++i) part[i] = clip.samples[(peak + i) % clip.samples.size()];
    write_wav(path(name), part, 1, rate_hz);
  }
  TestFolder folder_;
};

}  // namespace earshot::corpus_cases
