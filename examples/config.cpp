// SPDX-License-Identifier: Apache-2.0
// config [KEY=VALUE...]
// Acoustic settings over a preset, with every key as it then is.
#include <earshot/config.h>

#include <cstdio>

int main(int argc, char** argv) try {
  earshot::Settings settings{{"rays", 4096}, {"diffraction", false}, {"rir_length_s", 1.25}};
  for (int i = 1; i < argc; ++i) {
    const std::string text = argv[i];
    settings.set(text.substr(0, text.find('=')), text.substr(text.find('=') + 1));
  }
  for (const std::string& text : settings.texts()) std::printf("# %s\n", text.c_str());
  std::printf("%s\n", earshot::acoustic_config_text("fast", settings).c_str());
} catch (const std::exception& error) {
  std::fprintf(stderr, "config: %s\n", error.what());
  return 1;
}
