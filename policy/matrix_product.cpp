// SPDX-License-Identifier: Apache-2.0
#include "policy/matrix_product.h"

#include <ATen/Parallel.h>
#include <ATen/ops/addmm.h>
#include <ATen/ops/mm.h>
#include <dlfcn.h>
#include <torch/csrc/autograd/custom_function.h>

#include "sim/base/errors.h"

namespace earshot {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

/// dnnl_sgemm of oneDNN's C interface (dnnl.h): row-major, 0 for success.
using OneDnnSgemm = int (*)(char transpose_a, char transpose_b, std::int64_t m, std::int64_t n, std::int64_t k, float alpha, const float* a,
                            std::int64_t lda, const float* b, std::int64_t ldb, float beta, float* c, std::int64_t ldc);

/// Null where libtorch has oneDNN inside, out of reach.
OneDnnSgemm find_onednn() { return reinterpret_cast<OneDnnSgemm>(dlsym(RTLD_DEFAULT, "dnnl_sgemm")); }

torch::Tensor view_of(const float* data, std::int64_t rows, std::int64_t columns, std::int64_t stride) {
  // from_blob wants a mutable pointer; only c is written.
  return torch::from_blob(const_cast<float*>(data), {rows, columns}, {stride, 1});
}

void multiply_by_blas(const MatrixProduct& p, const float* a, std::int64_t lda, const float* b, std::int64_t ldb, float* c,
                      std::int64_t ldc) {
  const torch::NoGradGuard no_gradient;
  const torch::Tensor left = p.transpose_a ? view_of(a, p.k, p.m, lda).t() : view_of(a, p.m, p.k, lda);
  const torch::Tensor right = p.transpose_b ? view_of(b, p.n, p.k, ldb).t() : view_of(b, p.k, p.n, ldb);
  torch::Tensor result = view_of(c, p.m, p.n, ldc);
  at::addmm_out(result, result, left, right, p.beta);
}

class LinearLayer : public torch::autograd::Function<LinearLayer> {
 public:
  static torch::Tensor forward(AutogradContext* context, const torch::Tensor& x, const torch::Tensor& weight, const torch::Tensor& bias) {
    const torch::Tensor rows = x.contiguous();
    torch::Tensor y = bias.expand({rows.size(0), bias.size(0)}).clone(at::MemoryFormat::Contiguous);
    multiply_into(y, rows, false, weight, true, 1);
    context->save_for_backward({rows, weight});
    return y;
  }

  static variable_list backward(AutogradContext* context, variable_list outputs) {
    const variable_list saved = context->get_saved_variables();
    const torch::Tensor &x = saved[0], &weight = saved[1], gradient = outputs[0].contiguous();
    torch::Tensor by_weight = torch::empty_like(weight), by_x;
    multiply_into(by_weight, gradient, true, x, false);
    if (context->needs_input_grad(0)) {
      by_x = torch::empty_like(x);
      multiply_into(by_x, gradient, false, weight, false);
    }
    return {by_x, by_weight, gradient.sum(0)};
  }
};

}  // namespace

void multiply(const MatrixProduct& p, const float* a, std::int64_t lda, const float* b, std::int64_t ldb, float* c, std::int64_t ldc) {
  static const OneDnnSgemm onednn = find_onednn();
  if (p.m == 0 || p.n == 0) return;
  if (onednn == nullptr || p.k == 0) return multiply_by_blas(p, a, lda, b, ldb, c, ldc);
  at::internal::lazy_init_num_threads();  // the number of threads that torch was given, on this thread too
  const int status = onednn(p.transpose_a ? 'T' : 'N', p.transpose_b ? 'T' : 'N', p.m, p.n, p.k, 1.f, a, lda, b, ldb, p.beta, c, ldc);
  if (status != 0) throw RunError("oneDNN", "failed to compute a matrix product");
}

void multiply_into(torch::Tensor& c, const torch::Tensor& a, bool transpose_a, const torch::Tensor& b, bool transpose_b, float beta) {
  EARSHOT_EXPECT(a.dim() == 2 && b.dim() == 2 && c.dim() == 2 && a.is_contiguous() && b.is_contiguous() && c.is_contiguous());
  const std::int64_t m = c.size(0), n = c.size(1), k = a.size(transpose_a ? 0 : 1);
  EARSHOT_EXPECT(a.size(transpose_a ? 1 : 0) == m && b.size(transpose_b ? 1 : 0) == k && b.size(transpose_b ? 0 : 1) == n);
  if (c.scalar_type() != torch::kFloat32) {
    const torch::NoGradGuard no_gradient;
    at::addmm_out(c, c, transpose_a ? a.t() : a, transpose_b ? b.t() : b, beta);
    return;
  }
  multiply({.m = m, .n = n, .k = k, .transpose_a = transpose_a, .transpose_b = transpose_b, .beta = beta}, a.data_ptr<float>(), a.size(1),
           b.data_ptr<float>(), b.size(1), c.data_ptr<float>(), n);
}

torch::Tensor linear_layer(const torch::Tensor& x, const torch::Tensor& weight, const torch::Tensor& bias) {
  std::vector<std::int64_t> sizes = x.sizes().vec();
  sizes.back() = weight.size(0);
  return LinearLayer::apply(x.reshape({-1, weight.size(1)}), weight, bias).view(sizes);
}

}  // namespace earshot
