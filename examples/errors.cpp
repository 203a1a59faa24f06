// SPDX-License-Identifier: Apache-2.0
// errors
// Input that cannot work, and the line that says why.
#include <earshot/errors.h>
#include <earshot/scene.h>

#include <cstdio>

namespace {
template <class Call>
bool refuses(const char* what, const Call& call) {
  try {
    call();
  } catch (const earshot::InputError& error) {
    std::printf("%-16s %s\n", what, error.what());
    return true;
  }
  return false;
}
}  // namespace

int main() {
  const earshot::Scene scene("shoebox:5x3x4@0.2", {.preset = "fast"});
  int refused = 0;
  refused += refuses("a file", [] { const earshot::Scene missing("no_such_room.glb"); });
  refused += refuses("a key", [] { const earshot::Scene wrong("shoebox:5x3x4@0.2", {.settings = {{"ray", 100}}}); });
  refused += refuses("a value", [] { const earshot::Scene wrong("shoebox:5x3x4@0.2", {.settings = {{"early_order", 9}}}); });
  refused += refuses("a place", [&] { (void)scene.source({2, 1, 2}).render({20, 1, 2}); });
  refused += refuses("a layout", [&] { (void)scene.source({2, 1, 2}).render({3, 1, 2}, {.channels = "surround_9_1"}); });
  std::printf("%d of 5 refused\n", refused);
  return refused == 5 ? 0 : 1;
}
