#include "envs/observation.h"

#include "sim/base/errors.h"

namespace earshot {

void read(ConfigReader& reader, ObservationSpec& spec) {
  reader.read("depth", spec.depth);
  reader.read("spectrogram", spec.spectrogram);
  reader.read("pointgoal", spec.pointgoal);
  reader.read("legacy_spectrogram", spec.legacy_spectrogram);
  ConfigReader camera = reader.child("camera");
  camera.read("width_px", spec.camera.width_px);
  camera.read("height_px", spec.camera.height_px);
  camera.read("horizontal_fov_deg", spec.camera.horizontal_fov_deg);
  camera.read("height_m", spec.camera.height_m);
  camera.read("max_depth_m", spec.camera.max_depth_m);
  camera.finish();
}

void validate(const ObservationSpec& spec) {
  require(spec.depth || spec.spectrogram || spec.pointgoal, "observation", "nothing",
          "must have at least one sensor: a policy needs an input");
  validate(spec.camera);
  const SpectrogramConfig& sound = spec.sound;
  require(sound.sample_rate_hz >= 8000.f && sound.sample_rate_hz <= 96000.f, "observation.sound.sample_rate_hz", sound.sample_rate_hz,
          "must be in [8000, 96000]");
  require(sound.num_samples >= sound.fft_size && sound.num_samples <= 10'000'000, "observation.sound.num_samples", sound.num_samples,
          "must hold at least one analysis frame");
}

}  // namespace earshot
