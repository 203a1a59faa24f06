// SPDX-License-Identifier: Apache-2.0
// YAML of any kind is read or refused.  What yaml-cpp makes of the same texts is the matter of yaml_differential_test.
#include "fuzz/fuzz_target.h"
#include "sim/base/text/config_tree.h"
#include "sim/base/text/yaml_parser.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  const std::string_view text = fuzz::text_of(data, size);
  fuzz::expect_value_or_refusal([&] {
    const YamlNode root = parse_yaml(text, {.where = "fuzz.yaml"});
    bool has_keys = false;
    if (root.is_map()) static_cast<void>(load_config_tree(text, "fuzz.yaml", {}, has_keys));
  });
  return 0;
}
