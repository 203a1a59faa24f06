// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "envs/task/episode.h"

namespace earshot {

/// Episodes in file order.  Immutable once loaded; shared by all envs.
struct EpisodeSet {
  std::vector<Episode> episodes;
  std::uint64_t hash = 0;  ///< of the canonical JSON text of the episodes
  /// The keys that a generated set was made from, with their values as text (JSON key `earshot_generator`, which readers of the AudioNav
  /// layout ignore).  Empty in sets from elsewhere.
  std::map<std::string, std::string> generator = {};
};

/// Reads AudioNav JSON, gzip or plain (by content, not by name).  A set that is split by scene (empty `episodes`; files in content/ beside
/// it, or where its `content_scenes_path` says) is read whole, files sorted by name.  Throws InputError: missing file, JSON or gzip error,
/// missing key (with episode id and key), no regular file, a gzip stream that
/// grows more than a hundredfold, more than two million values in one episode, non-finite number, geodesic distance that is not finite and
/// positive, zero quaternion, no episodes.
EpisodeSet load_episode_set(const std::filesystem::path& path);
EpisodeSet parse_episode_set(std::string_view json_or_gzip, const std::string& where);
/// Whether a set of these bytes has no episodes of its own: those are in other files (load_episode_set).  Throws as parse_episode_set.
bool is_split_set(std::string_view json_or_gzip, const std::string& where);
/// Writes JSON, gzip if the name ends in .gz; atomically.  Same episodes and generator, same bytes.
void save_episode_set(const EpisodeSet& set, const std::filesystem::path& path);
/// The JSON of a set of these episodes, as save_episode_set writes it.
std::string episode_set_text(const std::vector<Episode>& episodes);
/// EpisodeSet::hash of these episodes, for sets made in memory.
std::uint64_t episode_set_hash(const std::vector<Episode>& episodes);

}  // namespace earshot
