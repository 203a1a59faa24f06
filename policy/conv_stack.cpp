// SPDX-License-Identifier: Apache-2.0
#include "policy/conv_stack.h"

#include <torch/csrc/autograd/custom_function.h>

#include <algorithm>

#include "policy/matrix_product.h"
#include "policy/picture_patches.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

/// Of this many patches a product is about as fast as of more.
constexpr std::int64_t kPatchesPerProduct = 192;
/// Pictures that go through all layers together, so that the output of a layer is still in the cache for the next.
constexpr std::int64_t kPicturesPerBlock = 4;

struct Layer {
  PatchShape shape;
  std::int64_t out_channels = 0;
  // As the products want it: [kernel, kernel, in, out] on the way forward, [out, kernel, kernel, in] on the way back.
  torch::Tensor weight = {};
  torch::Tensor bias = {};

  [[nodiscard]] std::int64_t out_size() const { return shape.num_patches() * out_channels; }
  [[nodiscard]] std::int64_t pictures_per_product() const {
    return std::clamp<std::int64_t>(kPatchesPerProduct / shape.num_patches(), 1, kPicturesPerBlock);
  }
};
using Layers = std::array<Layer, kStackLayers>;

Layers layers_of(const torch::Tensor& pictures, const std::array<torch::Tensor, kStackLayers>& weights,
                 const std::array<torch::Tensor, kStackLayers>& biases, const std::array<int, kStackLayers>& strides, bool forward) {
  const std::array<std::int64_t, 4> order = forward ? std::array<std::int64_t, 4>{2, 3, 1, 0} : std::array<std::int64_t, 4>{0, 2, 3, 1};
  Layers layers;
  std::int64_t rows = pictures.size(1), columns = pictures.size(2), channels = pictures.size(3);
  for (std::size_t i = 0; i < kStackLayers; ++i) {
    const torch::Tensor& weight = weights[i];
    EARSHOT_EXPECT(weight.dim() == 4 && weight.size(1) == channels && weight.size(2) == weight.size(3) &&
                   weight.size(2) <= std::min(rows, columns));
    layers[i] = {.shape = {.in_rows = rows, .in_columns = columns, .in_channels = channels, .kernel = weight.size(2), .stride = strides[i]},
                 .out_channels = weight.size(0),
                 .weight = weight.detach().permute(order).contiguous(),
                 .bias = biases[i].detach().contiguous()};
    rows = layers[i].shape.out_rows();
    columns = layers[i].shape.out_columns();
    channels = layers[i].out_channels;
  }
  return layers;
}

/// Room for the patches of one product of any layer.
torch::Tensor patches_scratch(const Layers& layers) {
  std::int64_t size = 0;
  for (const Layer& layer : layers)
    size = std::max(size, layer.pictures_per_product() * layer.shape.num_patches() * layer.shape.patch_size());
  return torch::empty({size});
}

void gather(const Layer& layer, const float* pictures, std::int64_t count, float* patches) {
  const std::int64_t size = layer.shape.num_patches() * layer.shape.patch_size();
  for (std::int64_t i = 0; i < count; ++i) copy_patches(layer.shape, pictures + i * layer.shape.picture_size(), patches + i * size);
}

void add_bias(float* rows, std::int64_t count, std::int64_t channels, const float* bias) {
  for (std::int64_t row = 0; row < count; ++row, rows += channels)
    for (std::int64_t c = 0; c < channels; ++c) rows[c] += bias[c];
}

/// max(x + bias, 0); NaN stays NaN.
void add_bias_and_cut(float* rows, std::int64_t count, std::int64_t channels, const float* bias) {
  for (std::int64_t row = 0; row < count; ++row, rows += channels)
    for (std::int64_t c = 0; c < channels; ++c) {
      const float x = rows[c] + bias[c];
      rows[c] = x < 0.f ? 0.f : x;
    }
}

/// One layer of `count` pictures, [count, out rows, out columns, out channels].
void forward_layer(const Layer& layer, const float* pictures, std::int64_t count, float* patches, float* outputs, bool cut) {
  const std::int64_t rows = layer.shape.num_patches(), size = layer.shape.patch_size(), channels = layer.out_channels;
  for (std::int64_t first = 0; first < count;) {
    const std::int64_t pictures_now = std::min(layer.pictures_per_product(), count - first);
    float* out = outputs + first * layer.out_size();
    gather(layer, pictures + first * layer.shape.picture_size(), pictures_now, patches);
    multiply({.m = pictures_now * rows, .n = channels, .k = size}, patches, size, layer.weight.data_ptr<float>(), channels, out, channels);
    if (cut)
      add_bias_and_cut(out, pictures_now * rows, channels, layer.bias.data_ptr<float>());
    else
      add_bias(out, pictures_now * rows, channels, layer.bias.data_ptr<float>());
    first += pictures_now;
  }
}

/// Adds to the gradients of weight and bias, and to that of the pictures if not null.  by_outputs: as outputs of forward_layer.
void backward_layer(const Layer& layer, const float* pictures, const float* by_outputs, std::int64_t count, float* patches,
                    float* by_patches, float* by_weight, float* by_bias, float* by_pictures) {
  const std::int64_t rows = layer.shape.num_patches(), size = layer.shape.patch_size(), channels = layer.out_channels;
  for (std::int64_t first = 0; first < count;) {
    const std::int64_t pictures_now = std::min(layer.pictures_per_product(), count - first);
    const float* by_out = by_outputs + first * layer.out_size();
    gather(layer, pictures + first * layer.shape.picture_size(), pictures_now, patches);
    multiply({.m = channels, .n = size, .k = pictures_now * rows, .transpose_a = true, .beta = 1}, by_out, channels, patches, size,
             by_weight, size);
    for (std::int64_t row = 0; row < pictures_now * rows; ++row)
      for (std::int64_t c = 0; c < channels; ++c) by_bias[c] += by_out[row * channels + c];
    if (by_pictures != nullptr) {
      multiply({.m = pictures_now * rows, .n = size, .k = channels}, by_out, channels, layer.weight.data_ptr<float>(), size, by_patches,
               size);
      for (std::int64_t i = 0; i < pictures_now; ++i)
        add_patches(layer.shape, by_patches + i * rows * size, by_pictures + (first + i) * layer.shape.picture_size());
    }
    first += pictures_now;
  }
}

/// [positions, channels] -> [channels, positions].
void transpose(const float* from, std::int64_t positions, std::int64_t channels, float* to) {
  for (std::int64_t c = 0; c < channels; ++c)
    for (std::int64_t p = 0; p < positions; ++p) to[c * positions + p] = from[p * channels + c];
}

/// The derivative of ReLU, by what came out of it.
void cut_gradient(const float* outputs, std::int64_t count, float* gradient) {
  for (std::int64_t i = 0; i < count; ++i) gradient[i] = outputs[i] > 0.f ? gradient[i] : 0.f;
}

class ConvStack : public torch::autograd::Function<ConvStack> {
 public:
  static torch::Tensor forward(AutogradContext* context, const torch::Tensor& pictures, const torch::Tensor& w0, const torch::Tensor& b0,
                               const torch::Tensor& w1, const torch::Tensor& b1, const torch::Tensor& w2, const torch::Tensor& b2,
                               const std::array<int, kStackLayers>& strides) {
    const Layers layers = layers_of(pictures, {w0, w1, w2}, {b0, b1, b2}, strides, true);
    const std::int64_t N = pictures.size(0);
    const torch::Tensor input = pictures.contiguous();
    const torch::Tensor first = torch::empty({N, layers[0].out_size()}), second = torch::empty({N, layers[1].out_size()});
    const torch::Tensor features = torch::empty({N, layers[2].out_size()});
    const torch::Tensor patches = patches_scratch(layers), last = torch::empty({kPicturesPerBlock, layers[2].out_size()});
    float* scratch = patches.data_ptr<float>();
    for (std::int64_t n = 0; n < N; n += kPicturesPerBlock) {
      const std::int64_t count = std::min(kPicturesPerBlock, N - n);
      float *first_out = first.data_ptr<float>() + n * layers[0].out_size(),
            *second_out = second.data_ptr<float>() + n * layers[1].out_size();
      forward_layer(layers[0], input.data_ptr<float>() + n * layers[0].shape.picture_size(), count, scratch, first_out, true);
      forward_layer(layers[1], first_out, count, scratch, second_out, true);
      forward_layer(layers[2], second_out, count, scratch, last.data_ptr<float>(), false);
      for (std::int64_t i = 0; i < count; ++i)
        transpose(last.data_ptr<float>() + i * layers[2].out_size(), layers[2].shape.num_patches(), layers[2].out_channels,
                  features.data_ptr<float>() + (n + i) * layers[2].out_size());
    }
    context->save_for_backward({input, first, second, w0, b0, w1, b1, w2, b2});
    context->saved_data["strides"] = std::vector<std::int64_t>(strides.begin(), strides.end());
    return features;
  }

  static variable_list backward(AutogradContext* context, variable_list outputs) {
    const variable_list saved = context->get_saved_variables();
    const torch::Tensor &input = saved[0], &first = saved[1], &second = saved[2];
    const std::vector<std::int64_t> steps = context->saved_data["strides"].toIntVector();
    std::array<int, kStackLayers> strides{};
    std::transform(steps.begin(), steps.end(), strides.begin(), [](std::int64_t step) { return static_cast<int>(step); });
    const Layers layers = layers_of(input, {saved[3], saved[5], saved[7]}, {saved[4], saved[6], saved[8]}, strides, false);
    const torch::Tensor by_features = outputs[0].contiguous();
    std::array<torch::Tensor, kStackLayers> by_weight, by_bias;
    for (std::size_t i = 0; i < kStackLayers; ++i) {
      by_weight[i] = torch::zeros_like(layers[i].weight);
      by_bias[i] = torch::zeros_like(layers[i].bias);
    }
    const auto weight = [&](std::size_t i) { return by_weight[i].data_ptr<float>(); };
    const auto bias = [&](std::size_t i) { return by_bias[i].data_ptr<float>(); };

    const std::int64_t N = input.size(0);
    const torch::Tensor patches = patches_scratch(layers), by_patches = torch::empty_like(patches);
    const torch::Tensor by_last = torch::empty({kPicturesPerBlock, layers[2].out_size()});
    const torch::Tensor by_second = torch::empty({kPicturesPerBlock, layers[1].out_size()});
    const torch::Tensor by_first = torch::empty({kPicturesPerBlock, layers[0].out_size()});
    float *scratch = patches.data_ptr<float>(), *by_scratch = by_patches.data_ptr<float>();
    float *by_third_out = by_last.data_ptr<float>(), *by_second_out = by_second.data_ptr<float>(),
          *by_first_out = by_first.data_ptr<float>();
    for (std::int64_t n = 0; n < N; n += kPicturesPerBlock) {
      const std::int64_t count = std::min(kPicturesPerBlock, N - n);
      const float* first_out = first.data_ptr<float>() + n * layers[0].out_size();
      const float* second_out = second.data_ptr<float>() + n * layers[1].out_size();
      for (std::int64_t i = 0; i < count; ++i)
        transpose(by_features.data_ptr<float>() + (n + i) * layers[2].out_size(), layers[2].out_channels, layers[2].shape.num_patches(),
                  by_third_out + i * layers[2].out_size());
      std::fill_n(by_second_out, count * layers[1].out_size(), 0.f);
      backward_layer(layers[2], second_out, by_third_out, count, scratch, by_scratch, weight(2), bias(2), by_second_out);
      cut_gradient(second_out, count * layers[1].out_size(), by_second_out);
      std::fill_n(by_first_out, count * layers[0].out_size(), 0.f);
      backward_layer(layers[1], first_out, by_second_out, count, scratch, by_scratch, weight(1), bias(1), by_first_out);
      cut_gradient(first_out, count * layers[0].out_size(), by_first_out);
      backward_layer(layers[0], input.data_ptr<float>() + n * layers[0].shape.picture_size(), by_first_out, count, scratch, nullptr,
                     weight(0), bias(0), nullptr);
    }
    const auto as_weight = [](const torch::Tensor& gradient) { return gradient.permute({0, 3, 1, 2}); };
    return {torch::Tensor(), as_weight(by_weight[0]), by_bias[0], as_weight(by_weight[1]),
            by_bias[1],      as_weight(by_weight[2]), by_bias[2], torch::Tensor()};
  }
};

}  // namespace

torch::Tensor conv_stack(const torch::Tensor& pictures, const std::array<torch::Tensor, kStackLayers>& weights,
                         const std::array<torch::Tensor, kStackLayers>& biases, const std::array<int, kStackLayers>& strides) {
  EARSHOT_EXPECT(pictures.dim() == 4 && pictures.scalar_type() == torch::kFloat32 && !pictures.requires_grad());
  return ConvStack::apply(pictures, weights[0], biases[0], weights[1], biases[1], weights[2], biases[2], strides);
}

}  // namespace earshot
