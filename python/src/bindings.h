// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstddef>
#include <initializer_list>
#include <utility>
#include <vector>

namespace earshot::python {

namespace nb = nanobind;

template <class T>
using Array = nb::ndarray<nb::numpy, T>;
template <class T>
using Input = nb::ndarray<const T, nb::c_contig, nb::device::cpu>;

/// An array that owns `values`, without a copy.
template <class T>
Array<T> array_of(std::vector<T> values, std::initializer_list<std::size_t> shape) {
  auto* owned = new std::vector<T>(std::move(values));
  const nb::capsule owner(owned, [](void* memory) noexcept { delete static_cast<std::vector<T>*>(memory); });
  return Array<T>(owned->data(), shape.size(), shape.begin(), owner);
}

/// Each adds its classes to the module; bind_forks() the functions that python/earshot/_runtime.py registers.
void bind_errors(nb::module_& m);
void bind_forks(nb::module_& m);
void bind_scene(nb::module_& m);
void bind_navigation(nb::module_& m);
void bind_response(nb::module_& m);
void bind_batch(nb::module_& m);
void bind_corpora(nb::module_& m);

}  // namespace earshot::python
