// SPDX-License-Identifier: Apache-2.0
// Short texts that name things: shoebox:, synth:, listener layouts.
#include "fuzz/fuzz_target.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/audio/head/listener_layout.h"
#include "sim/scene/generators/shoebox.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  static const MaterialDatabase database = MaterialDatabase::builtin();
  std::string_view text = fuzz::text_of(data, size);
  const unsigned choice = fuzz::take_choice(text, 3);
  fuzz::expect_value_or_refusal([&] {
    if (choice == 0) parse_shoebox(text, database);
    if (choice == 1 && text.size() < 40) synthesize_sound("synth:" + std::string(text), 8000.f);
    if (choice == 2) ListenerLayout::named(text);
  });
  return 0;
}
