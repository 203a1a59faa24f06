// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include <memory>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "policy/observation_tensors.h"

namespace earshot {

/// A TorchScript file in memory: its tensors by name, and its methods.
///
/// The reader is libtorch's, which compiles and may run code of the file while it reads: a file of others belongs in a process with limits.
/// What is read can neither open files, nor draw random numbers, nor start threads; such operators are refused by name.  Methods run as
/// they are written, without the optimizer of TorchScript, whose first calls have other bits than the later ones.  One thread at a time.
class ScriptModule {
 public:
  /// Throws InputError, one line: no TorchScript file, cut off, an operator that this libtorch lacks or that is refused, weights that are
  /// not float32.
  ScriptModule(const std::string& bytes, const std::string& where);
  ~ScriptModule();
  ScriptModule(const ScriptModule&) = delete;
  ScriptModule& operator=(const ScriptModule&) = delete;

  struct NamedTensor {
    std::string name;  ///< with dots between the parts
    torch::Tensor tensor;
    bool is_parameter = false;
  };
  /// Parameters, then buffers; the module's own tensors, not copies.  One that stands in several places is named once.
  [[nodiscard]] const std::vector<NamedTensor>& tensors() const;
  [[nodiscard]] bool has(const std::string& method) const;
  /// Names of observations that the module reads by a constant key.
  [[nodiscard]] std::set<std::string> observations_read() const;

  /// method(observations, state) or, with `begins`, method(observations, state, begins).  Returns the tensors of its tuple.  Throws
  /// std::runtime_error with one line.
  [[nodiscard]] std::vector<torch::Tensor> call(const std::string& method, const ObservationTensors& observations,
                                                const torch::Tensor& state, const torch::Tensor& begins = {});
  /// method(), a tensor.  Throws as call().
  [[nodiscard]] torch::Tensor constant(const std::string& method);

 private:
  struct Model;
  std::unique_ptr<Model> model_;
};

/// Writes, reads and calls a small module in memory: what TorchScript opens and allocates at its first use is there afterwards.
void warm_up_script_modules();

}  // namespace earshot
