// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace earshot {

/// The host names that a Slurm host list stands for, in its order: "n[1-3,07],login" is n1 n2 n3 n07 login.  A lower bound with leading
/// zeros fixes the number of digits; several brackets in one name vary from the right, as Slurm does it.  Throws InputError, one line: an
/// empty list or name, a character that no host name has, brackets that do not match, a range that falls, numbers of more than 9 digits,
/// names of more than 253 characters, more than max_hosts of them.  O(length of the result).
std::vector<std::string> expand_hostlist(std::string_view text, std::size_t max_hosts = 65536);

}  // namespace earshot
