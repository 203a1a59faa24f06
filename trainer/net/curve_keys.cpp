// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/curve_keys.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zmq.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "sim/base/errors.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

constexpr std::size_t kKeyLength = 40;
constexpr std::size_t kMaxFileBytes = 1 << 20;
constexpr const char* kMakeAnother = "make a key file with 'earshot keys FILE'";

using KeyText = std::array<char, kKeyLength + 1>;

struct stat status_of(const std::filesystem::path& file, const char* remedy) {
  struct stat status {};
  if (::stat(file.c_str(), &status) != 0) throw InputError(file.string(), std::strerror(errno), remedy);
  if (!S_ISREG(status.st_mode)) throw InputError(file.string(), "is not a file", remedy);
  return status;
}

/// Calls take(line, number) for each line.
template <class Take>
void for_each_line(std::string_view text, Take&& take) {
  for (int number = 1; !text.empty(); ++number) {
    std::string_view line = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(text.size(), line.size() + 1));
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (!line.empty() && line != "#" && !line.starts_with("# ")) take(line, number);
  }
}

}  // namespace

bool has_curve() { return ::zmq_has("curve") != 0; }

bool is_curve_key(std::string_view text) {
  constexpr std::string_view kSigns = ".-:+=^!/*?&<>()[]{}@%$#";
  return text.size() == kKeyLength && std::ranges::all_of(text, [&](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || kSigns.find(c) != std::string_view::npos;
         });
}

CurveKeys make_curve_keys() {
  KeyText public_key{}, secret_key{};
  if (::zmq_curve_keypair(public_key.data(), secret_key.data()) != 0) throw RunError("CURVE keys", ::zmq_strerror(::zmq_errno()));
  return {public_key.data(), secret_key.data()};
}

void write_curve_keys(const std::filesystem::path& file, const CurveKeys& keys) {
  const int descriptor = ::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (descriptor < 0) {
    if (errno == EEXIST) throw InputError(file.string(), "already exists", "give a new file name, or delete the file first");
    throw RunError(file.string(), fmt::format("cannot be created: {}", std::strerror(errno)));
  }
  const std::string text = fmt::format(
      "# CURVE keys of Earshot: anyone who can read this file can join the run\n"
      "public {}\n"
      "secret {}\n",
      keys.public_key, keys.secret_key);
  const bool written = ::write(descriptor, text.data(), text.size()) == static_cast<ssize_t>(text.size()) && ::fsync(descriptor) == 0;
  if (::close(descriptor) != 0 || !written) {
    ::unlink(file.c_str());
    throw RunError(file.string(), "cannot be written");
  }
}

CurveKeys read_curve_keys(const std::filesystem::path& file) {
  const struct stat status = status_of(file, kMakeAnother);
  if (status.st_uid != ::geteuid()) throw InputError(file.string(), "belongs to another user", kMakeAnother);
  if ((status.st_mode & 0077) != 0)
    throw InputError(file.string(),
                     fmt::format("can be accessed by other users (mode {:04o}), who could join the run", status.st_mode & 07777),
                     "run chmod 600 on it, and make new keys if another user may have read it");
  CurveKeys keys;
  const std::string text = read_file(file, kMaxFileBytes);
  for_each_line(text, [&](std::string_view line, int number) {
    const bool is_public = line.starts_with("public "), is_secret = line.starts_with("secret ");
    std::string& key = is_public ? keys.public_key : keys.secret_key;
    const std::string_view value = line.size() > 7 ? line.substr(7) : std::string_view();
    if ((!is_public && !is_secret) || !key.empty() || !is_curve_key(value))
      throw InputError(file.string(), fmt::format("line {} is neither 'public KEY' nor 'secret KEY'", number), kMakeAnother);
    key = value;
  });
  if (keys.public_key.empty() || keys.secret_key.empty()) throw InputError(file.string(), "does not contain two keys", kMakeAnother);
  KeyText expected{};
  if (::zmq_curve_public(expected.data(), keys.secret_key.c_str()) != 0 || keys.public_key != expected.data())
    throw InputError(file.string(), "contains a public key that does not match the secret key", kMakeAnother);
  return keys;
}

std::set<std::string> read_allow_list(const std::filesystem::path& file) {
  constexpr const char* kRemedy = "write one public key per line, as 'earshot keys' prints it";
  const struct stat status = status_of(file, kRemedy);
  if ((status.st_mode & 0022) != 0)
    throw InputError(file.string(), "can be written by other users, who could add keys", "run chmod go-w on it");
  std::set<std::string> keys;
  const std::string text = read_file(file, kMaxFileBytes);
  for_each_line(text, [&](std::string_view line, int number) {
    const std::string_view key = line.substr(0, line.find(' '));
    if (!is_curve_key(key)) throw InputError(file.string(), fmt::format("line {} is not a public key", number), kRemedy);
    keys.emplace(key);
  });
  if (keys.empty()) throw InputError(file.string(), "contains no key", kRemedy);
  return keys;
}

}  // namespace earshot
