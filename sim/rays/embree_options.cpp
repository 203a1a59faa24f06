// SPDX-License-Identifier: Apache-2.0
#include "sim/rays/embree_options.h"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <initializer_list>
#include <iterator>
#include <set>
#include <string_view>

#include "sim/base/errors.h"
#include "sim/base/processor.h"
#include "sim/base/text/config_reader.h"

namespace earshot {

std::vector<RayIsa> ray_isas() {
  if (std::string_view(kFirstProcessor) != "x86-64") return {};
  const unsigned present = present_instruction_sets();
  const auto has = [&](std::initializer_list<std::string_view> names) {
    unsigned bits = 0;
    for (std::size_t set = 0; set < std::size(kInstructionSets); ++set)
      if (std::find(names.begin(), names.end(), kInstructionSets[set]) != names.end()) bits |= 1u << set;
    return (present & bits) == bits;
  };
  return {{"sse2", true},
          {"sse4.2", has({"SSE4.2"})},
          {"avx", has({"AVX"})},
          {"avx2", has({"AVX2", "BMI2", "FMA"})},
          {"avx512", has({"AVX-512"})}};
}

std::string embree_options_of(const std::string& isa, const std::vector<RayIsa>& isas) {
  if (isa.empty()) {
    const bool wider = !isas.empty() && isas.back().name == "avx512" && isas.back().present;
    return wider ? "isa=avx2" : "";  // the choice is Embree's: it takes the widest
  }
  std::set<std::string> names;
  std::string known, present;
  for (const RayIsa& set : isas) {
    names.insert(set.name);
    known += (known.empty() ? "" : ", ") + set.name;
    if (set.present) present += (present.empty() ? "" : ", ") + set.name;
  }
  const std::string where = "EARSHOT_ISA=" + isa;
  if (isas.empty()) throw InputError(where, "Embree supports only one instruction set on this processor", "unset it");
  const auto found = std::find_if(isas.begin(), isas.end(), [&](const RayIsa& set) { return set.name == isa; });
  if (found == isas.end()) {
    const std::string nearest = nearest_word(isa, names);
    throw InputError(where, "unknown instruction set" + (nearest.empty() ? "" : "; did you mean '" + nearest + "'?"),
                     "one of: " + known + "; or unset it");
  }
  if (!found->present)
    throw InputError(where, "this processor does not support this instruction set", "one of: " + present + "; or unset it");
  return "isa=" + isa;
}

const std::string& embree_device_options() {
  static const std::string options = [] {
    const char* isa = std::getenv("EARSHOT_ISA");
    return embree_options_of(isa ? isa : "", ray_isas());
  }();
  return options;
}

}  // namespace earshot
