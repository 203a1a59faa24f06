// SPDX-License-Identifier: Apache-2.0
// metrics [SCENE SX SY SZ LX LY LZ]
// Room-acoustic parameters (ISO 3382-1) per octave band, from the energy of a response and from its rendered samples.
#include <earshot/metrics.h>
#include <earshot/scene.h>

#include <cstdio>
#include <cstdlib>

int main(int argc, char** argv) try {
  const auto number = [&](int index, double otherwise) { return argc > index ? std::atof(argv[index]) : otherwise; };
  const earshot::Scene scene(argc > 1 ? argv[1] : "shoebox:8x3x6@0.3", {.settings = {{"rir_length_s", "auto"}}});
  const auto response = scene.source({number(2, 2), number(3, 1.5), number(4, 2)}).response({number(5, 6), number(6, 1.6), number(7, 4)});
  const earshot::Metrics energy = response.metrics();
  const earshot::Metrics samples = earshot::measure(response.render({.channels = "mono"}), energy.direct_delay_s);

  std::printf("%-12s", "bands_hz");
  for (const double band : energy.bands_hz) std::printf(" %8.0f", band);
  std::printf("\n");
  for (const earshot::MetricField& field : earshot::metric_fields()) {
    std::printf("%-12s", field.name);
    for (const double value : energy.*field.values) std::printf(" %8.3f", value);
    std::printf("\n");
  }
  std::printf("drr_db %.2f, t20_s of the samples at %.0f Hz %.3f\n", energy.drr_db, samples.bands_hz[3], samples.t20_s[3]);
} catch (const std::exception& error) {
  std::fprintf(stderr, "metrics: %s\n", error.what());
  return 1;
}
