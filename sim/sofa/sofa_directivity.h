// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "sim/audio/measured/measured_source.h"

namespace earshot {

/// Reads a SOFA file of the convention FreeFieldDirectivityTF (AES69-2022, annex D): Data.Real and Data.Imag [M][R][N] at the frequencies
/// N in hertz, receivers around the source.  Directions are those from SourcePosition to the receivers in the axes of SourceView and
/// SourceUp, whatever the place and view of the listener, to which the receivers belong; pressures are brought to one distance by their
/// own.  A first line of 0 Hz is left out if others follow.  Several measurements (M) are directions of one source where the pose of source
/// or listener changes from one to the next. Refused by name: other conventions and data types, units other than hertz, degree and metre,
/// dimensions in another order, numbers that are not finite, several measurements of the same directions (notes, ways to play), emitters
/// off the origin of the source. Only for a process of its own: HDF5 can crash on damaged files.  Throws InputError naming the file and the
/// field.
MeasuredSource read_sofa_directivity(const std::filesystem::path& path);

}  // namespace earshot
