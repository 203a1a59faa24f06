// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "sim/audio/dry_sounds/sound_bytes.h"
#include "sim/base/errors.h"

namespace earshot {

/// The error of a file that ends before its sound does.
InputError cut_short(const std::string& name, std::uint64_t stated_bytes, std::uint64_t present_bytes);
/// The error of a file whose bytes are not what they must be at `place`.
InputError damaged_at(const std::string& name, std::uint64_t place, const std::string& problem);

/// Walks the pages of an Ogg file (RFC 3533) from byte `start`: checksums, numbers of pages, the mark of the last page of each stream.
/// Throws InputError as read_sound_extent.
void walk_ogg_pages(SoundBytes& bytes, std::uint64_t start);

/// Walks the frames of an MPEG audio file (ISO 11172-3, 13818-3) from byte `start`.  Returns the number of sample frames that a decoder
/// must return at least, 0 where the frames state no length of their own (free format) or there are none.  Throws InputError as
/// read_sound_extent.
std::uint64_t walk_mpeg_frames(SoundBytes& bytes, std::uint64_t start);

}  // namespace earshot
