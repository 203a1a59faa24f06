// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

namespace earshot {

/// A line of the log of this process (spdlog's default logger), with time and level.  Any thread.  Texts are formatted by the
/// caller: each source that formats by spdlog itself compiles its formatting, four seconds.
void log_info(std::string_view message);
void log_warning(std::string_view message);
void log_error(std::string_view message);

}  // namespace earshot
