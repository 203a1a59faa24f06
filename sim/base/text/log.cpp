// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/log.h"

#include <spdlog/spdlog.h>

namespace earshot {

void log_info(std::string_view message) { spdlog::default_logger_raw()->log(spdlog::level::info, message); }
void log_warning(std::string_view message) { spdlog::default_logger_raw()->log(spdlog::level::warn, message); }
void log_error(std::string_view message) { spdlog::default_logger_raw()->log(spdlog::level::err, message); }

}  // namespace earshot
