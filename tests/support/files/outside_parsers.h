// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <cstring>
#include <map>
#include <string>

#include "sim/audio/head/sofa_reader.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/scene/readers/mesh_import.h"
#include "tests/support/files/mutate.h"
#include "tests/support/files/test_files.h"

namespace earshot {

/// Small whole files of OBJ, PLY and STL, by name.
inline std::map<std::string, std::string> small_meshes() {
  const auto put = [](std::string& bytes, auto... values) { (bytes.append(reinterpret_cast<const char*>(&values), sizeof values), ...); };
  const std::string header =
      "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
      "element face 2\nproperty list uchar int vertex_indices\nend_header\n";
  std::string binary_ply = "ply\nformat binary_little_endian 1.0\n" + header;
  for (const float v : {0.f, 0.f, 0.f, 3.f, 0.f, 0.f, 3.f, 2.f, 0.f, 0.f, 2.f, 1.f}) put(binary_ply, v);
  for (const std::array<int, 3> f : {std::array{0, 1, 2}, std::array{0, 2, 3}}) put(binary_ply, std::uint8_t{3}, f[0], f[1], f[2]);
  std::string binary_stl(80, ' ');
  put(binary_stl, std::uint32_t{2});
  for (int t = 0; t < 2; ++t) {
    for (const float v : {0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 3.f, 0.f, 0.f, 0.f, 2.f, 1.f * static_cast<float>(t)}) put(binary_stl, v);
    put(binary_stl, std::uint16_t{0});
  }
  return {
      {"box.obj",
       "mtllib none.mtl\no sides\nusemtl brick\nv 0 0 0\nv 1 0 0\nv 1 2 0\nv 0 2 0\nv 0 0 3\nv 1 0 3\nv 1 2 3\nv 0 2 3\nvt 0 0\nvn 0 0 1\n"
       "f 1/1/1 2/1/1 3//1 4\ng ends\nf 5 8 7 6\nf -8 -4 -3 -7\nl 1 2 3\np 1\n"},
      {"text.ply", "ply\nformat ascii 1.0\ncomment x\n" + header + "0 0 0\n3 0 0\n3 2 0\n0 2 1\n3 0 1 2\n3 0 2 3\n"},
      {"binary.ply", binary_ply},
      {"text.stl", "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 3 0 0\nvertex 0 2 0\nendloop\nendfacet\nendsolid a\n"},
      {"binary.stl", binary_stl}};
}

struct Outcomes {
  int loaded = 0, refused = 0, crashed = 0, over_limits = 0;
};

/// Reads a file that may be damaged: a value or a refusal of one line that names it.  Everything else fails the test.
template <class Read>
void count_outcome(Outcomes& outcomes, const std::string& name, std::uint32_t number, Read read) {
  try {
    read();
    ++outcomes.loaded;
  } catch (const InputError& error) {
    const std::string message = error.what();
    EXPECT_NE(message.find(name), std::string::npos) << message;
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    ++outcomes.refused;
    outcomes.crashed += message.find("the library that reads it") != std::string::npos ? 1 : 0;
    outcomes.over_limits +=
        message.find("not read within") != std::string::npos || message.find("MB of memory") != std::string::npos ? 1 : 0;
  } catch (const std::exception& error) {
    ADD_FAILURE() << name << ", damage " << number << ": " << error.what();
  }
}

inline Outcomes read_damaged_meshes(std::uint32_t per_format) {
  const TempFolder folder;
  Outcomes outcomes;
  for (const auto& [name, bytes] : small_meshes())
    for (std::uint32_t number = 0; number < per_format; ++number)
      count_outcome(outcomes, name, number, [&, &name = name, &bytes = bytes] { import_mesh(folder.write(name, mutated(bytes, number))); });
  return outcomes;
}

/// Half of the damages lie in the first 40 kB, where the structure of the shared file is; the rest anywhere.
inline Outcomes read_damaged_heads(const std::filesystem::path& path, std::uint32_t count) {
  const std::string bytes = read_file(path);
  const TempFolder folder;
  Outcomes outcomes;
  for (std::uint32_t number = 0; number < count; ++number)
    count_outcome(outcomes, "head.sofa", number,
                  [&] { read_sofa(folder.write("head.sofa", mutated(bytes, number, number % 2 ? 40'000 : 0))); });
  return outcomes;
}

inline void record(const Outcomes& outcomes) {
  testing::Test::RecordProperty("loaded", outcomes.loaded);
  testing::Test::RecordProperty("refused", outcomes.refused);
  testing::Test::RecordProperty("crashed_the_reader", outcomes.crashed);
  testing::Test::RecordProperty("over_limits", outcomes.over_limits);
  std::printf("loaded %d, refused %d, of those crashed the reader %d, over its limits %d\n", outcomes.loaded, outcomes.refused,
              outcomes.crashed, outcomes.over_limits);
}

}  // namespace earshot
