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

constexpr const char* kGiveMesh = "give the mesh beside it; categories are found by the name of this file";

constexpr std::array<OtherFormat, 7> kOtherFormats{{
    {".navmesh", "is a navigation mesh of Habitat (Recast): it has no walls",
     "give the mesh of the scene; Earshot finds its own free space"},
    {".scn", "is Gibson's annotation, a format without a public description, which is not read", "give the .glb beside it"},
    {".house", "holds annotations of Matterport3D and no mesh", kGiveMesh},
    {".semantic.txt", "holds annotations of HM3D and no mesh", kGiveMesh},
    {"info_semantic.json", "holds annotations of Replica and no mesh", kGiveMesh},
    {".scene_dataset_config.json", "lists the scenes of a data set of Habitat, and is not read", "give the mesh of one scene"},
    {".scene_instance.json", "places objects on a stage of Habitat, and is not read", "export the scene as one glb and give that"},
}};

}  // namespace

void refuse_other_formats(const std::filesystem::path& path) {
  const std::string name = fold_case(path.filename().string());
  for (const OtherFormat& format : kOtherFormats)
    if (name.ends_with(format.end)) throw InputError(path.string(), format.problem, format.advice);
}

}  // namespace earshot
