// SPDX-License-Identifier: Apache-2.0
// Policy files and checkpoints, as far as they are read before a network is made.  Their hash is made right again, so that damage reaches
// what lies behind it.
#include <cstring>

#include "fuzz/fuzz_target.h"
#include "sim/base/files.h"
#include "trainer/checkpoint/checkpoint_format.h"
#include "trainer/run/effective_config.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  static const fuzz::InputFile file("p.policy");
  std::string body(fuzz::text_of(data, size));
  std::string bytes(kCheckpointMagic);
  const std::uint32_t version = kCheckpointVersion;
  const std::uint64_t length = body.size(), hash = hash64(body);
  bytes.append(reinterpret_cast<const char*>(&version), sizeof(version)).append(reinterpret_cast<const char*>(&length), sizeof(length));
  bytes.append(body).append(reinterpret_cast<const char*>(&hash), sizeof(hash));
  fuzz::expect_value_or_refusal([&] {
    const CheckpointMetadata metadata = load_checkpoint_metadata(file.write(bytes));
    static_cast<void>(config_of_checkpoint(metadata, "p.policy", {}));
  });
  return 0;
}
