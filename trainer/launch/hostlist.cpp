// SPDX-License-Identifier: Apache-2.0
#include "trainer/launch/hostlist.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr std::size_t kMaxText = 256 * 1024, kMaxName = 253, kMaxDigits = 9;
constexpr const char* kRemedy = "write host names in Slurm's notation, for example node[1-4,07],login";

bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool is_name_character(char c) {
  return is_digit(c) || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '-' || c == '.' || c == '_';
}

/// One list being read.  Its characters have been checked, so that messages may show it.
class HostlistReader {
 public:
  HostlistReader(std::string_view text, std::size_t max_hosts) : text_(text), max_hosts_(max_hosts) {}

  std::vector<std::string> read() {
    std::vector<std::string> hosts;
    while (true) {
      std::vector<std::string> names = read_name();
      if (hosts.size() + names.size() > max_hosts_) fail(fmt::format("contains more than {} hosts", max_hosts_));
      std::ranges::move(names, std::back_inserter(hosts));
      if (at_ == text_.size()) return hosts;
      ++at_;  // the comma that ended the name
    }
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const {
    throw InputError(fmt::format("host list '{}{}'", text_.substr(0, 80), text_.size() > 80 ? "..." : ""), problem, kRemedy);
  }
  [[nodiscard]] bool more() const { return at_ < text_.size(); }

  /// Up to the next comma outside brackets: literal parts and brackets in turn.
  std::vector<std::string> read_name() {
    std::vector<std::string> names{{}};
    while (more() && text_[at_] != ',') {
      if (text_[at_] == ']') fail("has a closing bracket without an opening one");
      if (text_[at_] == '[') {
        names = with_endings(names, read_bracket());
      } else {
        for (auto& name : names) name += text_[at_];
        ++at_;
      }
    }
    for (const auto& name : names) {
      if (name.empty()) fail("contains an empty name");
      if (name.size() > kMaxName) fail(fmt::format("contains a name of more than {} characters", kMaxName));
    }
    return names;
  }

  std::vector<std::string> with_endings(const std::vector<std::string>& names, const std::vector<std::string>& endings) const {
    if (names.size() * endings.size() > max_hosts_) fail(fmt::format("contains more than {} hosts", max_hosts_));
    std::vector<std::string> all;
    all.reserve(names.size() * endings.size());
    for (const auto& name : names) {
      if (name.size() > kMaxName) fail(fmt::format("contains a name of more than {} characters", kMaxName));
      for (const auto& ending : endings) all.push_back(name + ending);
    }
    return all;
  }

  /// "[1-3,07]": the numbers as text.
  std::vector<std::string> read_bracket() {
    std::vector<std::string> numbers;
    do {
      ++at_;  // the bracket or the comma
      const std::string_view low = read_digits();
      std::string_view high = low;
      if (more() && text_[at_] == '-') {
        ++at_;
        high = read_digits();
      }
      const std::uint64_t first = value_of(low), last = value_of(high);
      if (last < first) fail(fmt::format("contains the decreasing range {}-{}", low, high));
      if (numbers.size() + (last - first) >= max_hosts_) fail(fmt::format("contains more than {} hosts", max_hosts_));
      for (std::uint64_t value = first; value <= last; ++value) numbers.push_back(fmt::format("{:0{}}", value, low.size()));
    } while (more() && text_[at_] == ',');
    if (!more() || text_[at_] != ']') fail("has a bracket that is not closed");
    ++at_;
    return numbers;
  }

  std::string_view read_digits() {
    const std::size_t begin = at_;
    while (more() && is_digit(text_[at_])) ++at_;
    if (at_ == begin) fail("has a bracket with a missing number");
    if (at_ - begin > kMaxDigits) fail(fmt::format("contains a number of more than {} digits", kMaxDigits));
    return text_.substr(begin, at_ - begin);
  }

  static std::uint64_t value_of(std::string_view digits) {
    std::uint64_t value = 0;
    for (const char digit : digits) value = 10 * value + static_cast<std::uint64_t>(digit - '0');
    return value;
  }

  std::string_view text_;
  std::size_t max_hosts_, at_ = 0;
};

}  // namespace

std::vector<std::string> expand_hostlist(std::string_view text, std::size_t max_hosts) {
  if (text.empty()) throw InputError("host list", "is empty", kRemedy);
  if (text.size() > kMaxText) throw InputError("host list", fmt::format("has more than {} characters", kMaxText), kRemedy);
  for (std::size_t i = 0; i < text.size(); ++i)
    if (!is_name_character(text[i]) && text[i] != ',' && text[i] != '[' && text[i] != ']')
      throw InputError("host list", fmt::format("has an invalid character at position {}", i), kRemedy);
  return HostlistReader(text, max_hosts).read();
}

}  // namespace earshot
