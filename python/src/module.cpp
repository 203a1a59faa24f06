// SPDX-License-Identifier: Apache-2.0
#include <nanobind/stl/string.h>

#include <exception>
#include <string>
#include <string_view>
#include <system_error>

#include "earshot/version.h"
#include "python/src/bindings.h"
#include "python/src/interruptible.h"

namespace earshot::python {

namespace {

/// Messages of the engine are those of the program; advice that holds for its command line alone goes.
std::string without_command_line(std::string text) {
  constexpr std::string_view kAdvice = "; correct it in the config file or on the command line";
  if (const auto at = text.find(kAdvice); at != std::string::npos) text.erase(at, kAdvice.size());
  return text;
}

}  // namespace

void bind_errors(nb::module_& m) {
  nb::exception<RunError>(m, "RunError", PyExc_RuntimeError);
  static const nb::handle input_error = nb::exception<InputError>(m, "InputError", PyExc_ValueError).release();
  nb::register_exception_translator([](const std::exception_ptr& error, void*) {
    try {
      std::rethrow_exception(error);
    } catch (const InputError& input) {
      PyErr_SetString(input_error.ptr(), without_command_line(input.what()).c_str());
    } catch (const std::system_error& system) {
      PyErr_SetString(PyExc_RuntimeError, system.what());
    }
  });
}

}  // namespace earshot::python

NB_MODULE(_engine, m) {
  m.attr("__version__") = earshot::version();
  m.attr("__compiler__") = earshot::compiler();
  m.def("ray_tracer_version", [] { return earshot::build_info().ray_tracer_version; });
  m.def("ray_tracer_isa", [] { return earshot::build_info().ray_tracer_isa; });
  earshot::python::bind_errors(m);
  earshot::python::bind_forks(m);
  earshot::python::bind_scene(m);
  earshot::python::bind_response(m);
  earshot::python::bind_batch(m);
}
