// SPDX-License-Identifier: Apache-2.0
#include "sim/vision/egl_batch.h"

#include <algorithm>
#include <bit>
#include <glm/geometric.hpp>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr int kLargestTargetSide = 8192;
constexpr std::size_t kMaxPixelsAtOnce = std::size_t{1} << 24;  // 256 MiB of words; a longer batch takes several transfers

}  // namespace

EglBatch::EglBatch(const std::string& device) : context_(device) {
  GLint side = 0;
  glGetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &side);
  GLint viewport[2] = {0, 0};
  glGetIntegerv(GL_MAX_VIEWPORT_DIMS, viewport);
  largest_side_px_ = std::min({side, viewport[0], viewport[1], kLargestTargetSide});
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_LESS);
  glDisable(GL_DITHER);
  check_gl("setting up the context");
}

EglScene& EglBatch::upload(const EglView& view) {
  Kept& kept = scenes_[view.scene.get()];
  // Another scene may stand where a dropped one stood.
  const bool same_scene = kept.uploaded && kept.scene.lock() == view.scene;
  const bool same_looks = !view.appearance || kept.appearance.lock() == view.appearance;
  if (same_scene && same_looks) return *kept.uploaded;
  kept.uploaded.reset();  // before the next: both may not fit
  kept = {view.scene, view.appearance, std::make_unique<EglScene>(*view.scene, view.appearance.get())};
  ++scenes_uploaded_;
  return *kept.uploaded;
}

void EglBatch::drop_dead_scenes() {
  std::erase_if(scenes_, [](const auto& entry) { return entry.second.scene.expired(); });
}

void EglBatch::require_target(int width_px, int height_px) {
  if (target_ && target_->width_px == width_px && target_->height_px == height_px) return;
  target_.emplace();
  target_->width_px = width_px;
  target_->height_px = height_px;
  glBindFramebuffer(GL_FRAMEBUFFER, target_->framebuffer.get());
  const auto attach = [&](const GlRenderbuffer& buffer, GLenum format, GLenum place) {
    glBindRenderbuffer(GL_RENDERBUFFER, buffer.get());
    glRenderbufferStorage(GL_RENDERBUFFER, format, width_px, height_px);
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, place, GL_RENDERBUFFER, buffer.get());
  };
  attach(target_->pixels, GL_RGBA32UI, GL_COLOR_ATTACHMENT0);
  attach(target_->depth, GL_DEPTH_COMPONENT32F, GL_DEPTH_ATTACHMENT);
  check_gl("making the target");
  if (glCheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE)
    throw RunError("egl renderer", "the driver cannot render to four integers per pixel");
}

void EglBatch::draw(const CameraSensorConfig& config, const EglView& view) {
  const EglScene& scene = upload(view);
  program_.set_camera(config, frame_of(config, view.pose));
  const bool detail = scene.has_detail() && !view.images.rgb.empty();
  const bool surface = !detail || !view.images.depth.empty() || !view.images.semantic.empty() || !view.images.normals.empty();
  if (detail) {
    // Colours alone come from here.
    glColorMask(GL_FALSE, GL_TRUE, GL_FALSE, GL_FALSE);
    scene.draw_detail(program_);
    glColorMask(GL_TRUE, GL_FALSE, GL_TRUE, GL_TRUE);
    if (surface) glClear(GL_DEPTH_BUFFER_BIT);
  }
  if (surface) scene.draw_surface(program_);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
}

bool EglBatch::render(const CameraSensorConfig& config, std::span<const EglView> views) {
  drop_dead_scenes();
  const int width = config.width_px, height = config.height_px;
  if (width > largest_side_px_ || height > largest_side_px_)
    throw InputError("camera", "is larger than the device supports", "reduce its size, or use the embree renderer");
  const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height), bytes = pixels * sizeof(PixelWord);
  const std::size_t most = std::max<std::size_t>(1, kMaxPixelsAtOnce / pixels);
  require_target(width, height);
  glBindFramebuffer(GL_FRAMEBUFFER, target_->framebuffer.get());
  glViewport(0, 0, width, height);
  program_.use();
  for (std::size_t first = 0; first < views.size(); first += most) {
    const std::span<const EglView> part = views.subspan(first, std::min(most, views.size() - first));
    glBindBuffer(GL_PIXEL_PACK_BUFFER, pictures_.get());
    glBufferData(GL_PIXEL_PACK_BUFFER, static_cast<GLsizeiptr>(part.size() * bytes), nullptr, GL_STREAM_READ);
    for (std::size_t i = 0; i < part.size(); ++i) {
      constexpr GLuint nothing[4] = {0, 0, 0, 0};
      constexpr GLfloat far_away = 1.f;
      glClearBufferuiv(GL_COLOR, 0, nothing);
      glClearBufferfv(GL_DEPTH, 0, &far_away);
      draw(config, part[i]);
      glReadPixels(0, 0, width, height, GL_RGBA_INTEGER, GL_UNSIGNED_INT, reinterpret_cast<void*>(i * bytes));
    }
    const void* mapped = glMapBufferRange(GL_PIXEL_PACK_BUFFER, 0, static_cast<GLsizeiptr>(part.size() * bytes), GL_MAP_READ_BIT);
    if (context_.is_lost()) return false;
    if (!mapped) {
      check_gl("reading the pictures back");
      throw RunError("EGL renderer", "the driver cannot map memory to read the images");
    }
    const std::span words(static_cast<const PixelWord*>(mapped), part.size() * pixels);
    for (std::size_t i = 0; i < part.size(); ++i) unpack(config, part[i], words.subspan(i * pixels, pixels));
    const bool kept = glUnmapBuffer(GL_PIXEL_PACK_BUFFER) == GL_TRUE;
    glBindBuffer(GL_PIXEL_PACK_BUFFER, 0);
    if (!kept || context_.is_lost()) return false;  // the mapped memory may have been lost
    check_gl("rendering");
  }
  return true;
}

void EglBatch::unpack(const CameraSensorConfig& config, const EglView& view, std::span<const PixelWord> words) const {
  const CameraImages& images = view.images;
  const CameraFrame frame = frame_of(config, view.pose);
  const std::vector<glm::vec3>& normals = scenes_.at(view.scene.get()).uploaded->normals();
  const std::vector<glm::uvec3>& triangles = view.scene->mesh().triangles;
  const std::vector<glm::vec3>& vertices = view.scene->mesh().vertices;
  for (std::size_t pixel = 0; pixel < words.size(); ++pixel) {
    const PixelWord word = words[pixel];
    // After a reset the words may be anything; the caller draws again then, and must get so far.
    const bool hit = word.depth_bits != 0 && word.triangle < triangles.size();
    if (!images.depth.empty()) images.depth[pixel] = hit ? std::min(std::bit_cast<float>(word.depth_bits) / config.max_depth_m, 1.f) : 1.f;
    if (!images.rgb.empty())
      for (unsigned channel = 0; channel < 3; ++channel)
        images.rgb[3 * pixel + channel] = static_cast<std::uint8_t>(word.rgb >> (8 * channel) & 0xFFu);
    if (!images.semantic.empty()) images.semantic[pixel] = hit ? view.appearance->triangle_category[word.triangle] : std::uint16_t{0};
    if (images.normals.empty()) continue;
    glm::vec3 normal(0);
    if (hit) {
      normal = normals[word.triangle];
      if (glm::dot(normal, vertices[triangles[word.triangle].x] - frame.eye) > 0) normal = -normal;
    }
    images.normals[3 * pixel] = glm::dot(normal, frame.right);
    images.normals[3 * pixel + 1] = glm::dot(normal, frame.up);
    images.normals[3 * pixel + 2] = -glm::dot(normal, frame.forward);
  }
}

}  // namespace earshot
