// SPDX-License-Identifier: Apache-2.0
// Annotations of scanned data sets: the three parsers by the first byte, and a glTF whose surfaces carry colours.
#include <fstream>

#include "fuzz/fuzz_target.h"
#include "sim/scene/annotations/annotated_import.h"
#include "sim/scene/annotations/house_file.h"
#include "sim/scene/annotations/replica_info.h"
#include "sim/scene/annotations/semantic_text.h"

namespace {

/// With annotations of red, green and blue beside it.
const std::filesystem::path& colored_mesh(std::string_view bytes) {
  static const earshot::fuzz::InputFile file("a.semantic.gltf");
  std::ofstream(file.folder() / "a.semantic.txt")
      << "HM3D Semantic Annotations\n1,FF0000,\"wall\",0\n2,00FF00,\"floor\",0\n3,0000FF,\"sofa\",-1\n";
  return file.write(bytes);
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  std::string_view text = fuzz::text_of(data, size);
  const unsigned choice = fuzz::take_choice(text, 4);
  fuzz::expect_value_or_refusal([&] {
    if (choice == 3) {
      static_cast<void>(import_annotated_mesh(colored_mesh(text), {}, std::nullopt));
      return;
    }
    const Annotations annotations = choice == 0   ? parse_house_file(text, "a.house")
                                    : choice == 1 ? parse_replica_info(text, "info_semantic.json")
                                                  : parse_semantic_text(text, "a.semantic.txt");
    for (std::int64_t id = -2; id < 20; ++id)
      if (annotations.of_id(id) >= annotations.names().size()) fuzz::report("an id points nowhere", "");
    for (const SurfaceName& name : annotations.names())
      if (name.category.empty()) fuzz::report("a category is empty", name.object);
  });
  return 0;
}
