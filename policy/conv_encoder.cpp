#include "policy/conv_encoder.h"

#include <fmt/format.h>

#include <algorithm>

#include "sim/base/errors.h"

namespace earshot {

std::vector<ConvLayer> visual_layers(int channels) { return {{8, 4, channels}, {4, 2, 2 * channels}, {3, 2, 2 * channels}}; }

std::vector<ConvLayer> audio_layers(int rows, int columns, int channels) {
  if (std::min(rows, columns) < 30) return {{5, 2, channels}, {3, 2, 2 * channels}, {3, 1, 2 * channels}};
  return {{8, 4, channels}, {4, 2, 2 * channels}, {3, 1, 2 * channels}};
}

ConvEncoderImpl::ConvEncoderImpl(const std::string& name, int height, int width, int input_channels, const std::vector<ConvLayer>& layers,
                                 int features) {
  int rows = height, columns = width, channels = input_channels;
  for (const ConvLayer& layer : layers) {
    if (std::min(rows, columns) < layer.kernel)
      throw InputError(fmt::format("{} of {} x {}", name, height, width),
                       fmt::format("is too small for the encoder: convolution {} needs {} x {} and gets {} x {}", convolutions_.size() + 1,
                                   layer.kernel, layer.kernel, rows, columns),
                       "use a larger picture, or switch the sensor off");
    const auto options = torch::nn::Conv2dOptions(channels, layer.channels, layer.kernel).stride(layer.stride);
    convolutions_.push_back(register_module(fmt::format("conv{}", convolutions_.size() + 1), torch::nn::Conv2d(options)));
    rows = (rows - layer.kernel) / layer.stride + 1;
    columns = (columns - layer.kernel) / layer.stride + 1;
    channels = layer.channels;
  }
  linear_ = register_module("linear", torch::nn::Linear(rows * columns * channels, features));
}

torch::Tensor ConvEncoderImpl::forward(const torch::Tensor& pictures) {
  // [N, height, width, channels] in memory is what torch calls channels-last: the permuted view needs no copy, and every layer keeps that
  // order. The whole batch at once: passes of 8 to 64 pictures, whose activations fit the cache, were up to a third slower.
  torch::Tensor x = pictures.permute({0, 3, 1, 2});  // [N, channels, height, width]
  for (std::size_t layer = 0; layer < convolutions_.size(); ++layer) {
    x = convolutions_[layer]->forward(x);
    if (layer + 1 < convolutions_.size()) x = x.relu_();
  }
  return linear_->forward(x.flatten(1)).relu_();
}

}  // namespace earshot
