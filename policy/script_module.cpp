// SPDX-License-Identifier: Apache-2.0
#include "policy/script_module.h"

#include <fmt/format.h>
#include <torch/csrc/jit/passes/inliner.h>
#include <torch/csrc/jit/runtime/graph_executor.h>
#include <torch/script.h>
#include <torch/version.h>

#include <algorithm>
#include <array>
#include <functional>
#include <map>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "sim/base/errors.h"

namespace earshot {
namespace {

using torch::jit::IValue;

/// Longest reason of libtorch in a message.
constexpr std::size_t kMaxReason = 300;

/// The line of an error of libtorch that says what is wrong: its texts have traces of calls before and behind.
std::string reason_of(const std::exception& error) {
  const auto* own = dynamic_cast<const c10::Error*>(&error);
  std::istringstream lines(own != nullptr ? own->what_without_backtrace() : error.what());
  std::string first, named;
  for (std::string line; std::getline(lines, line);) {
    if (const auto at = line.find("Error: "); at != std::string::npos && line.find(' ') == at + 6) named = line.substr(at + 7);
    if (first.empty()) first = line;
  }
  std::string reason = (named.empty() ? first : named).substr(0, kMaxReason);
  std::ranges::replace_if(
      reason, [](unsigned char c) { return c < 0x20 || c >= 0x7f; }, '?');
  while (!reason.empty() && (reason.back() == '.' || reason.back() == ' ' || reason.back() == ':')) reason.pop_back();
  return reason;
}

/// The operator that libtorch did not find; empty if the error is another one.
std::string unknown_operator(const std::string& text) {
  for (const std::string_view phrase : {"Unknown builtin op: ", "Unknown type name '"}) {
    const auto at = text.find(phrase);
    if (at == std::string::npos) continue;
    const std::string name = text.substr(at + phrase.size(), 80);
    const std::string word = name.substr(0, name.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_:."));
    return word.substr(0, word.find_last_not_of('.') + 1);  // the end of a sentence
  }
  return "";
}

/// What an operator would do that no policy may; null if it is harmless.
const char* forbidden_effect_of(std::string_view name) {
  constexpr std::array<std::pair<std::string_view, const char*>, 15> refused{{{"aten::from_file", "opens a file"},
                                                                              {"aten::save", "writes a file"},
                                                                              {"prim::fork", "starts a thread"},
                                                                              {"prim::PythonOp", "calls Python"},
                                                                              {"prim::Print", "prints"},
                                                                              {"prim::rpc", "calls another machine"},
                                                                              {"aten::rand", "draws a random number"},
                                                                              {"aten::normal", "draws a random number"},
                                                                              {"aten::bernoulli", "draws a random number"},
                                                                              {"aten::multinomial", "draws a random number"},
                                                                              {"aten::poisson", "draws a random number"},
                                                                              {"aten::uniform", "draws a random number"},
                                                                              {"aten::exponential", "draws a random number"},
                                                                              {"aten::manual_seed", "sets the random generator"},
                                                                              {"aten::seed", "sets the random generator"}}};
  for (const auto& [start, effect] : refused)
    if (name.starts_with(start)) return effect;
  if (!name.starts_with("aten::") && !name.starts_with("prim::") && !name.starts_with("prims::")) return "is of no part of libtorch itself";
  return nullptr;
}

void for_each_node(torch::jit::Block* block, const std::function<void(torch::jit::Node*)>& visit) {
  for (torch::jit::Node* node : block->nodes()) {
    visit(node);
    for (torch::jit::Block* inner : node->blocks()) for_each_node(inner, visit);
  }
}

/// All methods of the module and its parts, with the functions that they call.
void for_each_operator(const torch::jit::Module& module, const std::function<void(torch::jit::Node*)>& visit) {
  for (const torch::jit::Module& part : module.modules())
    for (const torch::jit::Method& method : part.get_methods()) {
      const auto graph = method.graph()->copy();
      torch::jit::Inline(*graph);
      for_each_node(graph->block(), visit);
    }
}

torch::jit::Module load_module(const std::string& bytes, const std::string& where) {
  const std::string remedy = "write it with torch.jit.script(module).save(FILE)";
  if (!bytes.starts_with("PK")) throw InputError(where, "is not a TorchScript file", remedy);
  try {
    std::istringstream stream(bytes);
    return torch::jit::load(stream, torch::kCPU);
  } catch (const std::exception& error) {
    if (const std::string name = unknown_operator(error.what()); !name.empty())
      throw InputError(where, fmt::format("uses {}, which libtorch {} does not have", name, TORCH_VERSION),
                       "write the module without it, or build Earshot with the libtorch that it was written with");
    throw InputError(where, "cannot be read as TorchScript: " + reason_of(error), remedy);
  }
}

}  // namespace

struct ScriptModule::Model {
  torch::jit::Module module;
  std::vector<NamedTensor> tensors = {};

  void collect_tensors(const std::string& where);
  void add(torch::jit::Module part, const std::string& prefix, const std::string& where);
};

/// Weights that stand in several places come from the file as tensors of the same memory; they become one tensor again.  Others get memory
/// of their own.
void ScriptModule::Model::add(torch::jit::Module part, const std::string& prefix, const std::string& where) {
  const auto note = [&](const std::string& name, const torch::Tensor& tensor, bool is_parameter) {
    const std::string full = prefix + name;
    if (is_parameter && tensor.scalar_type() != torch::kFloat32)
      throw InputError(where, fmt::format("parameter '{}' is {}", full, torch::toString(tensor.scalar_type())),
                       "make it float32: module.float()");
    if (tensor.is_sparse() || tensor.is_quantized() || tensor.is_complex())
      throw InputError(where, fmt::format("tensor '{}' is no plain tensor of real numbers", full), "make it dense");
    for (const NamedTensor& other : tensors) {
      if (tensor.numel() == 0 || other.is_parameter != is_parameter || other.tensor.data_ptr() != tensor.data_ptr()) continue;
      if (other.tensor.sizes() != tensor.sizes() || other.tensor.strides() != tensor.strides())
        throw InputError(where, fmt::format("'{}' and '{}' share memory in different shapes", other.name, full),
                         "give each its own memory");
      part.setattr(name, other.tensor);
      return;
    }
    tensors.push_back({full, tensor, is_parameter});
  };
  for (const auto& item : part.named_parameters(false)) note(item.name, item.value, true);
  for (const auto& item : part.named_buffers(false)) note(item.name, item.value, false);
  for (const auto& child : part.named_children()) add(child.value, prefix + child.name + ".", where);
}

void ScriptModule::Model::collect_tensors(const std::string& where) {
  add(module, "", where);
  std::ranges::stable_partition(tensors, [](const NamedTensor& item) { return item.is_parameter; });
  const torch::NoGradGuard no_gradient;
  for (NamedTensor& item : tensors) item.tensor.set_data(item.tensor.detach().clone(at::MemoryFormat::Contiguous));
}

ScriptModule::ScriptModule(const std::string& bytes, const std::string& where)
    : model_(std::make_unique<Model>(Model{load_module(bytes, where)})) {
  for_each_operator(model_->module, [&](torch::jit::Node* node) {
    const std::string name = node->kind().toQualString();
    if (const char* effect = forbidden_effect_of(name))
      throw InputError(where, fmt::format("uses the operator {}, which {}", name, effect), "write the module without it");
  });
  model_->module.eval();
  model_->collect_tensors(where);
}

ScriptModule::~ScriptModule() = default;

const std::vector<ScriptModule::NamedTensor>& ScriptModule::tensors() const { return model_->tensors; }

bool ScriptModule::has(const std::string& method) const { return model_->module.find_method(method).has_value(); }

std::set<std::string> ScriptModule::observations_read() const {
  std::set<std::string> names;
  for_each_operator(model_->module, [&](torch::jit::Node* node) {
    if (std::string_view(node->kind().toQualString()) != "aten::__getitem__") return;
    if (node->input(0)->type()->kind() != c10::TypeKind::DictType) return;
    if (const auto key = torch::jit::toIValue(node->input(1)); key && key->isString()) names.insert(key->toStringRef());
  });
  return names;
}

std::vector<torch::Tensor> ScriptModule::call(const std::string& method, const ObservationTensors& observations, const torch::Tensor& state,
                                              const torch::Tensor& begins) {
  const torch::jit::GraphOptimizerEnabledGuard optimizer_off(false);
  c10::Dict<std::string, torch::Tensor> named;
  for (const auto& [name, rows] : observations.sensors) named.insert(name, rows);
  std::vector<IValue> arguments{named, state};
  if (begins.defined()) arguments.emplace_back(begins);
  IValue result;
  try {
    result = model_->module.get_method(method)(std::move(arguments));
  } catch (const std::exception& error) {
    throw std::runtime_error(method + " fails: " + reason_of(error));
  }
  if (!result.isTuple()) throw std::runtime_error(method + " does not return a tuple of tensors");
  std::vector<torch::Tensor> tensors;
  for (const IValue& item : result.toTupleRef().elements()) {
    if (!item.isTensor()) throw std::runtime_error(method + " returns something else than tensors in its tuple");
    tensors.push_back(item.toTensor());
  }
  return tensors;
}

torch::Tensor ScriptModule::constant(const std::string& method) {
  const torch::jit::GraphOptimizerEnabledGuard optimizer_off(false);
  IValue result;
  try {
    result = model_->module.get_method(method)({});
  } catch (const std::exception& error) {
    throw std::runtime_error(method + " fails: " + reason_of(error));
  }
  if (!result.isTensor()) throw std::runtime_error(method + " does not return a tensor");
  return result.toTensor();
}

void warm_up_script_modules() {
  torch::jit::Module module("Small");
  module.register_parameter("weight", torch::ones({1}), false);
  module.define("def forward(self) -> Tensor:\n    return self.weight * 2\n");
  std::ostringstream file;
  module.save(file);
  static_cast<void>(ScriptModule(file.str(), "a small module").constant("forward"));
}

}  // namespace earshot
