// SPDX-License-Identifier: Apache-2.0
// YAML of any kind: our reader refuses it, or reads what yaml-cpp reads.
#include "fuzz/fuzz_target.h"
#include "sim/base/text/config_tree.h"
#include "sim/base/text/yaml_parser.h"
#include "tests/support/configs/yaml_cpp_tree.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  const std::string_view text = fuzz::text_of(data, size);
  fuzz::expect_value_or_refusal([&] {
    const YamlNode ours = parse_yaml(text, {.where = "fuzz.yaml"});
    const std::optional<YamlNode> theirs = YamlCppTree::of(text);
    if (!theirs) fuzz::report("yaml-cpp refuses what was read", "");
    if (const std::string found = difference(ours, *theirs); !found.empty()) fuzz::report("yaml-cpp reads something else", found);
    bool has_keys = false;
    if (ours.is_map()) static_cast<void>(load_config_tree(text, "fuzz.yaml", {}, has_keys));
  });
  return 0;
}
