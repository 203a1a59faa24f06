// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "sim/audio/head/listener_layout.h"
#include "sim/audio/transforms/spectrogram.h"
#include "sim/base/text/config_reader.h"
#include "sim/nav/topdown_map.h"
#include "sim/vision/camera.h"
#include "sim/vision/camera_sensor.h"
#include "sim/vision/depth_noise.h"

namespace earshot {

/// Renderer of pinhole cameras; Embree always renders panoramas.
enum class Renderer {
  embree,     ///< rays on the CPU, in the threads of the batch: the same bits on every machine
  egl,        ///< OpenGL on ObservationSpec::egl_device, all envs of a step at once; Embree, with a warning, once its driver has failed
  automatic,  ///< egl where that device is hardware, else embree
};

/// A camera beside the main one, with its sensors.
struct ExtraCamera {
  std::string name = {};  ///< its sensors are NAME_depth, NAME_rgb, NAME_semantic and NAME_normals
  CameraSensorConfig config = {};
  bool depth = false, rgb = false, semantic = false, normals = false;
};

/// Errors of where an agent says it is: independent Gaussian ones in every step, the same for all sensors that tell it.  Standard
/// deviations; zero: none.
struct PoseNoiseConfig {
  float position_m = 0;   ///< along each of the two axes, [0, 10]
  float heading_deg = 0;  ///< [0, 180]
  [[nodiscard]] bool any() const { return position_m > 0 || heading_deg > 0; }
};

/// Which sensors an environment has, by the names of the sensor table (sensor.h), and what they are made with.
struct ObservationSpec {
  bool depth = true, rgb = false, semantic = false, normals = false;  ///< of the main camera
  bool spectrogram = true, interaural = false;
  bool waveform = false, heard = false;
  std::string channels = "binaural";  ///< of the sound, as ListenerLayout::named: of all sensors that hear but `interaural`, which has ears
  bool pointgoal = false, gps_compass = false, pose = false;
  bool collision = false, previous_action = false;
  bool topdown_map = false;
  bool oracle_action = false, goal_state = false;  ///< privileged: for learners, not for agents
  CameraConfig camera;                             ///< the main one: level, ahead, a pinhole
  bool unlit = false;                              ///< its colours without light
  Renderer renderer = Renderer::embree;
  std::string egl_device = "auto";   ///< EglOptions::device: the first hardware, software, a number, a UUID or cuda:N
  std::vector<ExtraCamera> cameras;  ///< further ones
  bool depth_noise = false;          ///< all depth is as a structured-light camera sees it, by `noise`
  DepthNoiseConfig noise = {};
  PoseNoiseConfig pose_noise = {};  ///< of gps_compass and pose; keys of `noise` as well
  TopdownMapConfig map = {};        ///< settings of topdown_map
  SpectrogramConfig sound;          ///< the analysed window: the last second of what was heard
  bool legacy_spectrogram = false;  ///< only the new samples, zero-padded to the window (SoundSpaces 2.0)
  /// Whether any sensor needs the sound at the ears.
  [[nodiscard]] bool hears() const { return spectrogram || interaural || waveform || heard; }
  [[nodiscard]] bool has_ears() const { return channels == "binaural"; }
  /// Reads the file of array:FILE.
  [[nodiscard]] ListenerLayout layout() const { return ListenerLayout::named(channels); }
  /// The main camera, if it has a sensor, and the further ones.
  [[nodiscard]] std::vector<ExtraCamera> all_cameras() const;
};
void read(ConfigReader& reader, ObservationSpec& spec);
/// Throws InputError "key = value: rule".
void validate(const ObservationSpec& spec);

}  // namespace earshot
