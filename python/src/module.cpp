#include <nanobind/stl/string.h>

#include "python/src/bindings.h"
#include "sim/base/compiler.h"
#include "sim/base/errors.h"
#include "sim/base/version.h"
#include "sim/rays/ray_tracer_version.h"

namespace earshot::python {

void bind_errors(nb::module_& m) {
  nb::exception<RunError>(m, "RunError", PyExc_RuntimeError);
  nb::exception<InputError>(m, "InputError", PyExc_ValueError);
}

}  // namespace earshot::python

NB_MODULE(_engine, m) {
  m.attr("__version__") = earshot::kVersion;
  m.attr("__compiler__") = earshot::compiler_name();
  m.def("ray_tracer_version", &earshot::ray_tracer_version);
  m.def("ray_tracer_isa", &earshot::ray_tracer_isa);
  earshot::python::bind_errors(m);
  earshot::python::bind_scene(m);
  earshot::python::bind_response(m);
  earshot::python::bind_batch(m);
}
