// SPDX-License-Identifier: Apache-2.0
#include "sim/base/process/companion_program.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <cstdlib>
#include <system_error>

#include "sim/base/errors.h"
#include "sim/base/install_paths.h"

namespace earshot {
namespace {

/// Of the file that holds this code: the program, or a library, such as the extension of a Python package.  Empty where it is not known by
/// its whole path.
std::filesystem::path folder_of_this_code() {
  Dl_info info{};
  if (dladdr(reinterpret_cast<const void*>(&companion_program), &info) == 0 || info.dli_fname == nullptr) return {};
  const std::filesystem::path file = info.dli_fname;
  return file.is_absolute() ? file.parent_path() : std::filesystem::path();
}

}  // namespace

std::filesystem::path companion_program(const std::string& name, const char* variable) {
  if (variable != nullptr)
    if (const char* set = std::getenv(variable); set && *set) return set;
  std::error_code error;
  const std::filesystem::path folder = std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
  const std::filesystem::path own_folder = folder_of_this_code(), installed = std::filesystem::path(kInstalledPrograms) / name;
  for (const std::filesystem::path& candidate :
       {own_folder.empty() ? folder / name : own_folder / name, folder / name, folder.parent_path() / name,
        (folder / kFromInstalledPrograms / name).lexically_normal(),
        own_folder.empty() ? installed : (own_folder / kFromInstalledCompat / name).lexically_normal(), installed})
    if (std::filesystem::is_regular_file(candidate, error)) return candidate;
  throw RunError(name, fmt::format("is neither in {} nor installed as {}; build or install it{}", folder.string(), installed.string(),
                                   variable != nullptr ? fmt::format(", or set {} to its path", variable) : ""));
}

}  // namespace earshot
