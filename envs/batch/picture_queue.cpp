// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/picture_queue.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <string>

#include "sim/base/errors.h"
#include "sim/base/text/log.h"

namespace earshot {
namespace {

void require_finite(std::span<const float> values) {
  if (!std::ranges::all_of(values, [](float value) { return std::isfinite(value); }))
    throw RunError("egl renderer", "the driver returned an image with non-finite values");
}

/// Empties a list at the end of a scope, thrown out of or not.
template <class T>
struct ClearedAtEnd {
  std::vector<T>& list;
  ~ClearedAtEnd() { list.clear(); }
};
template <class T>
ClearedAtEnd(std::vector<T>&) -> ClearedAtEnd<T>;

/// Null where Embree draws.
std::unique_ptr<EglRenderer> open_renderer(const ObservationSpec& spec, std::span<const AgentCamera> cameras) {
  if (spec.renderer == Renderer::embree || !std::ranges::any_of(cameras, &AgentCamera::is_pinhole)) return nullptr;
  std::unique_ptr<EglRenderer> egl;
  try {
    egl = std::make_unique<EglRenderer>(EglOptions{.device = spec.egl_device, .warn = log_warning});
  } catch (const InputError&) {  // no hardware; but a device that has a name is there or is a mistake
    if (spec.renderer == Renderer::egl || spec.egl_device != "auto") throw;
  } catch (const RunError& error) {
    if (spec.renderer == Renderer::egl) throw;
    log_warning(fmt::format("using the Embree renderer for images: {}", error.what()));
  }
  if (egl && spec.renderer == Renderer::automatic && egl->software()) egl.reset();
  return egl;
}

}  // namespace

PictureQueue::PictureQueue(const ObservationSpec& spec, std::span<const AgentCamera> cameras, const FaultDesk& faults)
    : spec_(&spec), cameras_(cameras), faults_(&faults), egl_(open_renderer(spec, cameras)), draws_(egl_ != nullptr) {}

void PictureQueue::collect(Agent& agent) {
  if (!egl_) return;
  if (agent.pictures_last.wanted) waiting_.push_back({.agent = &agent, .last = true, .pictures = &agent.pictures_last});
  if (agent.pictures_now.wanted) waiting_.push_back({.agent = &agent, .last = false, .pictures = &agent.pictures_now});
}

double PictureQueue::draw() {
  if (waiting_.empty()) return 0;
  const ClearedAtEnd cleared{waiting_};
  const auto start = std::chrono::steady_clock::now();
  for (std::size_t camera = 0; camera < cameras_.size(); ++camera)
    if (cameras_[camera].is_pinhole()) draw_camera(camera);
  for (const Waiting& row : waiting_) *row.pictures = {};  // lets go of the scene
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

void PictureQueue::draw_camera(std::size_t index) {
  const AgentCamera& camera = cameras_[index];
  const CameraSensorConfig& config = camera.config();
  const bool noisy = spec_->depth_noise && camera.depth;
  const std::size_t pixels = size_of(config.width_px) * size_of(config.height_px);
  if (noisy) depth_.resize(waiting_.size() * pixels);
  views_.clear();
  for (std::size_t i = 0; i < waiting_.size(); ++i) {
    const PendingPictures& wanted = *waiting_[i].pictures;
    views_.push_back({.scene = wanted.scene,
                      .appearance = wanted.appearance,
                      .pose = wanted.pose,
                      .images = camera.images_of(waiting_[i].agent->row, waiting_[i].last)});
    if (noisy) views_.back().images.depth = std::span(depth_).subspan(i * pixels, pixels);
  }
  if (draws_) draw_by_egl(config);
  if (!draws_)
    for (const EglView& view : views_) camera.camera.render(*view.scene, view.appearance.get(), view.pose, view.images);
  for (std::size_t i = 0; noisy && i < views_.size(); ++i)
    add_depth_noise(spec_->noise, config, noise_of_camera(waiting_[i].pictures->noise, index), views_[i].images.depth,
                    camera.images_of(waiting_[i].agent->row, waiting_[i].last).depth);
  views_.clear();
}

/// A failure of the driver, after the renderer's own second try, leaves the pictures to Embree, from these views on.
void PictureQueue::draw_by_egl(const CameraSensorConfig& config) {
  try {
    egl_->render(config, views_);
    for (std::size_t i = 0; i < views_.size(); ++i) {
      const PendingPictures& wanted = *waiting_[i].pictures;
      if (!views_[i].images.depth.empty())
        faults_->show({.kind = Fault::depth,
                       .env = waiting_[i].agent->env_id,
                       .episode_index = wanted.episode_index,
                       .step = static_cast<int>(wanted.noise.step)},
                      views_[i].images.depth);
      require_finite(views_[i].images.depth);
      require_finite(views_[i].images.normals);
    }
  } catch (const std::exception& error) {
    log_warning(fmt::format("switching to the Embree renderer for images: {}", error.what()));
    draws_ = false;
  }
}

}  // namespace earshot
