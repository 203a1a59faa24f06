// SPDX-License-Identifier: Apache-2.0
#include <nanobind/stl/string.h>

#include <exception>
#include <stdexcept>
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

/// As PyErr_SetString, which fails for bytes of files in a message that are no UTF-8.
void set_error(PyObject* type, const std::string& text) {
  if (PyObject* message = PyUnicode_DecodeUTF8(text.data(), static_cast<Py_ssize_t>(text.size()), "replace"); message != nullptr) {
    PyErr_SetObject(type, message);
    Py_DECREF(message);
  }
}

/// The batch by its name in Python.
std::string with_names_of_python(std::string text) {
  constexpr std::string_view kClass = "BatchedEnv";
  if (text.starts_with(kClass)) text.replace(0, kClass.size(), "Batch");
  if (const auto at = text.find("::"); at != std::string::npos) text.replace(at, 2, ".");
  return text;
}

}  // namespace

void bind_errors(nb::module_& m) {
  static const nb::handle run_error = nb::exception<RunError>(m, "RunError", PyExc_RuntimeError).release();
  static const nb::handle input_error = nb::exception<InputError>(m, "InputError", PyExc_ValueError).release();
  nb::register_exception_translator([](const std::exception_ptr& error, void*) {
    try {
      std::rethrow_exception(error);
    } catch (const InputError& input) {
      set_error(input_error.ptr(), without_command_line(input.what()));
    } catch (const RunError& run) {
      set_error(run_error.ptr(), run.what());
    } catch (const std::out_of_range& range) {
      set_error(PyExc_IndexError, with_names_of_python(range.what()));
    } catch (const std::invalid_argument& argument) {
      set_error(PyExc_ValueError, with_names_of_python(argument.what()));
    } catch (const std::logic_error& misuse) {
      set_error(PyExc_RuntimeError, with_names_of_python(misuse.what()));
    } catch (const std::system_error& system) {
      set_error(PyExc_RuntimeError, system.what());
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
  earshot::python::bind_navigation(m);
  earshot::python::bind_batch(m);
  earshot::python::bind_corpora(m);
}
