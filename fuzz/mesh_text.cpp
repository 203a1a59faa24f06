// SPDX-License-Identifier: Apache-2.0
// OBJ, PLY and STL through their readers, with and without looks; material libraries of OBJ.
#include "fuzz/fuzz_target.h"
#include "sim/scene/readers/obj_materials.h"
#include "sim/scene/readers/obj_reader.h"
#include "sim/scene/readers/ply_reader.h"
#include "sim/scene/readers/stl_reader.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  std::string_view rest = fuzz::text_of(data, size);
  const unsigned choice = fuzz::take_choice(rest, 3);
  for (const bool with_looks : {false, true}) {
    fuzz::expect_value_or_refusal([&] {
      const std::string where = "mesh";
      const MeshFile file = choice == 0   ? parse_obj(rest, where, {.with_looks = with_looks})
                            : choice == 1 ? parse_ply(rest, where, "mesh", with_looks)
                                          : parse_stl(rest, where, "mesh", with_looks);
      for (const MeshPart& part : file.parts) {
        for (const std::uint32_t corner : part.corners)
          if (corner >= part.positions.size()) fuzz::report("a triangle points nowhere", part.object);
        if (part.corners.size() % 3 != 0) fuzz::report("a triangle lacks corners", part.object);
        if ((!part.uvs.empty() && part.uvs.size() != part.positions.size()) ||
            (!part.colors.empty() && part.colors.size() != part.positions.size()))
          fuzz::report("looks and positions differ in number", part.object);
      }
    });
  }
  std::map<std::string, ObjLook, std::less<>> looks;
  parse_mtl(rest, looks);
  return 0;
}
