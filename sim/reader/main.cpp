// SPDX-License-Identifier: Apache-2.0
// earshot_reader: reads one file with a library that a damaged file can crash, or opens a driver that can crash, in a process of its own
// (sim/base/process/isolated_call.h).
#include "sim/audio/head/sofa_reader.h"
#include "sim/base/errors.h"
#include "sim/base/process/isolated_call.h"
#include "sim/vision/egl_device.h"

int main(int argc, char** argv) {
  using namespace earshot;
  return answer_isolated(argc, argv, [](const std::vector<std::string>& arguments) -> std::string {
    if (arguments.size() == 1 && arguments[0] == "check") return "reads SOFA files";
    if (arguments.size() == 2 && arguments[0] == "sofa") return encode_responses(parse_sofa(arguments[1]));
    if (arguments.size() == 2 && arguments[0] == "egl") return answer_egl_probe(arguments[1]);
    throw InputError("earshot_reader", "got an unknown command", "build earshot and earshot_reader together");
  });
}
