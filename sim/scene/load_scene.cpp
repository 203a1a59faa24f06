#include <string>

#include "sim/base/errors.h"
#include "sim/scene/scene.h"
#include "sim/scene/shoebox.h"

namespace earshot {

Scene load_scene(const std::string& spec) {
  const MaterialDatabase database = MaterialDatabase::builtin();
  if (spec.starts_with("shoebox:")) {
    Shoebox box = parse_shoebox(std::string_view(spec).substr(8), database);
    return Scene(spec, std::move(box.mesh), std::move(box.material_of_slot), Air{});
  }
  throw InputError(spec, "is not a scene", "write shoebox:XxYxZ[@M]");
}

}  // namespace earshot
