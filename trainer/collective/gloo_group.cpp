// SPDX-License-Identifier: Apache-2.0
#include "trainer/collective/gloo_group.h"

#include "sim/base/errors.h"

#ifdef EARSHOT_GLOO
#define USE_C10D_GLOO  // without it c10d's header declares nothing
#include <torch/torch.h>

#include <algorithm>
#include <cstring>
#include <torch/csrc/distributed/c10d/FileStore.hpp>
#include <torch/csrc/distributed/c10d/ProcessGroupGloo.hpp>
#endif

namespace earshot {

#ifdef EARSHOT_GLOO
namespace {

class GlooGroup : public Collective {
 public:
  GlooGroup(WorkerIdentity identity, const std::string& meeting_file, std::chrono::milliseconds timeout, const std::string& address)
      : identity_(identity) {
    const auto store = c10::make_intrusive<c10d::FileStore>(meeting_file, identity.world_size);
    const auto options = c10d::ProcessGroupGloo::Options::create(timeout);
    options->devices = {c10d::ProcessGroupGloo::createDeviceForHostname(address)};
    options->threads = 2;
    group_ = c10::make_intrusive<c10d::ProcessGroupGloo>(store, identity.rank, identity.world_size, options);
  }

  [[nodiscard]] WorkerIdentity identity() const override { return identity_; }
  void all_reduce_sum(std::span<float> buffer) override { sum(buffer, torch::kFloat32); }
  void all_reduce_sum(std::span<double> buffer) override { sum(buffer, torch::kFloat64); }
  void broadcast(std::span<std::byte> buffer) override {
    if (buffer.empty()) return;
    std::vector<torch::Tensor> tensors{of_bytes(buffer)};
    call([&] { return group_->broadcast(tensors); });
  }
  void barrier() override {
    call([&] { return group_->barrier(); });
  }
  std::vector<std::string> all_gather(const std::string& bytes) override {
    std::vector<double> sizes(static_cast<std::size_t>(identity_.world_size));
    sizes[static_cast<std::size_t>(identity_.rank)] = static_cast<double>(bytes.size());
    all_reduce_sum(sizes);
    // Every part has room for the longest.
    const auto room = static_cast<std::int64_t>(std::max(1.0, *std::ranges::max_element(sizes)));
    torch::Tensor mine = torch::zeros({room}, torch::kUInt8);
    std::memcpy(mine.data_ptr(), bytes.data(), bytes.size());
    std::vector<torch::Tensor> inputs{mine};
    std::vector<std::vector<torch::Tensor>> outputs(1);
    for (int rank = 0; rank < identity_.world_size; ++rank) outputs[0].push_back(torch::zeros({room}, torch::kUInt8));
    call([&] { return group_->allgather(outputs, inputs); });
    std::vector<std::string> parts;
    for (std::size_t rank = 0; rank < sizes.size(); ++rank)
      parts.emplace_back(static_cast<const char*>(outputs[0][rank].data_ptr()), static_cast<std::size_t>(sizes[rank]));
    return parts;
  }

 private:
  static torch::Tensor of_bytes(std::span<std::byte> bytes) {
    return torch::from_blob(bytes.data(), {static_cast<std::int64_t>(bytes.size())}, torch::kUInt8);
  }
  template <class T>
  void sum(std::span<T> buffer, torch::ScalarType type) {
    if (buffer.empty()) return barrier();
    std::vector<torch::Tensor> tensors{torch::from_blob(buffer.data(), {static_cast<std::int64_t>(buffer.size())}, type)};
    call([&] { return group_->allreduce(tensors); });
  }
  template <class Start>
  void call(const Start& start) {
    try {
      start()->wait();
    } catch (const std::exception& error) {
      throw RunError("Gloo", error.what());
    }
  }

  WorkerIdentity identity_;
  c10::intrusive_ptr<c10d::ProcessGroupGloo> group_;
};

}  // namespace

bool has_gloo() { return true; }

std::unique_ptr<Collective> make_gloo_group(WorkerIdentity identity, const std::string& meeting_file, std::chrono::milliseconds timeout,
                                            const std::string& address) {
  try {
    return std::make_unique<GlooGroup>(identity, meeting_file, timeout, address);
  } catch (const std::exception& error) {
    throw RunError("Gloo", error.what());
  }
}
#else
bool has_gloo() { return false; }

std::unique_ptr<Collective> make_gloo_group(WorkerIdentity, const std::string&, std::chrono::milliseconds, const std::string&) {
  throw InputError("Gloo", "is not part of this build", "install libgloo-dev and build again");
}
#endif

}  // namespace earshot
