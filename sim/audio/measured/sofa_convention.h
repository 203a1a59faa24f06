// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace earshot {

/// The convention of AES69 that a SOFA file says it follows (global attribute SOFAConventions), from the bytes of the file: libmysofa names
/// it only for files that it can read.  Empty if no name of a convention stands where an attribute has its value.  O(size of the file).
std::string find_sofa_convention(std::string_view file);

/// Content of a file of this convention, if that is not impulse responses in one block: "holds transfer functions (convention
/// SimpleFreeFieldHRTF)".  nullopt for conventions of impulse responses and for names that AES69-2022 does not have.
std::optional<std::string> refusal_of_convention(std::string_view convention);

}  // namespace earshot
