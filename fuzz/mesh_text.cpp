// OBJ, PLY and STL before Assimp reads them: coordinates are moved near the origin, PLY headers are checked.
#include "fuzz/fuzz_target.h"
#include "sim/scene/readers/file_coordinates.h"
#include "sim/scene/readers/ply_header.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  std::string_view rest = fuzz::text_of(data, size);
  const unsigned choice = fuzz::take_choice(rest, 3);
  fuzz::expect_value_or_refusal([&] {
    std::string bytes(rest);
    prepare_coordinates(bytes, choice == 0 ? CoordinateText::obj : choice == 1 ? CoordinateText::ply : CoordinateText::stl);
    if (choice == 1) check_ply_header(bytes, "mesh.ply");
  });
  return 0;
}
