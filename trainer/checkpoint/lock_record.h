// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

namespace earshot {

/// Content of the lock of a run folder: the identity of its holder, for messages, and the facts that tell whether it can still be there.
struct LockRecord {
  bool is_lease = false;          ///< renewed by its holder; else the kernel knows whether it is held
  std::string host;               ///< name
  std::string machine;            ///< start of the machine and namespace of its processes: where process numbers mean something
  std::int64_t process = 0;       ///< number there
  std::uint64_t began_ticks = 0;  ///< when that process began: another one may get the number later
  std::string since;              ///< UTC, "2026-11-27T04:30:12Z"
  std::string command;            ///< "earshot train"
  std::string job;                ///< of a launcher; empty: none
  std::string token;              ///< of this holder, 16 hexadecimal digits; never twice
  std::string run;                ///< token of the first holder that this run had

  /// "process 41 (earshot train) on host n7, since 2026-11-27T04:30:12Z".
  [[nodiscard]] std::string holder() const;
};

/// Of this process.  command, job, run: as above; no run: a new one.
LockRecord own_lock_record(const std::string& command, const std::string& job, const std::string& run = {});

/// Lines "key value".
std::string encode_lock_record(const LockRecord& record);
/// nullopt for an invalid text: not written yet, or not by this program.
std::optional<LockRecord> decode_lock_record(const std::string& text);
/// Of the file behind a descriptor, whatever its position.
std::optional<LockRecord> read_lock_record(int descriptor);

/// Whether the holder is on this machine and has ended, or cannot do anything any more: a zombie, or about to be killed.  False on another
/// machine, whose processes are unknown.
bool is_known_gone(const LockRecord& record);

}  // namespace earshot
