// SPDX-License-Identifier: Apache-2.0
// Files in the folder of source fields: as they are, or behind a header whose sizes and hash are right.
#include "sim/base/image_store.h"

#include <array>
#include <fstream>

#include "fuzz/fuzz_target.h"
#include "sim/base/files.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  constexpr std::uint64_t key = 0x0123456789ABCDEF;
  static const fuzz::InputFile file(hex64(key) + ".field");
  static ImageStore store({.folder = file.folder(), .suffix = "field", .max_bytes = 1 << 20, .warn = {}});
  std::string_view bytes = fuzz::text_of(data, size);
  const bool sanitize = fuzz::take_choice(bytes, 2) == 1;
  if (sanitize) {
    const bool saved = store.save(key, std::as_bytes(std::span(bytes)));
    if (saved == bytes.empty()) fuzz::report("an image is saved if and only if it is not empty", "");
  } else {
    file.write(bytes);
  }
  const auto image = store.load(key);
  if (sanitize && !bytes.empty() && (!image || image->bytes.size() != bytes.size()))
    fuzz::report("an image that was saved is not found", "");
  std::uint64_t sum = 0;
  if (image)
    for (const std::byte byte : image->bytes) sum += static_cast<std::uint64_t>(byte);
  if (image && sanitize && sum != [&] {
        std::uint64_t expected = 0;
        for (const char byte : bytes) expected += static_cast<unsigned char>(byte);
        return expected;
      }())
    fuzz::report("an image with other bytes", "");
  std::filesystem::remove(file.path());
  return 0;
}
