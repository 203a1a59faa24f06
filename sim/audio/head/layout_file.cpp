// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/layout_file.h"

#include "sim/audio/head/directivity.h"

namespace earshot {

bool names_file(std::string_view channels) {
  constexpr std::string_view mono = "mono:";
  return channels.starts_with("array:") || (channels.starts_with(mono) && Directivity::is_file(channels.substr(mono.size())));
}

}  // namespace earshot
