#pragma once

#include <cstdint>

#include "sim/audio/spectrogram.h"
#include "sim/base/config_reader.h"
#include "sim/vision/camera.h"

namespace earshot {

/// Which sensors an environment has, and their shapes per env.
struct ObservationSpec {
  bool depth = true;        ///< float [height, width, 1] in [0, 1]
  bool spectrogram = true;  ///< float [65, 26, 2] at 16 kHz
  bool pointgoal = false;   ///< float [2]: distance and angle to the goal
  CameraConfig camera;
  SpectrogramConfig sound;          ///< the analysed window: the last second of what was heard
  bool legacy_spectrogram = false;  ///< only the new samples, zero-padded to the window (SoundSpaces 2.0)
  [[nodiscard]] int depth_size() const { return camera.width_px * camera.height_px; }
  [[nodiscard]] int spectrogram_size() const { return sound.rows() * sound.columns() * 2; }
};
void read(ConfigReader& reader, ObservationSpec& spec);
/// Throws InputError "key = value: rule".
void validate(const ObservationSpec& spec);

}  // namespace earshot
