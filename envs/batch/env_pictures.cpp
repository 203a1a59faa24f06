// Pictures of a batch.  Embree draws those of an env in the env's own task.  EGL draws those of many envs at once: tasks leave what they
// want (PendingPictures), and the thread that gathers the tasks draws it before it hands the envs back.

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "envs/batch/batched_env_impl.h"

namespace earshot {
namespace {

bool same_pose(const Pose& a, const Pose& b) { return a.position == b.position && a.heading_rad == b.heading_rad; }

/// The rows of one env: its observation now, or the last one of its episode that ended.
CameraImages images_of(const AgentCamera& camera, std::size_t env, bool last) {
  CameraImages images;
  const auto row = [&]<class T>(SensorRows* sensor, std::span<T>& image) {
    if (sensor) image = last ? sensor->last_row<T>(env) : sensor->row<T>(env);
  };
  row(camera.depth, images.depth);
  row(camera.rgb, images.rgb);
  row(camera.semantic, images.semantic);
  row(camera.normals, images.normals);
  return images;
}

/// Numbers of their own for each camera.
DepthNoiseDraw of_camera(DepthNoiseDraw draw, std::size_t camera) {
  draw.seed += std::uint64_t{camera} << 48;
  return draw;
}

void require_finite(std::span<const float> values) {
  if (!std::ranges::all_of(values, [](float value) { return std::isfinite(value); }))
    throw RunError("egl renderer", "the driver drew a picture that is not finite");
}

}  // namespace

void BatchedEnv::Impl::open_renderer() {
  const ObservationSpec& spec = config.observation;
  const bool pinholes =
      std::ranges::any_of(cameras, [](const AgentCamera& each) { return each.camera.config().projection == Projection::pinhole; });
  if (spec.renderer == Renderer::embree || !pinholes) return;
  const auto warn = [](const std::string& message) { spdlog::warn(message); };
  try {
    egl = std::make_unique<EglRenderer>(EglOptions{.device = spec.egl_device, .warn = warn});
  } catch (const InputError&) {  // no hardware; but a device that has a name is there or is a mistake
    if (spec.renderer == Renderer::egl || spec.egl_device != "auto") throw;
  } catch (const RunError& error) {
    if (spec.renderer == Renderer::egl) throw;
    spdlog::warn("pictures are drawn by Embree: {}", error.what());
  }
  if (egl && spec.renderer == Renderer::automatic && egl->software()) egl.reset();
  if (!egl) return;
  for (AgentCamera& camera : cameras) camera.by_egl = camera.camera.config().projection == Projection::pinhole;
  egl_draws = true;
}

void BatchedEnv::Impl::see_others(std::size_t row) {
  Agent& agent = agents[row];
  agent.others.clear();
  const std::size_t first = first_row(env_of(row));
  for (std::size_t other = first; other < first + per_env; ++other)
    if (other != row)
      agent.others.push_back({.foot = agents[other].state.pose(config.task).position,
                              .radius_m = config.navmesh.agent_radius_m,
                              .height_m = config.navmesh.agent_height_m,
                              .color = body_color(agent_of(other))});
}

void BatchedEnv::Impl::render(std::size_t row) {
  if (!runs(row) || cameras.empty()) return;
  Agent& agent = agents[row];
  see_others(row);
  const Pose now = agent.state.pose(config.task);
  const bool noisy = config.observation.depth_noise;  // which is another in each step
  if (!noisy && agent.pictures_are_current && same_pose(now, agent.rendered_pose) && agent.others == agent.rendered_others) return;
  const DepthNoiseDraw noise{.seed = noise_seed(row),
                             .env = agent.stream,
                             .episode = static_cast<std::uint32_t>(agent.episode_count),
                             .step = static_cast<std::uint32_t>(agent.state.steps())};
  const bool drawn_later = egl_draws.load(std::memory_order_relaxed);
  bool wants_egl = false;
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    const AgentCamera& camera = cameras[i];
    if (camera.by_egl && drawn_later) {
      wants_egl = true;
      continue;
    }
    CameraImages images = images_of(camera, row, false);
    const std::span<float> depth_row = images.depth;
    if (noisy && camera.depth) {
      agent.clean_depth.resize(depth_row.size());
      images.depth = agent.clean_depth;
    }
    camera.camera.render(*agent.source->scene->scene, agent.appearance.get(), now, images, agent.others);
    if (noisy && camera.depth)
      add_depth_noise(config.observation.noise, camera.camera.config(), of_camera(noise, i), agent.clean_depth, depth_row);
    if (camera.depth && !check(row, Fault::depth, depth_row)) return;
    if (camera.normals && !check(row, Fault::depth, images.normals)) return;
  }
  if (wants_egl)
    agent.pictures_now = {.wanted = true,
                          .scene = agent.source->scene->scene,
                          .appearance = agent.appearance,
                          .pose = now,
                          .episode_index = agent.episode_index,
                          .noise = noise};
  agent.rendered_pose = now;
  agent.rendered_others = agent.others;
  agent.pictures_are_current = true;
}

void BatchedEnv::Impl::keep_rows(std::size_t row) {
  rows.keep(row);
  Agent& agent = agents[row];  // the copy has come too early for what is not drawn yet
  if (agent.pictures_now.wanted)
    agent.pictures_last = agent.pictures_now;
  else
    agent.pictures_last.wanted = false;
}

void BatchedEnv::Impl::draw_pending(std::span<const std::uint32_t> done) {
  if (!egl) return;
  pending.clear();
  for (const std::uint32_t env : done) {
    Agent& agent = agents[env];       // envs of one agent (EnvConfig): it is a row
    if (envs[env].stalled) continue;  // its thread still writes there
    if (agent.pictures_last.wanted) pending.push_back({.env = env, .last = true, .pictures = &agent.pictures_last});
    if (agent.pictures_now.wanted) pending.push_back({.env = env, .last = false, .pictures = &agent.pictures_now});
  }
  if (pending.empty()) return;
  const auto start = std::chrono::steady_clock::now();
  for (std::size_t camera = 0; camera < cameras.size(); ++camera)
    if (cameras[camera].by_egl) draw_pending_of(camera);
  for (const PendingRow& row : pending) *row.pictures = {};  // lets go of the scene
  stage_seconds.render += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

void BatchedEnv::Impl::draw_pending_of(std::size_t index) {
  const AgentCamera& camera = cameras[index];
  const CameraSensorConfig& view_config = camera.camera.config();
  const bool noisy = config.observation.depth_noise && camera.depth;
  const std::size_t pixels = size_of(view_config.width_px) * size_of(view_config.height_px);
  if (noisy) pending_depth.resize(pending.size() * pixels);
  views.clear();
  for (std::size_t i = 0; i < pending.size(); ++i) {
    const PendingPictures& wanted = *pending[i].pictures;
    views.push_back({.scene = wanted.scene,
                     .appearance = wanted.appearance,
                     .pose = wanted.pose,
                     .images = images_of(camera, pending[i].env, pending[i].last)});
    if (noisy) views.back().images.depth = std::span(pending_depth).subspan(i * pixels, pixels);
  }
  if (egl_draws) draw_by_egl(view_config);
  if (!egl_draws)
    for (const EglView& view : views) camera.camera.render(*view.scene, view.appearance.get(), view.pose, view.images);
  for (std::size_t i = 0; noisy && i < views.size(); ++i)
    add_depth_noise(config.observation.noise, view_config, of_camera(pending[i].pictures->noise, index), views[i].images.depth,
                    images_of(camera, pending[i].env, pending[i].last).depth);
  views.clear();
}

/// A failure of the driver, after the renderer's own second try, leaves the pictures to Embree, from these views on.
void BatchedEnv::Impl::draw_by_egl(const CameraSensorConfig& view_config) {
  try {
    egl->render(view_config, views);
    for (std::size_t i = 0; i < views.size(); ++i) {
      const PendingPictures& wanted = *pending[i].pictures;
      if (hook && !views[i].images.depth.empty())
        hook({.kind = Fault::depth,
              .env = static_cast<int>(global_id(pending[i].env)),
              .episode_index = wanted.episode_index,
              .step = static_cast<int>(wanted.noise.step)},
             views[i].images.depth);
      require_finite(views[i].images.depth);
      require_finite(views[i].images.normals);
    }
  } catch (const std::exception& error) {
    spdlog::warn("pictures are drawn by Embree from now on: {}", error.what());
    egl_draws = false;
  }
}

}  // namespace earshot
