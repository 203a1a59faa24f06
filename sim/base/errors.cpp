#include "sim/base/errors.h"

namespace earshot {
namespace {

std::string joined(std::string_view where, std::string_view what, std::string_view remedy) {
  std::string text{where};
  text.append(": ").append(what);
  if (!remedy.empty()) text.append("; ").append(remedy);
  return text;
}

}  // namespace

InputError::InputError(std::string_view where, std::string_view what, std::string_view remedy)
    : std::runtime_error(joined(where, what, remedy)) {}

RunError::RunError(std::string_view where, std::string_view what) : std::runtime_error(joined(where, what, "")) {}

}  // namespace earshot
