// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <barrier>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "trainer/collective/collective.h"

namespace earshot {

/// Two threads of one process as workers that meet in each call; sums in rank order.
class TwoWorkers {
 public:
  class Worker : public Collective {
   public:
    Worker(TwoWorkers& both, int rank) : both_(both), rank_(rank) {}
    [[nodiscard]] WorkerIdentity identity() const override { return {rank_, 2}; }
    void all_reduce_sum(std::span<float> buffer) override { sum(both_.floats_, buffer); }
    void all_reduce_sum(std::span<double> buffer) override {
      sum(both_.doubles_, buffer);
      if (++double_sums == 1) first_sum = buffer[0];
    }
    void broadcast(std::span<std::byte> buffer) override {
      if (rank_ == 0) both_.bytes_.assign(buffer.begin(), buffer.end());
      barrier();
      std::copy(both_.bytes_.begin(), both_.bytes_.end(), buffer.begin());
      barrier();
    }
    void barrier() override { both_.meet_.arrive_and_wait(); }
    std::vector<std::string> all_gather(const std::string& bytes) override {
      both_.texts_[static_cast<std::size_t>(rank_)] = bytes;
      barrier();
      std::vector<std::string> all(both_.texts_.begin(), both_.texts_.end());
      barrier();
      return all;
    }

    int double_sums = 0;   ///< calls
    double first_sum = 0;  ///< first element of the first of them

   private:
    template <class T>
    void sum(std::array<std::vector<T>, 2>& parts, std::span<T> buffer) {
      parts[static_cast<std::size_t>(rank_)].assign(buffer.begin(), buffer.end());
      barrier();
      for (std::size_t i = 0; i < buffer.size(); ++i) buffer[i] = parts[0][i] + parts[1][i];
      barrier();
    }

    TwoWorkers& both_;
    int rank_;
  };
  Worker worker(int rank) { return {*this, rank}; }

 private:
  std::array<std::vector<float>, 2> floats_;
  std::array<std::vector<double>, 2> doubles_;
  std::array<std::string, 2> texts_;
  std::vector<std::byte> bytes_;
  std::barrier<> meet_{2};
};

}  // namespace earshot
