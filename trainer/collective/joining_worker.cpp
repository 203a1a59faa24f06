// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <optional>

#include "sim/base/errors.h"
#include "sim/base/text/log.h"
#include "trainer/collective/zmq_ring.h"
#include "trainer/net/join_request.h"
#include "trainer/net/rendezvous.h"

namespace earshot {
namespace {

/// Outside the run until enter(), then a worker of its ring like the others.
class JoiningWorker : public Collective {
 public:
  explicit JoiningWorker(RingConfig config) : config_(std::move(config)) {
    config_.incarnation = new_incarnation();
    validate(config_);
    briefing_ = ask_for_briefing(config_);
  }

  [[nodiscard]] bool is_joining() const override { return !ring_; }
  [[nodiscard]] std::string briefing() const override { return briefing_; }

  /// An attempt that another change of membership crossed is made again.
  void enter() override {
    const auto deadline = std::chrono::steady_clock::now() + config_.timeout;
    while (!ring_) try {
        ring_.emplace(config_);
      } catch (const LeftOut& error) {
        if (std::chrono::steady_clock::now() >= deadline) throw;
        log_info(fmt::format("{}; trying again", error.what()));
        config_.incarnation = new_incarnation();
      } catch (const zmq::error_t& error) {
        throw RunError("ZeroMQ", error.what());
      }
  }

  [[nodiscard]] WorkerIdentity identity() const override { return ring_ ? ring_->identity() : config_.identity; }
  [[nodiscard]] std::vector<int> members() const override { return ring_ ? ring_->members() : Collective::members(); }
  [[nodiscard]] bool survives_loss() const override { return true; }
  void note_progress() override {
    if (ring_) ring_->note_progress();
  }
  [[nodiscard]] int num_waiting() override { return ring().num_waiting(); }
  void all_reduce_sum(std::span<float> buffer) override { ring().all_reduce_sum(buffer); }
  void all_reduce_sum(std::span<double> buffer) override { ring().all_reduce_sum(buffer); }
  void broadcast(std::span<std::byte> buffer) override { ring().broadcast(buffer); }
  void barrier() override { ring().barrier(); }
  std::vector<std::string> all_gather(const std::string& bytes) override { return ring().all_gather(bytes); }
  void confirm_join() override { ring().confirm_join(); }
  void brief(const std::string& text) override { ring().brief(text); }
  [[nodiscard]] bool has_joiners() override { return ring().has_joiners(); }
  void admit() override { ring().admit(); }
  std::string hand_over(int from, const std::vector<int>& to, const std::string& bytes) override {
    return ring().hand_over(from, to, bytes);
  }

 private:
  [[nodiscard]] ZmqRing& ring() {
    if (!ring_) throw std::logic_error("JoiningWorker: a collective call before enter()");
    return *ring_;
  }

  RingConfig config_;
  std::string briefing_;
  std::optional<ZmqRing> ring_;
};

}  // namespace

std::unique_ptr<Collective> make_joining_worker(const RingConfig& config) { return std::make_unique<JoiningWorker>(config); }

}  // namespace earshot
