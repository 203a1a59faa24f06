// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "trainer/collective/collective.h"

namespace earshot {

/// A collective whose sums pass through hooks before and after; around one worker alone unless another is given.
class HookedCollective : public Collective {
 public:
  using GradientHook = std::function<void(std::span<float> buffer)>;
  using StatisticsHook = std::function<void(std::span<double> sums)>;

  explicit HookedCollective(GradientHook summed, StatisticsHook statistics = {})
      : single_(make_single_worker()), inner_(*single_), summed_(std::move(summed)), statistics_(std::move(statistics)) {}
  HookedCollective(Collective& inner, GradientHook sent, GradientHook summed)
      : inner_(inner), sent_(std::move(sent)), summed_(std::move(summed)) {}

  [[nodiscard]] WorkerIdentity identity() const override { return inner_.identity(); }
  void all_reduce_sum(std::span<float> buffer) override {
    if (sent_) sent_(buffer);
    inner_.all_reduce_sum(buffer);
    if (summed_) summed_(buffer);
  }
  void all_reduce_sum(std::span<double> sums) override {
    inner_.all_reduce_sum(sums);
    if (statistics_) statistics_(sums);
  }
  void broadcast(std::span<std::byte> buffer) override { inner_.broadcast(buffer); }
  void barrier() override { inner_.barrier(); }
  std::vector<std::string> all_gather(const std::string& bytes) override { return inner_.all_gather(bytes); }
  [[nodiscard]] std::vector<int> members() const override { return inner_.members(); }
  [[nodiscard]] bool survives_loss() const override { return inner_.survives_loss(); }
  void note_progress() override { inner_.note_progress(); }
  [[nodiscard]] int num_waiting() override { return inner_.num_waiting(); }
  void brief(const std::string& text) override { inner_.brief(text); }
  [[nodiscard]] bool has_joiners() override { return inner_.has_joiners(); }
  void admit() override { inner_.admit(); }
  std::string hand_over(int from, const std::vector<int>& to, const std::string& bytes) override {
    return inner_.hand_over(from, to, bytes);
  }
  [[nodiscard]] bool is_joining() const override { return inner_.is_joining(); }
  [[nodiscard]] std::string briefing() const override { return inner_.briefing(); }
  void enter() override { inner_.enter(); }
  void confirm_join() override { inner_.confirm_join(); }

 private:
  std::unique_ptr<Collective> single_;
  Collective& inner_;
  GradientHook sent_, summed_;
  StatisticsHook statistics_;
};

}  // namespace earshot
