// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <string_view>

namespace earshot {

/// A key pair of CurveZMQ (RFC 26: Curve25519), each as 40 characters of Z85 (RFC 32).
struct CurveKeys {
  std::string public_key, secret_key;
};

/// Whether this libzmq was built with CURVE.
bool has_curve();
/// Whether the text can be a key: 40 characters of Z85.
bool is_curve_key(std::string_view text);

/// Throws RunError if libzmq has no CURVE.
CurveKeys make_curve_keys();

/// Writes a new file of mode 0600.  Throws InputError if it is there already, RunError if it cannot be written.
void write_curve_keys(const std::filesystem::path& file, const CurveKeys& keys);
/// Throws InputError, one line, which never shows a key: no such file, not a regular one, of another user, open to others (any of the bits
/// 077), not two keys, keys that do not match.
CurveKeys read_curve_keys(const std::filesystem::path& file);

/// Public keys, one per line; text after a space on the line is a note; empty lines and lines that begin with "# " are skipped.  Throws
/// InputError: no such file, writable by others, an invalid line, no key at all.
std::set<std::string> read_allow_list(const std::filesystem::path& file);

}  // namespace earshot
