// SPDX-License-Identifier: Apache-2.0
// What arrives at the ports of the trainer: the hellos and tables of the rendezvous, goodbye messages, headers of data frames.
#include "trainer/net/wire.h"

#include "fuzz/fuzz_target.h"

namespace {

template <class Message>
void decode_and_back(std::string_view bytes) {
  try {
    const auto message = earshot::decode<Message>(bytes);
    const std::string again = earshot::encode(message);
    if (earshot::encode(earshot::decode<Message>(again, again.size())) != again) earshot::fuzz::report("the way back differs", "");
  } catch (const earshot::WireError&) {
  }
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  std::string_view bytes = fuzz::text_of(data, size);
  const unsigned choice = fuzz::take_choice(bytes, 4);
  if (choice == 0) decode_and_back<Hello>(bytes);
  if (choice == 1) decode_and_back<Welcome>(bytes);
  if (choice == 2) decode_and_back<Goodbye>(bytes);
  if (choice == 3) {
    try {
      const FrameHeader header = decode_header(std::as_bytes(std::span(bytes)));
      if (header.length > kChunkBytes || header.offset + header.length > header.total) fuzz::report("lengths that cannot be", "");
      static_cast<void>(std::string_view(name_of(header.operation)).size());
    } catch (const WireError&) {
    }
  }
  return 0;
}
