// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "sim/audio/measured/room_responses.h"

namespace earshot {

/// Reads a SOFA file of the conventions SingleRoomSRIR or SingleRoomDRIR (AES69-2022): Data.IR [M][R][N], one emitter at the origin of its
/// source.  Each receiver is a microphone at its own place; of spherical harmonics the first, which is alike on all sides, is read alone.
/// Refused by name: other conventions and data types, units other than hertz, degree and metre, receivers that are not where the listener
/// can place them, several emitters, sizes that do not agree, numbers that are not finite.  Only for a process of its own: HDF5 can crash
/// on damaged files.  Throws InputError naming the file and the field.
RoomResponses read_sofa_room(const std::filesystem::path& path);

}  // namespace earshot
