#include "python/src/bindings.h"
#include "sim/base/errors.h"
#include "sim/base/version.h"

namespace earshot::python {

void bind_errors(nb::module_& m) {
  nb::exception<RunError>(m, "RunError", PyExc_RuntimeError);
  nb::exception<InputError>(m, "InputError", PyExc_ValueError);
}

}  // namespace earshot::python

NB_MODULE(_engine, m) {
  m.attr("__version__") = earshot::kVersion;
  earshot::python::bind_errors(m);
  earshot::python::bind_scene(m);
  earshot::python::bind_response(m);
  earshot::python::bind_batch(m);
}
