// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "sim/scene/materials/materials.h"

namespace earshot {

/// Suspicious entries of a table of materials, one line each, in the order of the table; findings about the table as a whole come last,
/// with an empty name.  Nothing is changed.  Load the table with MaterialImport::keep_transmission, or else what exceeds the absorption has
/// already been lowered.
///
///  - no source for absorption, scattering or a transmission above 0
///  - transmission above the absorption that contains it
///  - a step of more than x10 between neighbouring points of absorption or scattering, more than x100 (20 dB) of transmission; x10 of a
///    transmission without a source
///  - a row that is another material's but for one value that is x10 or x1/10: a slip of the decimal point
///  - one value for all frequencies that the source does not declare as "derived": a placeholder
///  - a transmission shared by three materials or more without a source
///  - a label given twice, or that is another material's name, or made of two labels of the built-in table run together
///  - no entry labelled "default"; no name or label for a usual indoor category
std::vector<MaterialWarning> lint(const MaterialDatabase& database);

}  // namespace earshot
