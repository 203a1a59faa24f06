// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include "sim/base/processor.h"

/// Linked into every program of the library (an option of the target sim_base), and run before the constructors of the program's own
/// globals: the first instruction that the processor lacks would end the program with a signal, which says nothing to its user.
extern "C" __attribute__((constructor(101))) EARSHOT_ANY_PROCESSOR void earshot_check_processor() {
  char text[256];
  if (earshot::has_used_instruction_sets(text)) return;
  std::size_t length = 0;
  while (text[length] != 0) ++length;
  text[length++] = '\n';  // in place of the final zero
  static_cast<void>(!::write(STDERR_FILENO, "earshot: ", 9));
  static_cast<void>(!::write(STDERR_FILENO, text, length));
  ::_exit(1);
}
