// SPDX-License-Identifier: Apache-2.0
// earshot_hdf5_reader: reads one SOFA file by HDF5 in a process of its own (sim/base/process/isolated_call.h).  A program beside
// earshot_reader, as HDF5 brings thirty libraries, which the other would load at each start, and is optional.
#include <cstdlib>

#include "sim/base/errors.h"
#include "sim/base/process/isolated_call.h"
#include "sim/sofa/sofa_directivity.h"
#include "sim/sofa/sofa_room_reader.h"

int main(int argc, char** argv) {
  using namespace earshot;
  // Before HDF5 starts: file systems without locks refuse even to read otherwise.
  ::setenv("HDF5_USE_FILE_LOCKING", "FALSE", 1);
  return answer_isolated(argc, argv, [](const std::vector<std::string>& arguments) -> std::string {
    if (arguments.size() == 2 && arguments[0] == "directivity") return encode_source(read_sofa_directivity(arguments[1]));
    if (arguments.size() == 2 && arguments[0] == "room") return encode_room(read_sofa_room(arguments[1]));
    throw InputError("earshot_hdf5_reader", "got an unknown command", "build earshot and earshot_hdf5_reader together");
  });
}
