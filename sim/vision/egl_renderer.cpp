// SPDX-License-Identifier: Apache-2.0
#include "sim/vision/egl_renderer.h"

#include <atomic>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>

#include "sim/base/errors.h"
#include "sim/vision/egl_batch.h"

namespace earshot {

/// The thread that owns the context.  Jobs come one at a time, and their callers wait.
class EglRenderer::Worker {
 public:
  explicit Worker(EglOptions options) : options_(std::move(options)), thread_([this] { serve(); }) {}
  ~Worker() {
    {
      const std::lock_guard lock(mutex_);
      stopping_ = true;
    }
    changed_.notify_all();
    thread_.join();
  }
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  /// Runs the job on the thread and throws what it throws.
  void run(const std::function<void()>& job) {
    const std::lock_guard one_at_a_time(callers_);
    std::unique_lock lock(mutex_);
    job_ = &job;
    failure_ = nullptr;
    changed_.notify_all();
    changed_.wait(lock, [&] { return job_ == nullptr; });
    if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
  }

  // The rest runs on the thread.
  void open() { batch_ = std::make_unique<EglBatch>(options_.device); }
  [[nodiscard]] const EglContext& context() const { return batch_->context(); }

  void render(const CameraSensorConfig& config, std::span<const EglView> views) {
    for (int attempt = 0; attempt < 2; ++attempt) {
      if (!batch_) open();
      const std::uint64_t uploaded = batch_->scenes_uploaded();
      bool whole = false;
      try {
        whole = !lose_next_.exchange(false) && batch_->render(config, views);
      } catch (const RunError&) {
        if (!batch_->context().is_lost()) throw;  // a lost context also shows as other errors
      }
      scenes_uploaded_ += batch_->scenes_uploaded() - uploaded;
      if (whole) return;
      ++contexts_lost_;
      batch_.reset();
      if (options_.warn)
        options_.warn(
            "egl renderer: the driver lost its context (reset or memory fault); creating a new context and drawing the batch again");
    }
    throw RunError("egl renderer", "the driver lost its context twice in one batch");
  }

  std::atomic<std::uint64_t> contexts_lost_{0}, scenes_uploaded_{0};
  std::atomic<bool> lose_next_{false};

 private:
  void serve() {
    std::unique_lock lock(mutex_);
    while (true) {
      changed_.wait(lock, [&] { return stopping_ || job_ != nullptr; });
      if (job_ == nullptr) break;
      const std::function<void()>* job = job_;
      lock.unlock();
      std::exception_ptr failure;
      try {
        (*job)();
      } catch (...) {
        failure = std::current_exception();
      }
      lock.lock();
      failure_ = failure;
      job_ = nullptr;
      changed_.notify_all();
    }
    batch_.reset();
  }

  EglOptions options_;
  std::unique_ptr<EglBatch> batch_;
  std::mutex callers_, mutex_;
  std::condition_variable changed_;
  const std::function<void()>* job_ = nullptr;
  std::exception_ptr failure_;
  bool stopping_ = false;
  std::thread thread_;  // last: it uses the rest
};

EglRenderer::EglRenderer(EglOptions options) : worker_(std::make_unique<Worker>(std::move(options))) {
  worker_->run([this] {
    worker_->open();
    device_name_ = worker_->context().renderer();
    software_ = worker_->context().software();
  });
}

EglRenderer::~EglRenderer() = default;

void EglRenderer::render(const CameraSensorConfig& config, std::span<const EglView> views) {
  validate(config);
  if (config.projection != Projection::pinhole)
    throw InputError("camera.projection = equirectangular", "is not supported by the egl renderer", "use the embree renderer");
  for (const EglView& view : views) {
    EARSHOT_EXPECT(view.scene);
    EARSHOT_EXPECT(view.appearance || !view.images.wants_appearance());
    EARSHOT_EXPECT(!view.appearance || view.appearance->triangle_color.size() == view.scene->mesh().triangles.size());
    check_sizes(config, view.images);
  }
  if (views.empty()) return;
  worker_->run([&] { worker_->render(config, views); });
}

std::uint64_t EglRenderer::contexts_lost() const { return worker_->contexts_lost_; }
std::uint64_t EglRenderer::scenes_uploaded() const { return worker_->scenes_uploaded_; }
void EglRenderer::lose_context() { worker_->lose_next_ = true; }

}  // namespace earshot
