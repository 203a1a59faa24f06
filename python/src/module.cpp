// SPDX-License-Identifier: Apache-2.0
#include <nanobind/stl/string.h>

#include "earshot/version.h"
#include "python/src/bindings.h"

namespace earshot::python {

void bind_errors(nb::module_& m) {
  nb::exception<RunError>(m, "RunError", PyExc_RuntimeError);
  nb::exception<InputError>(m, "InputError", PyExc_ValueError);
}

}  // namespace earshot::python

NB_MODULE(_engine, m) {
  m.attr("__version__") = earshot::version();
  m.attr("__compiler__") = earshot::compiler();
  m.def("ray_tracer_version", [] { return earshot::build_info().ray_tracer_version; });
  m.def("ray_tracer_isa", [] { return earshot::build_info().ray_tracer_isa; });
  earshot::python::bind_errors(m);
  earshot::python::bind_scene(m);
  earshot::python::bind_response(m);
  earshot::python::bind_batch(m);
}
