// SPDX-License-Identifier: Apache-2.0
#pragma once

/// @file
/// Sources, and the responses from them to listeners.

#include <map>
#include <memory>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "earshot/config.h"
#include "earshot/rir.h"
#include "earshot/vec3.h"

namespace earshot::api {

/// Files that channels are read from: that of `array:FILE` with those of its patterns, or that of `mono:FILE`.  Empty for other channels.
/// "mono:" + SourceOptions::pattern gives the file of a source.
/// @throws InputError for unknown channels, or a file that cannot be read.
std::vector<InputFile> files_of_channels(const std::string& channels);

/// Pattern and size of a source.
struct SourceOptions {
  /// omni, subcardioid, cardioid, supercardioid, hypercardioid, dipole, voice, or a file: a balloon, SOFA or CLF text.
  std::string pattern = "omni";
  double heading_deg = 0, pitch_deg = 0;  ///< of its front; heading counter-clockwise from -z
  double radius_m = 0;                    ///< of the sphere that it fills, [0, 10]; 0: a point
};

/// A listener of a batch.
struct Listener {
  Vec3 position;
  double heading_deg = 0, pitch_deg = 0, roll_deg = 0;
};

/// Options of calls for several listeners.
struct BatchOptions {
  std::string channels = "binaural";  ///< as RenderOptions::channels
  std::string hrtf = {};              ///< as RenderOptions::hrtf
  int threads = 0;                    ///< over the listeners; 0: all cores.  Any number gives the same bits
  /// A request to stop ends the call with a RunError, at the next listener or part of a field.
  std::stop_token stop = {};
};

/// One way to compute the responses of a source, tried at a few listeners.
struct AccuracyChoice {
  std::string method = {};                       ///< "listener rays", "source field" or "both ends"
  Settings settings = {};                        ///< for SceneOptions::settings
  std::map<std::string, double> predicted = {};  ///< errors at other listeners: t20_pct, drr_db, edc_db; NaN: no such value
  double per_source_ms = 0, per_response_ms = 0;
};

/// The cheapest settings that meet an accuracy, and all that were tried.
struct AccuracyPlan {
  std::vector<AccuracyChoice> tried = {};  ///< in the order of trial
  std::size_t chosen = 0;
  std::map<std::string, double> reference_error = {};  ///< standard error of the reference
  double calibration_s = 0;
  [[nodiscard]] const AccuracyChoice& choice() const { return tried[chosen]; }
};

/// A source that stands still in a scene.  Its paths are found once, at the first response.  Copies share them.
///
/// \code
/// earshot::Source source = scene.source({2, 1.5, 2}, {.pattern = "voice", .heading_deg = 90});
/// earshot::Rir rir = source.render({4, 1.5, 6});
/// earshot::Rir turned = source.render({4, 1.5, 6}, {.heading_deg = 30, .channels = "ambisonic:3"});
/// \endcode
///
/// Threads: any number of callers.
/// Errors:  InputError for a listener that is not finite or outside the closed scene, for unknown channels or head filters, and for a
///          negative number of threads.
/// Bits:    equal arguments and seeds give equal bits, for any number of threads, whatever was called before.
class Source {
 public:
  /// The impulse response of one listener.
  [[nodiscard]] Rir render(const Vec3& listener, const RenderOptions& options = {}) const;
  /// The same for many listeners.  From 300 listeners on the late field of the source is computed once and shared, where that is cheaper.
  /// Later calls of as many listeners use it, smaller ones do not.
  [[nodiscard]] std::vector<Rir> render_all(std::span<const Listener> listeners, const BatchOptions& options = {}) const;

  /// The response before any head.
  /// @param listener  position.
  /// @param channels  those that will be rendered from it.
  [[nodiscard]] Response response(const Vec3& listener, const std::string& channels = "binaural") const;
  /// The responses of many listeners.
  /// @param listeners  positions.
  /// @param options    channels and threads; hrtf is not used.
  [[nodiscard]] std::vector<Response> responses(std::span<const Vec3> listeners, const BatchOptions& options = {}) const;

  /// The cheapest settings within `target` for responses at places like `listeners`.  Takes seconds.
  /// @param target     "t20=5%,drr=1dB,edc=1dB", or some of these.
  /// @param listeners  positions at which settings are tried.
  /// @param responses  number of responses that the source is for; 0: one per listener.
  /// @param stop       a request to stop ends the call with a RunError, at the next part of a trial.
  /// @throws InputError if no candidate meets the target.
  [[nodiscard]] AccuracyPlan plan_accuracy(const std::string& target, std::span<const Vec3> listeners, double responses = 0,
                                           const std::stop_token& stop = {}) const;

  struct Model;
  explicit Source(std::shared_ptr<Model> model) : model_(std::move(model)) {}  ///< for the library: use Scene::source

 private:
  std::shared_ptr<Model> model_;
};

}  // namespace earshot::api
