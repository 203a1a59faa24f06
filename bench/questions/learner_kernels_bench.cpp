// SPDX-License-Identifier: Apache-2.0
// Question: which hand-written kernels of the learner are faster than those of the installed libtorch?  (docs/evidence/learner_speed.md)
// Names are KERNEL/CONFIG/IMPLEMENTATION/PASS.  --benchmark_enable_random_interleaving=true measures the implementations in turn.

#include <ATen/Context.h>
#include <ATen/ops/_foreach_add.h>
#include <ATen/ops/_foreach_addcdiv.h>
#include <ATen/ops/_foreach_addcmul.h>
#include <ATen/ops/_foreach_div.h>
#include <ATen/ops/_foreach_mul.h>
#include <ATen/ops/_foreach_sqrt.h>
#include <ATen/ops/_fused_adam.h>
#include <ATen/ops/conv2d.h>
#include <ATen/ops/gru.h>
#include <ATen/ops/gru_cell.h>
#include <ATen/ops/linear.h>
#include <ATen/ops/mm.h>
#include <benchmark/benchmark.h>
#include <torch/csrc/autograd/autograd.h>
#include <torch/optim/adam.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <array>
#include <cmath>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "policy/conv_encoder.h"
#include "policy/conv_stack.h"
#include "policy/masked_gru.h"
#include "policy/matrix_product.h"
#include "policy/torch_threads.h"
#include "trainer/learner/adam_kernel.h"

namespace earshot {
namespace {

using torch::Tensor;

/// One minibatch of a config: T steps of B envs; the actor takes one step of all envs of a worker.
struct Network {
  std::string name;
  std::int64_t T, B, envs;
  int camera_px, sound_channels, conv_channels, encoder_features, vector_features, hidden;
};
const std::array<Network, 2> kNetworks{{
    {"quick", 64, 4, 8, 64, 4, 16, 128, 6, 128},
    {"avnav", 150, 5, 10, 128, 2, 32, 512, 0, 512},
}};
constexpr int kSoundRows = 65, kSoundColumns = 26, kEpisodeSteps = 100;

void add(const std::string& name, const std::function<void(benchmark::State&)>& body) {
  benchmark::RegisterBenchmark(name.c_str(),
                               [body](benchmark::State& state) {
                                 use_one_torch_thread();
                                 torch::manual_seed(1);
                                 body(state);
                               })
      ->MeasureProcessCPUTime()
      ->Repetitions(5)
      ->ReportAggregatesOnly();
}

/// forward: with a graph; backward: along one graph, again and again; act: without a graph, on the rows of one step.
struct Passes {
  std::function<Tensor()> learn, act;
  std::vector<Tensor> leaves;
};

void add_passes(const std::string& name, const Passes& passes) {
  add(name + "/forward", [=](benchmark::State& state) {
    for (auto _ : state) benchmark::DoNotOptimize(passes.learn());
  });
  add(name + "/backward", [=](benchmark::State& state) {
    const Tensor output = passes.learn(), gradient = torch::randn_like(output);
    for (auto _ : state) benchmark::DoNotOptimize(torch::autograd::grad({output}, passes.leaves, {gradient}, /*retain_graph=*/true));
  });
  add(name + "/act", [=](benchmark::State& state) {
    const torch::NoGradGuard no_gradient;
    for (auto _ : state) benchmark::DoNotOptimize(passes.act());
  });
}

struct Stack {
  std::array<Tensor, kStackLayers> weights, biases;
  std::array<int, kStackLayers> strides{};
  std::vector<Tensor> leaves = {};
  std::int64_t features = 0;
};

Stack make_stack(std::int64_t rows, std::int64_t columns, std::int64_t channels, const std::vector<ConvLayer>& layers) {
  Stack stack;
  for (std::size_t i = 0; i < kStackLayers; ++i) {
    const ConvLayer& layer = layers[i];
    stack.weights[i] = torch::randn({layer.channels, channels, layer.kernel, layer.kernel})
                           .mul_(std::sqrt(2.0 / static_cast<double>(channels * layer.kernel * layer.kernel)))
                           .requires_grad_(true);
    stack.biases[i] = torch::zeros({layer.channels}).requires_grad_(true);
    stack.strides[i] = layer.stride;
    stack.leaves.insert(stack.leaves.end(), {stack.weights[i], stack.biases[i]});
    rows = (rows - layer.kernel) / layer.stride + 1;
    columns = (columns - layer.kernel) / layer.stride + 1;
    channels = layer.channels;
  }
  stack.features = rows * columns * channels;
  return stack;
}

Tensor torch_stack(const Stack& stack, Tensor x) {
  for (std::size_t i = 0; i < kStackLayers; ++i) {
    x = at::conv2d(x, stack.weights[i], stack.biases[i], stack.strides[i]);
    if (i + 1 < kStackLayers) x = x.relu_();
  }
  return x.flatten(1);
}

Stack in_channels_last(const Stack& stack) {
  Stack changed = stack;
  changed.leaves.clear();
  for (std::size_t i = 0; i < kStackLayers; ++i) {
    changed.weights[i] = stack.weights[i].detach().contiguous(at::MemoryFormat::ChannelsLast).requires_grad_(true);
    changed.leaves.insert(changed.leaves.end(), {changed.weights[i], changed.biases[i]});
  }
  return changed;
}

void add_convolutions(const std::string& name, std::int64_t learn, std::int64_t act, std::int64_t rows, std::int64_t columns,
                      std::int64_t channels, const std::vector<ConvLayer>& layers) {
  const Stack stack = make_stack(rows, columns, channels, layers), last = in_channels_last(stack);
  const Tensor minibatch = torch::rand({learn, rows, columns, channels}), step = torch::rand({act, rows, columns, channels});
  const auto ours = [=](const Tensor& pictures) { return conv_stack(pictures, stack.weights, stack.biases, stack.strides); };
  const auto channels_first = [=](const Tensor& pictures) { return torch_stack(stack, pictures.permute({0, 3, 1, 2}).contiguous()); };
  const auto channels_last = [=](const Tensor& pictures) { return torch_stack(last, pictures.permute({0, 3, 1, 2})); };
  const auto add_one = [&](const std::string& implementation, const std::vector<Tensor>& leaves, const auto& run) {
    add_passes(name + "/" + implementation, {[=] { return run(minibatch); }, [=] { return run(step); }, leaves});
  };
  add_one("ours", stack.leaves, ours);
  add_one("torch_channels_first", stack.leaves, channels_first);
  add_one("torch_channels_last", last.leaves, channels_last);
}

/// 0 where an episode begins, as in `earshot bench train`.
Tensor episode_mask(std::int64_t T, std::int64_t B) {
  Tensor mask = torch::ones({T, B});
  for (std::int64_t t = 0; t < T; ++t)
    for (std::int64_t b = 0; b < B; ++b)
      if ((t + 17 * b) % kEpisodeSteps == 0) mask[t][b] = 0;
  return mask;
}

struct Gru {
  MaskedGru ours;
  std::vector<Tensor> weights = {};  ///< in torch's order
};

/// torch's GRU on each segment of steps in which no episode begins.
Tensor gru_by_segment(const Gru& gru, const Tensor& x, const Tensor& hidden, const Tensor& mask) {
  std::vector<Tensor> outputs;
  Tensor state = hidden.unsqueeze(0);
  const std::int64_t T = x.size(0);
  for (std::int64_t first = 0, end = 1; first < T; first = end++) {
    while (end < T && mask[end].all().item<bool>()) ++end;
    const auto [output, last] =
        at::gru(x.slice(0, first, end), state * mask[first].view({1, -1, 1}), gru.weights, true, 1, 0.0, true, false, false);
    outputs.push_back(output);
    state = last;
  }
  return torch::cat(outputs);
}

Tensor gru_by_cell(const Gru& gru, const Tensor& x, const Tensor& hidden, const Tensor& mask) {
  std::vector<Tensor> outputs;
  Tensor state = hidden;
  for (std::int64_t t = 0; t < x.size(0); ++t) {
    state = at::gru_cell(x[t], state * mask[t].unsqueeze(1), gru.weights[0], gru.weights[1], gru.weights[2], gru.weights[3]);
    outputs.push_back(state);
  }
  return torch::stack(outputs);
}

void add_recurrence(const Network& network) {
  const std::int64_t features = 2 * network.encoder_features + network.vector_features;
  Gru gru{MaskedGru(static_cast<int>(features), network.hidden)};
  {
    const torch::NoGradGuard no_gradient;
    for (Tensor& parameter : gru.ours->parameters()) parameter.copy_(torch::randn_like(parameter) / std::sqrt(network.hidden));
  }
  gru.weights = {gru.ours->weight_ih, gru.ours->weight_hh, gru.ours->bias_ih, gru.ours->bias_hh};
  const Tensor inputs = torch::randn({network.T, network.B, features}).requires_grad_(true);
  const Tensor hidden = torch::randn({network.B, network.hidden}), mask = episode_mask(network.T, network.B);
  const Tensor step = torch::randn({1, network.envs, features}), states = torch::randn({network.envs, network.hidden});
  const Tensor all = torch::ones({1, network.envs});
  std::vector<Tensor> leaves = gru.weights;
  leaves.push_back(inputs);
  const auto add_one = [&](const std::string& implementation, const auto& run) {
    add_passes("gru/" + network.name + "/" + implementation,
               {[=] { return run(inputs, hidden, mask); }, [=] { return run(step, states, all); }, leaves});
  };
  add_one("ours", [=](const Tensor& x, const Tensor& h, const Tensor& m) {
    MaskedGru module = gru.ours;
    return module->forward(x, h, m);
  });
  add_one("torch_by_segment", [=](const Tensor& x, const Tensor& h, const Tensor& m) { return gru_by_segment(gru, x, h, m); });
  add_one("torch_by_cell", [=](const Tensor& x, const Tensor& h, const Tensor& m) { return gru_by_cell(gru, x, h, m); });
}

void add_linear(const std::string& name, std::int64_t rows, std::int64_t act, std::int64_t in, std::int64_t out) {
  const Tensor x = torch::randn({rows, in}).requires_grad_(true), step = torch::randn({act, in});
  const Tensor weight = torch::randn({out, in}).requires_grad_(true), bias = torch::zeros({out}).requires_grad_(true);
  const std::vector<Tensor> leaves{x, weight, bias};
  add_passes(name + "/ours", {[=] { return linear_layer(x, weight, bias); }, [=] { return linear_layer(step, weight, bias); }, leaves});
  add_passes(name + "/torch", {[=] { return at::linear(x, weight, bias); }, [=] { return at::linear(step, weight, bias); }, leaves});
}

/// c [m, n] = op(a) op(b).
void add_product(const std::string& name, std::int64_t m, std::int64_t n, std::int64_t k, bool transpose_a, bool transpose_b) {
  const Tensor a = transpose_a ? torch::randn({k, m}) : torch::randn({m, k}), b = transpose_b ? torch::randn({n, k}) : torch::randn({k, n});
  const auto add_one = [&](const std::string& implementation, torch::ScalarType type, const std::string& precision, auto run) {
    const Tensor left = a.to(type), right = b.to(type), c = torch::empty({m, n}, type);
    add(name + "/" + implementation + "/product", [=](benchmark::State& state) {
      const torch::NoGradGuard no_gradient;
      at::globalContext().setFloat32MatmulPrecision(precision);
      Tensor result = c;
      for (auto _ : state) run(result, left, right);
      at::globalContext().setFloat32MatmulPrecision("highest");
      state.counters["flop_per_s"] =
          benchmark::Counter(2.0 * static_cast<double>(m * n * k) * static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
    });
  };
  const auto by_torch = [=](Tensor& c, const Tensor& left, const Tensor& right) {
    at::mm_out(c, transpose_a ? left.t() : left, transpose_b ? right.t() : right);
  };
  add_one("ours", torch::kFloat32, "highest",
          [=](Tensor& c, const Tensor& left, const Tensor& right) { multiply_into(c, left, transpose_a, right, transpose_b); });
  add_one("torch", torch::kFloat32, "highest", by_torch);
  add_one("torch_medium_precision", torch::kFloat32, "medium", by_torch);
  add_one("torch_bfloat16", torch::kBFloat16, "highest", by_torch);
}

/// Parameters, gradients in one flat tensor and moments, as the learner holds them.
struct AdamState {
  std::vector<Tensor> weights = {}, gradients = {}, first = {}, second = {}, steps = {};
  Tensor flat = {};
};

AdamState make_adam_state(const std::vector<std::vector<std::int64_t>>& sizes) {
  AdamState state;
  std::int64_t count = 0, begin = 0;
  for (const std::vector<std::int64_t>& size : sizes) count += c10::multiply_integers(size);
  state.flat = torch::randn({count}) * 1e-3;
  for (const std::vector<std::int64_t>& size : sizes) {
    state.weights.push_back(torch::randn(size));
    const std::int64_t elements = state.weights.back().numel();
    state.gradients.push_back(state.flat.narrow(0, begin, elements).view(size));
    state.weights.back().mutable_grad() = state.gradients.back();
    state.first.push_back(torch::zeros(size));
    state.second.push_back(torch::zeros(size));
    state.steps.push_back(torch::zeros({}));
    begin += elements;
  }
  return state;
}

std::span<float> elements_of(const Tensor& tensor) { return {tensor.data_ptr<float>(), static_cast<std::size_t>(tensor.numel())}; }

constexpr double kLearningRate = 1e-4, kBeta1 = 0.9, kBeta2 = 0.999, kEpsilon = 1e-5, kScale = 1.0;

void adam_for_each(AdamState& s, std::int64_t step) {
  const double correction1 = 1 - std::pow(kBeta1, step), correction2 = 1 - std::pow(kBeta2, step);
  at::_foreach_mul_(s.first, kBeta1);
  at::_foreach_add_(s.first, s.gradients, 1 - kBeta1);
  at::_foreach_mul_(s.second, kBeta2);
  at::_foreach_addcmul_(s.second, s.gradients, s.gradients, 1 - kBeta2);
  std::vector<Tensor> roots = at::_foreach_sqrt(s.second);
  at::_foreach_div_(roots, std::sqrt(correction2));
  at::_foreach_add_(roots, kEpsilon);
  at::_foreach_addcdiv_(s.weights, s.first, roots, -kLearningRate / correction1);
}

/// Each scales the gradients, as clipping their norm does.
void add_adam(const Network& network, const std::vector<std::vector<std::int64_t>>& sizes) {
  const auto add_one = [&](const std::string& implementation, auto run) {
    add("adam/" + network.name + "/" + implementation + "/step", [=](benchmark::State& state) {
      const torch::NoGradGuard no_gradient;
      AdamState adam = make_adam_state(sizes);
      std::int64_t step = 0;
      try {
        for (auto _ : state) run(adam, ++step);
      } catch (const c10::Error&) {
        state.SkipWithError("this libtorch lacks a CPU kernel for it");
      }
    });
  };
  add_one("ours", [](AdamState& s, std::int64_t step) {
    for (std::size_t i = 0; i < s.weights.size(); ++i)
      adam_step({.learning_rate = kLearningRate, .epsilon = kEpsilon}, step, kScale, elements_of(s.gradients[i]), elements_of(s.first[i]),
                elements_of(s.second[i]), elements_of(s.weights[i]));
  });
  add_one("torch_for_each", [](AdamState& s, std::int64_t step) {
    s.flat.mul_(kScale);
    adam_for_each(s, step);
  });
  // Its own grad_scale costs more than this pass.
  add_one("torch_fused", [](AdamState& s, std::int64_t) {
    at::_foreach_add_(s.steps, 1);
    s.flat.mul_(kScale);
    at::_fused_adam_(s.weights, s.gradients, s.first, s.second, {}, s.steps, kLearningRate, kBeta1, kBeta2, 0.0, kEpsilon, false, false);
  });
  add("adam/" + network.name + "/torch_optimizer/step", [=](benchmark::State& state) {
    AdamState adam = make_adam_state(sizes);
    torch::optim::Adam optimizer(adam.weights, torch::optim::AdamOptions(kLearningRate).eps(kEpsilon));
    for (auto _ : state) {
      adam.flat.mul_(kScale);
      optimizer.step();
    }
  });
}

void add_network(const Network& n) {
  const std::int64_t rows = n.T * n.B, features = 2 * n.encoder_features + n.vector_features, hidden = n.hidden;
  const std::vector<ConvLayer> eyes = visual_layers(n.conv_channels), ears = audio_layers(kSoundRows, kSoundColumns, n.conv_channels);
  add_convolutions("camera/" + n.name, rows, n.envs, n.camera_px, n.camera_px, 1, eyes);
  add_convolutions("sound/" + n.name, rows, n.envs, kSoundRows, kSoundColumns, n.sound_channels, ears);
  add_recurrence(n);
  const Stack camera = make_stack(n.camera_px, n.camera_px, 1, eyes), sound = make_stack(kSoundRows, kSoundColumns, n.sound_channels, ears);
  add_linear("linear_of_camera/" + n.name, rows, n.envs, camera.features, n.encoder_features);
  add_linear("linear_of_sound/" + n.name, rows, n.envs, sound.features, n.encoder_features);
  add_linear("linear_of_gru/" + n.name, rows, n.envs, features, 3 * hidden);
  add_product("product_of_encoder/" + n.name, rows, n.encoder_features, camera.features, false, true);
  add_product("product_of_gru_step/" + n.name, n.B, 3 * hidden, hidden, false, false);
  add_product("product_of_gru_step_back/" + n.name, n.B, hidden, 3 * hidden, false, false);
  add_product("product_of_gru_weights/" + n.name, 3 * hidden, hidden, rows, true, false);
  std::vector<std::vector<std::int64_t>> sizes;
  for (const Stack& stack : {camera, sound}) {
    for (const Tensor& leaf : stack.leaves) sizes.push_back(leaf.sizes().vec());
    sizes.insert(sizes.end(), {{n.encoder_features, stack.features}, {n.encoder_features}});
  }
  sizes.insert(sizes.end(), {{3 * hidden, features}, {3 * hidden, hidden}, {3 * hidden}, {3 * hidden}, {4, hidden}, {4}, {1, hidden}, {1}});
  add_adam(n, sizes);
}

[[maybe_unused]] const bool kAdded = [] {
  for (const Network& network : kNetworks) add_network(network);
  return true;
}();

}  // namespace
}  // namespace earshot
