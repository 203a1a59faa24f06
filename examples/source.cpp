// SPDX-License-Identifier: Apache-2.0
// source
// A talker who faces a listener and turns away, and many listeners at once.
#include <earshot/scene.h>

#include <cmath>
#include <cstdio>

namespace {
double level_db(std::span<const float> samples) {
  double energy = 0;
  for (const float sample : samples) energy += static_cast<double>(sample) * static_cast<double>(sample);
  return 10 * std::log10(energy);
}
}  // namespace

int main() try {
  const earshot::Scene scene("shoebox:8x3x6@0.5", {.preset = "fast"});
  const earshot::Vec3 mouth{2, 1.6, 3}, ear{6, 1.6, 3};  // the listener is in the direction +x: heading -90 degrees
  const auto toward = scene.source(mouth, {.pattern = "voice", .heading_deg = -90}).render(ear, {.channels = "mono"});
  const auto away = scene.source(mouth, {.pattern = "voice", .heading_deg = 90}).render(ear, {.channels = "mono"});
  std::printf("facing the listener is %.1f dB louder than facing away\n", level_db(toward.channel(0)) - level_db(away.channel(0)));

  const earshot::Source source = scene.source(mouth);
  std::vector<earshot::Listener> listeners;
  for (int i = 0; i < 8; ++i) listeners.push_back({.position = {3 + 0.5 * i, 1.6, 2}, .heading_deg = 45.0 * i});
  const auto rirs = source.render_all(listeners, {.channels = "ambisonic:1", .threads = 0});
  std::printf("%zu listeners, %d channels each\n", rirs.size(), rirs.front().num_channels);
} catch (const std::exception& error) {
  std::fprintf(stderr, "source: %s\n", error.what());
  return 1;
}
