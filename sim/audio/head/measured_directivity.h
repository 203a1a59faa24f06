// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "sim/audio/head/directivity.h"
#include "sim/audio/measured/measured_source.h"

namespace earshot {

/// A pattern of pressures in any directions around a source, by line or third octave (source_bands.h) and relative to the front of each: on
/// a grid of 5 degrees, between directions by kriging (direction_weights.h).  So the level on the axis is that of an omnidirectional source
/// of the same sound, and the radiated power is that of the latter times the mean of the squared gain over the sphere.  Phases count as
/// polarity alone.  Throws InputError naming `where` for a hole of more than 60 degrees between directions, or a front without level.
std::shared_ptr<const Directivity> measured_directivity(const MeasuredSource& source, const std::string& where);

/// The same from a SOFA file of the convention FreeFieldDirectivityTF (AES69-2022), which the program earshot_hdf5_reader reads
/// (sim/sofa/sofa_directivity.h): $EARSHOT_HDF5_READER, or the companion program of that name (companion_program.h).  Throws InputError
/// naming the file and the field, or that a build has no such program.
std::shared_ptr<const Directivity> sofa_directivity(const std::filesystem::path& path);

/// A pattern of the text of the Common Loudspeaker Format (clf_text.h), relative to the front of each band, bilinear in pressure along arcs
/// and between them.  Warns where left and right differ by more than 1 %.  Throws InputError naming the file, line and field.
std::shared_ptr<const Directivity> clf_directivity(const std::filesystem::path& path);
std::shared_ptr<const Directivity> clf_directivity_from_text(std::string_view text, const std::string& where);

}  // namespace earshot
