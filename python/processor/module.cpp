// SPDX-License-Identifier: Apache-2.0
// The extension module earshot._processor, which the package imports before the engine: where the processor lacks what the engine is
// compiled for, it raises ImportError.  The engine cannot do that itself: its first such instruction runs while it is loaded.
#include <pyconfig.h>
#if !defined(Py_GIL_DISABLED)
#define Py_LIMITED_API 0x030B0000  // of one wheel for many versions
#endif
#include <Python.h>

#include "sim/base/processor.h"

PyMODINIT_FUNC EARSHOT_ANY_PROCESSOR PyInit__processor() {
  char text[256];
  if (!earshot::has_used_instruction_sets(text)) {
    PyErr_SetString(PyExc_ImportError, text);
    return nullptr;
  }
  static PyModuleDef module = {PyModuleDef_HEAD_INIT, "_processor", nullptr, -1, nullptr, nullptr, nullptr, nullptr, nullptr};
  return PyModule_Create(&module);
}
