#include "sim/rays/embree_options.h"

#include <algorithm>
#include <cstdlib>
#include <set>

#include "sim/base/config_reader.h"
#include "sim/base/errors.h"

namespace earshot {

std::vector<RayIsa> ray_isas() {
#if defined(__x86_64__)
  const auto has = [](auto... supported) { return (... && (supported != 0)); };
  return {{"sse2", true},
          {"sse4.2", has(__builtin_cpu_supports("sse4.2"), __builtin_cpu_supports("popcnt"))},
          {"avx", has(__builtin_cpu_supports("avx"))},
          {"avx2", has(__builtin_cpu_supports("avx2"), __builtin_cpu_supports("fma"), __builtin_cpu_supports("bmi"),
                       __builtin_cpu_supports("bmi2"))},
          {"avx512", has(__builtin_cpu_supports("avx512f"), __builtin_cpu_supports("avx512dq"), __builtin_cpu_supports("avx512cd"),
                         __builtin_cpu_supports("avx512bw"), __builtin_cpu_supports("avx512vl"))}};
#else
  return {};
#endif
}

std::string embree_options_of(const std::string& isa, const std::vector<RayIsa>& isas) {
  if (isa.empty()) return {};
  std::set<std::string> names;
  std::string known, present;
  for (const RayIsa& set : isas) {
    names.insert(set.name);
    known += (known.empty() ? "" : ", ") + set.name;
    if (set.present) present += (present.empty() ? "" : ", ") + set.name;
  }
  const std::string where = "EARSHOT_ISA=" + isa;
  if (isas.empty()) throw InputError(where, "Embree has no choice of instruction sets on this processor", "unset it");
  const auto found = std::find_if(isas.begin(), isas.end(), [&](const RayIsa& set) { return set.name == isa; });
  if (found == isas.end()) {
    const std::string nearest = nearest_word(isa, names);
    throw InputError(where, "unknown instruction set" + (nearest.empty() ? "" : "; did you mean '" + nearest + "'?"),
                     "one of: " + known + "; or unset it");
  }
  if (!found->present) throw InputError(where, "this processor does not have it", "one of: " + present + "; or unset it");
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
