// SPDX-License-Identifier: Apache-2.0
#include "tests/support/simulation/fault_schedule.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <sstream>
#include <string_view>

#include "sim/base/errors.h"

namespace earshot::simulation {
namespace {

constexpr std::array<std::string_view, 9> kNames{"kill", "power_off", "stop", "hang", "reset", "cut", "cut_way", "delay", "lose"};

}  // namespace

std::string encode_schedule(const std::vector<Fault>& faults) {
  std::string text;
  for (const Fault& fault : faults) {
    text += kNames[static_cast<std::size_t>(fault.kind)];
    text += fault.kind == Fault::Kind::cut ? fmt::format(" group={}", fault.group) : fmt::format(" rank={}", fault.rank);
    if (fault.kind == Fault::Kind::reset || fault.kind == Fault::Kind::cut_way) text += fmt::format(" other={}", fault.other);
    text += fault.after_messages >= 0 ? fmt::format(" after_messages={}", fault.after_messages) : fmt::format(" at_s={}", fault.at_s);
    if (fault.amount > 0) text += fmt::format(" amount={}", fault.amount);
    if (fault.duration_s > 0) text += fmt::format(" duration_s={}", fault.duration_s);
    if (fault.restart_s >= 0) text += fmt::format(" restart_s={}", fault.restart_s);
    text += '\n';
  }
  return text;
}

std::vector<Fault> decode_schedule(const std::string& text, const std::string& where) {
  std::vector<Fault> faults;
  std::istringstream lines(text);
  int number = 0;
  for (std::string line; std::getline(lines, line);) {
    ++number;
    std::istringstream words(line);
    std::string name;
    if (!(words >> name) || name.starts_with('#')) continue;
    const auto refuse = [&](const std::string& word) {
      throw InputError(fmt::format("{}:{}", where, number), fmt::format("'{}' is not known", word),
                       "see tests/support/simulation/fault_schedule.h");
    };
    const auto kind = std::ranges::find(kNames, name);
    if (kind == kNames.end()) refuse(name);
    Fault fault;
    fault.kind = static_cast<Fault::Kind>(kind - kNames.begin());
    for (std::string word; words >> word;) {
      const std::size_t equals = word.find('=');
      const std::string key = word.substr(0, equals);
      double value = 0;
      std::size_t used = 0;
      try {
        value = std::stod(equals == std::string::npos ? "" : word.substr(equals + 1), &used);
      } catch (const std::exception&) {
        refuse(word);
      }
      if (used + equals + 1 != word.size()) refuse(word);
      if (key == "rank")
        fault.rank = static_cast<int>(value);
      else if (key == "other")
        fault.other = static_cast<int>(value);
      else if (key == "group")
        fault.group = static_cast<std::uint64_t>(value);
      else if (key == "at_s")
        fault.at_s = value;
      else if (key == "after_messages")
        fault.after_messages = static_cast<std::int64_t>(value);
      else if (key == "duration_s")
        fault.duration_s = value;
      else if (key == "amount")
        fault.amount = value;
      else if (key == "restart_s")
        fault.restart_s = value;
      else
        refuse(word);
    }
    const bool is_loss = fault.kind == Fault::Kind::lose;
    if (!(fault.amount >= 0) || (is_loss && fault.amount > 1))
      throw InputError(fmt::format("{}:{}", where, number), fmt::format("amount={} is out of range", fault.amount),
                       is_loss ? "give the fraction of lost packets, 0 to 1" : "give seconds, 0 or more");
    faults.push_back(fault);
  }
  return faults;
}

std::vector<Fault> read_schedule(const std::filesystem::path& file) {
  std::ifstream stream(file);
  if (!stream) throw InputError(file.string(), "cannot be read", "check the path");
  std::ostringstream text;
  text << stream.rdbuf();
  return decode_schedule(text.str(), file.string());
}

}  // namespace earshot::simulation
