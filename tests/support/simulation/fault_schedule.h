// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace earshot::simulation {

/// Something that befalls a run.
struct Fault {
  enum class Kind {
    kill,       ///< SIGKILL; its connections end
    power_off,  ///< its machine is gone: no connection ends by itself
    stop,       ///< SIGSTOP, and SIGCONT after `duration_s`
    hang,       ///< its loop, for duration_s; its I/O thread goes on
    reset,      ///< one connection between rank and other breaks
    cut,        ///< all links between the ranks of `group` and the others, for duration_s
    cut_way,    ///< only the way from rank to other
    delay,      ///< messages from and to rank take `amount` s longer, at least 0, for duration_s
    lose,       ///< of the packets from and to rank the fraction `amount`, 0 to 1, is lost and sent again, for duration_s
  };
  Kind kind = Kind::kill;
  double at_s = 0;                   ///< since the start; or
  std::int64_t after_messages = -1;  ///< of that rank (kill)
  int rank = 0, other = 0;
  std::uint64_t group = 0;
  double duration_s = 0, amount = 0;
  double restart_s = -1;  ///< a worker comes back with --join so long after the death
};

/// A schedule of faults as text, one a line:
///   kill rank=0 at_s=0.5 restart_s=0.2
///   stop rank=2 at_s=1 duration_s=0.3
///   kill rank=1 after_messages=72
///   cut group=5 at_s=0.1 duration_s=2
///   delay rank=1 amount=0.02 at_s=0.1 duration_s=1
/// Lines that begin with # are comments.
///
/// The simulation plays all of it; it draws the kinds from kill to cut_way itself.  Real processes suffer less: FaultPlayer
/// (fault_schedule_test.cpp) plays kill and stop, real_faults.py kill, stop, cut, cut_way, delay and lose, both at times only and without
/// restart_s.  They refuse the others.
[[nodiscard]] std::string encode_schedule(const std::vector<Fault>& faults);
/// Throws InputError: the line, and what is wrong with it; also for an amount outside its range.
[[nodiscard]] std::vector<Fault> decode_schedule(const std::string& text, const std::string& where);
[[nodiscard]] std::vector<Fault> read_schedule(const std::filesystem::path& file);

}  // namespace earshot::simulation
