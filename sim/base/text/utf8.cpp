// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/utf8.h"

#include <cstddef>

namespace earshot {

bool is_utf8(std::string_view text) {
  for (std::size_t i = 0; i < text.size();) {
    const auto lead = static_cast<unsigned char>(text[i++]);
    if (lead == 0) return false;
    if (lead < 0x80) continue;
    const std::size_t continuation_bytes = lead >= 0xC2 && lead <= 0xDF   ? 1
                                           : lead >= 0xE0 && lead <= 0xEF ? 2
                                           : lead >= 0xF0 && lead <= 0xF4 ? 3
                                                                          : 0;
    if (continuation_bytes == 0 || text.size() - i < continuation_bytes) return false;
    const auto second = static_cast<unsigned char>(text[i]);
    if ((lead == 0xE0 && second < 0xA0) || (lead == 0xED && second > 0x9F)) return false;
    if ((lead == 0xF0 && second < 0x90) || (lead == 0xF4 && second > 0x8F)) return false;
    for (const std::size_t end = i + continuation_bytes; i < end; ++i)
      if ((static_cast<unsigned char>(text[i]) & 0xC0) != 0x80) return false;
  }
  return true;
}

}  // namespace earshot
