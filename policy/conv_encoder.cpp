// SPDX-License-Identifier: Apache-2.0
#include "policy/conv_encoder.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "policy/conv_stack.h"
#include "policy/matrix_product.h"
#include "sim/base/errors.h"

namespace earshot {

std::vector<ConvLayer> visual_layers(int channels) { return {{8, 4, channels}, {4, 2, 2 * channels}, {3, 2, 2 * channels}}; }

std::vector<ConvLayer> audio_layers(int rows, int columns, int channels) {
  if (std::min(rows, columns) < 30) return {{5, 2, channels}, {3, 2, 2 * channels}, {3, 1, 2 * channels}};
  return {{8, 4, channels}, {4, 2, 2 * channels}, {3, 1, 2 * channels}};
}

ConvEncoderImpl::ConvEncoderImpl(const std::string& name, int height, int width, int input_channels, const std::vector<ConvLayer>& layers,
                                 int features) {
  EARSHOT_EXPECT(layers.size() == kStackLayers);
  int rows = height, columns = width, channels = input_channels;
  for (const ConvLayer& layer : layers) {
    if (std::min(rows, columns) < layer.kernel)
      throw InputError(fmt::format("{} of {} x {}", name, height, width),
                       fmt::format("is too small for the encoder: convolution {} needs {} x {} and gets {} x {}", convolutions_.size() + 1,
                                   layer.kernel, layer.kernel, rows, columns),
                       "use a larger image, or switch the sensor off");
    const auto options = torch::nn::Conv2dOptions(channels, layer.channels, layer.kernel).stride(layer.stride);
    convolutions_.push_back(register_module(fmt::format("conv{}", convolutions_.size() + 1), torch::nn::Conv2d(options)));
    rows = (rows - layer.kernel) / layer.stride + 1;
    columns = (columns - layer.kernel) / layer.stride + 1;
    channels = layer.channels;
  }
  linear_ = register_module("linear", torch::nn::Linear(rows * columns * channels, features));
}

torch::Tensor ConvEncoderImpl::forward(const torch::Tensor& pictures) {
  const auto of_layers = [&](const auto& value) { return std::array{value(0), value(1), value(2)}; };
  const torch::Tensor features =
      conv_stack(pictures, of_layers([&](std::size_t i) { return convolutions_[i]->weight; }),
                 of_layers([&](std::size_t i) { return convolutions_[i]->bias; }),
                 of_layers([&](std::size_t i) { return static_cast<int>(convolutions_[i]->options.stride()->at(0)); }));
  return linear_layer(features, linear_->weight, linear_->bias).relu_();
}

}  // namespace earshot
