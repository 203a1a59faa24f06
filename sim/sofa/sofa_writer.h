// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "sim/sofa/sofa_room_responses.h"

namespace earshot {

/// Is this build able to write SOFA?  It is if HDF5 was there when it was configured.
bool can_write_sofa();

/// The bytes of a netCDF-4 file: the same responses, the same bytes; dates in it are those of 1970, as a date of today would change them.
/// Numbers are 64-bit floats, compressed without loss.  where: how messages name it.  Throws InputError without HDF5, or for sizes that do
/// not fit; RunError if HDF5 fails.  Safe from any thread, one at a time.
std::string encode_sofa(const SofaRoomResponses& responses, const std::string& where);

}  // namespace earshot
