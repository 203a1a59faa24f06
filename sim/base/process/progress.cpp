// SPDX-License-Identifier: Apache-2.0
#include "sim/base/process/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>

namespace earshot {

Progress::Progress(std::string label, std::string unit, std::uint64_t total)
    : label_(std::move(label)),
      unit_(std::move(unit)),
      total_(total),
      terminal_(::isatty(STDERR_FILENO) == 1),
      start_(Clock::now()),
      last_draw_(start_) {}

Progress::~Progress() {
  if (drawn_ && terminal_) std::fputc('\n', stderr);
}

void Progress::update(std::uint64_t done, std::string_view note) {
  done_ = done;
  const auto now = Clock::now();
  const auto pause = terminal_ ? std::chrono::milliseconds(100) : std::chrono::milliseconds(30000);
  const bool finished = done_ >= total_;
  if (!finished && now - last_draw_ < pause) return;
  if (finished && !terminal_ && !drawn_) return;
  last_draw_ = now;
  draw(note, now);
}

void Progress::draw(std::string_view note, Clock::time_point now) {
  const double elapsed_s = std::chrono::duration<double>(now - start_).count();
  const double rate = elapsed_s > 0 ? static_cast<double>(done_) / elapsed_s : 0.0;
  const double left_s = rate > 0 && total_ > done_ ? static_cast<double>(total_ - done_) / rate : 0.0;
  const double percent = total_ > 0 ? 100.0 * static_cast<double>(done_) / static_cast<double>(total_) : 100.0;
  const std::string line = fmt::format("{}  {:.0f} %  {}/{} {}  {:.3g} {}/s  {:.0f} s to go  {}", label_, percent, done_, total_, unit_,
                                       rate, unit_, left_s, note);
  if (terminal_)
    std::fputs(("\r\033[K" + line).c_str(), stderr);
  else
    std::fputs((line + "\n").c_str(), stderr);
  std::fflush(stderr);
  drawn_ = true;
}

}  // namespace earshot
