// SPDX-License-Identifier: Apache-2.0
#include "sim/base/errors.h"
#include "sim/sofa/sofa_writer.h"

namespace earshot {

bool can_write_sofa() { return false; }

std::string encode_sofa(const SofaRoomResponses&, const std::string& where) {
  throw InputError(where, "cannot be written: this build has no HDF5", "install libhdf5-dev and build again, or use format: wav");
}

}  // namespace earshot
