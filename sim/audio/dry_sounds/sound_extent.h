// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace earshot {

/// Length that the header of a sound states, read before the sound is decoded: a decoder returns the samples it finds and does not report
/// missing ones.
struct SoundExtent {
  std::uint64_t least_frames = 0;  ///< frames that a decoder must return; 0: the header says no more than that the file is long enough
  /// A header from before the length was known (a pipe) holds a placeholder: the bytes that state what follows, and their place.
  std::uint64_t size_place = 0;
  std::string size_bytes{};  ///< empty: no placeholder
};

/// Reads the header of WAV (RIFF, RIFX, RF64), W64, AIFF and AIFC, 8SVX, AU, CAF and NIST SPHERE, every page of Ogg and every frame header
/// of MP3.  All empty for other files, FLAC among them: its decoder knows the number of frames.
/// Sizes of 0 and those within 64 KiB of 0x7F000000, 2^31 and 2^32 (sox, arecord, ffmpeg) are placeholders where the file is shorter.
/// Throws InputError: the file is shorter than stated; an Ogg file has a page that is missing, damaged or not its last, or several sounds
/// in sequence; an MP3 has other frames than stated.
SoundExtent read_sound_extent(const std::filesystem::path& path);

}  // namespace earshot
