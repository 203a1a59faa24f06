// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>

namespace earshot {

/// One line of progress on stderr: "label  37 %  1480/4000 unit  212 unit/s  12 s to go".  On a terminal it is redrawn in place, at most
/// ten times a second; elsewhere (a log file) a line every 30 s.  Not thread-safe: one owner calls it.
class Progress {
 public:
  Progress(std::string label, std::string unit, std::uint64_t total);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// done: units finished so far, not since the last call.  note: extra text at the end of the line.
  void update(std::uint64_t done, std::string_view note = {});

 private:
  using Clock = std::chrono::steady_clock;
  void draw(std::string_view note, Clock::time_point now);

  std::string label_, unit_;
  std::uint64_t total_, done_ = 0;
  bool terminal_;
  bool drawn_ = false;
  Clock::time_point start_, last_draw_;
};

}  // namespace earshot
