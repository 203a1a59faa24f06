// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/nn/module.h>
#include <torch/nn/modules/conv.h>
#include <torch/nn/modules/linear.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>

#include <string>
#include <vector>

namespace earshot {

/// One convolution of a stack: square kernel, no padding.
struct ConvLayer {
  int kernel = 1, stride = 1, channels = 1;
};

/// Layers for camera pictures: 8/4, 4/2, 3/2 (docs/reference/formats.md, section 6.5); `channels` of the first layer, twice as many in the
/// others.
std::vector<ConvLayer> visual_layers(int channels);
/// Layers for spectrograms: 5/2, 3/2, 3/1 where a side is below 30, else 8/4, 4/2, 3/1.
std::vector<ConvLayer> audio_layers(int rows, int columns, int channels);

/// Three convolutions with ReLU between them (none after the last: the original has none there), then a linear layer with ReLU.
class ConvEncoderImpl : public torch::nn::Module {
 public:
  /// name: of the sensor, for messages.  Throws InputError if the picture is too small for the layers.
  ConvEncoderImpl(const std::string& name, int height, int width, int input_channels, const std::vector<ConvLayer>& layers, int features);

  /// [N, height, width, input_channels] -> [N, features].  N may be 0.
  torch::Tensor forward(const torch::Tensor& pictures);

 private:
  std::vector<torch::nn::Conv2d> convolutions_;
  torch::nn::Linear linear_{nullptr};
};
TORCH_MODULE(ConvEncoder);

}  // namespace earshot
