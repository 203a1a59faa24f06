// SPDX-License-Identifier: Apache-2.0
#include "sim/vision/egl_driver.h"

#include <dlfcn.h>

namespace earshot {

void keep_driver_symbols_apart() {
  // Mesa's libraries are loaded by EGL and look up names among the libraries of the program first.  RTLD_DEEPBIND makes them look among
  // their own first.  The handle is kept: a driver stays for the life of the process.
  static const bool is_done = [] {
    if (::dlsym(RTLD_DEFAULT, "LLVMParseCommandLineOptions") != nullptr)
      static_cast<void>(::dlopen("libEGL_mesa.so.0", RTLD_LAZY | RTLD_LOCAL | RTLD_DEEPBIND));
    return true;
  }();
  static_cast<void>(is_done);
}

}  // namespace earshot
