// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/annotations/other_formats.h"

#include <array>
#include <string>

#include "sim/base/errors.h"
#include "sim/base/text/text_match.h"

namespace earshot {
namespace {

struct OtherFormat {
  const char *end, *problem, *advice;
};

constexpr const char* kGiveScene = "give the .scene_instance.json or the .scene_dataset_config.json";
constexpr const char* kGiveMesh = "give the mesh beside it; categories are found by the name of this file";

constexpr std::array<OtherFormat, 10> kOtherFormats{{
    {".navmesh", "is a navigation mesh of Habitat (Recast): it has no walls",
     "give the mesh of the scene; Earshot finds its own free space"},
    {".scn", "is Gibson's annotation, a format without a public description, which is not read", "give the .glb beside it"},
    {".house", "holds annotations of Matterport3D and no mesh", kGiveMesh},
    {".semantic.txt", "holds annotations of HM3D and no mesh", kGiveMesh},
    {"info_semantic.json", "holds annotations of Replica and no mesh", kGiveMesh},
    {".stage_config.json", "describes a stage of Habitat", kGiveScene},
    {".object_config.json", "describes an object of Habitat", kGiveScene},
    {".ao_config.json", "describes an articulated object of Habitat, which is not read", kGiveScene},
    {".semantic_config.json", "describes regions of Habitat, a format without a public description, which is not read", kGiveScene},
    {".urdf", "is an articulated object, which is not read", kGiveScene},
}};

}  // namespace

void refuse_other_formats(const std::filesystem::path& path) {
  const std::string name = fold_case(path.filename().string());
  for (const OtherFormat& format : kOtherFormats)
    if (name.ends_with(format.end)) throw InputError(path.string(), format.problem, format.advice);
}

}  // namespace earshot
