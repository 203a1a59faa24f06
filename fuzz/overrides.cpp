// SPDX-License-Identifier: Apache-2.0
// A config with overrides from the command line: lines of `key=value` before an empty line, then the YAML.  Every type of a key
// is read, and the text that checkpoints hold is written and read again.
#include "fuzz/fuzz_target.h"
#include "sim/base/text/config_reader.h"

namespace {

constexpr earshot::About kAbout("Any key of the text.");

void read_all(earshot::ConfigReader reader, int depth) {
  const std::vector<std::string> keys = reader.free_keys("KEY");
  for (const std::string& key : keys) {
    if (depth < 8) earshot::fuzz::expect_value_or_refusal([&] { read_all(reader.child(key, kAbout), depth + 1); });
    earshot::fuzz::expect_value_or_refusal([&] {
      int number = 0;
      reader.read(key, number, kAbout);
    });
    earshot::fuzz::expect_value_or_refusal([&] {
      float number = 0;
      reader.read(key, number, kAbout);
    });
    earshot::fuzz::expect_value_or_refusal([&] {
      bool flag = false;
      reader.read(key, flag, kAbout);
    });
    earshot::fuzz::expect_value_or_refusal([&] {
      std::vector<std::string> list;
      reader.read(key, list, kAbout);
    });
    earshot::fuzz::expect_value_or_refusal([&] {
      int choice = 0;
      reader.read_choice<int>(key, choice, {{"auto", 1}, {"on", 2}}, kAbout);
    });
  }
  reader.finish();
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  std::string_view text = fuzz::text_of(data, size);
  std::vector<std::string> overrides;
  while (overrides.size() < 8) {
    const std::size_t end = text.find('\n');
    if (end == 0 || end == std::string_view::npos) break;
    overrides.emplace_back(text.substr(0, end));
    text.remove_prefix(end + 1);
  }
  fuzz::expect_value_or_refusal([&] {
    const ConfigReader reader = ConfigReader::from_text(text, "run.yaml", overrides);
    read_all(reader, 0);
    const std::string resolved = reader.text();
    try {
      static_cast<void>(ConfigReader::from_text(resolved, "resolved"));
    } catch (const InputError& error) {
      fuzz::report("the resolved text cannot be read again", error.what());
    }
  });
  return 0;
}
