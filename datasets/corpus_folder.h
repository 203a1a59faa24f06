// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <mutex>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace earshot {

/// The version of corpus.json, under its key.
inline constexpr const char* kCorpusVersionKey = "earshot_corpus";
inline constexpr int kCorpusVersion = 1;

/// A file of a corpus and its bytes.
struct CorpusFile {
  std::string name;  ///< within the folder of the room
  std::string bytes;
};

/// A list made of the manifest of a whole corpus, beside recordings.jsonl.
struct DerivedManifest {
  std::string name;
  std::function<std::string(const std::string& manifest_line)> lines;  ///< of a line of the manifest, each with its line feed
};

/// The files of a corpus (rir_corpus.h).  A corpus that is not of rooms calls its smallest part so that is written whole or not at all, a
/// batch of recordings for example.  A room is complete when its part of the manifest exists, a folder when its manifest exists.  Both are
/// written after their files are on the disk, so a killed run leaves nothing that looks complete and is not.
/// Rooms may be written from any thread, each by one at a time.
class CorpusFolder {
 public:
  /// num_channels: of the recordings; 0: none are listed in recordings.jsonl.
  /// files_below: empty, so that the files of a room lie beside its part of the manifest, or the folder below which they lie by their
  /// names, which may then have folders in them; `out` has a folder `parts` then.
  CorpusFolder(std::filesystem::path out, std::size_t num_rooms, std::size_t rooms_per_folder, float sample_rate_hz,
               std::size_t num_channels, std::filesystem::path files_below = {});

  /// Writes corpus.json, or compares it with the one that is there.  Throws InputError naming the first line that differs.
  void begin(const std::string& description) const;
  /// Compares the corpus that is in `out`, if there is one, without the lines that depend on input files, before those are opened.
  /// of_files: keys of these lines.  Throws as begin().
  static void refuse_others(const std::filesystem::path& out, const std::string& description, const std::set<std::string>& of_files);
  [[nodiscard]] std::size_t count() const { return (num_rooms_ + rooms_per_folder_ - 1) / rooms_per_folder_; }
  /// Whether all rooms of a folder are written.
  [[nodiscard]] bool is_complete(std::size_t folder) const { return std::filesystem::exists(manifest_path(folder)); }
  /// "00012/", of the folder that holds the files of the room; nothing with files_below.
  [[nodiscard]] std::string prefix_of(std::size_t room) const;
  /// Missing rooms of a folder.  Completes a folder without missing rooms.
  std::vector<std::size_t> missing_rooms(std::size_t folder) const;

  void write_sound(std::size_t room, const std::string& name, std::string_view bytes) const;
  /// All files of the room are written: waits until they are on the disk, then writes its lines, and the manifest of the folder if it was
  /// the last room.
  void finish_room(std::size_t room, const std::vector<std::string>& files, const std::string& lines) const;
  /// Joins the manifests of all folders, if none is missing.  Returns the number of those that are.
  [[nodiscard]] std::size_t join_manifests(const std::vector<DerivedManifest>& derived = {}) const;
  /// corpus.json as the text that begin() compares: `config` as lines "key: value", and the engine that runs.  kind: of the corpus.
  [[nodiscard]] static std::string describe(const std::string& kind, const std::string& config, float sample_rate_hz,
                                            const std::vector<std::string>& channels);

 private:
  [[nodiscard]] std::filesystem::path folder_path(std::size_t folder) const;
  [[nodiscard]] std::filesystem::path file_path(std::size_t room, const std::string& name) const;
  [[nodiscard]] std::filesystem::path part_path(std::size_t room) const;
  [[nodiscard]] std::filesystem::path manifest_path(std::size_t folder) const { return folder_path(folder) / "manifest.jsonl"; }
  [[nodiscard]] std::size_t first_room(std::size_t folder) const { return folder * rooms_per_folder_; }
  [[nodiscard]] std::size_t end_room(std::size_t folder) const;
  void complete(std::size_t folder) const;
  [[nodiscard]] std::string recording_line(const std::string& manifest_line) const;

  std::filesystem::path out_;
  std::size_t num_rooms_, rooms_per_folder_;
  float sample_rate_hz_;
  std::size_t num_channels_;
  std::filesystem::path files_below_;
  mutable std::mutex completing_;  ///< two rooms may end at once
};

}  // namespace earshot
