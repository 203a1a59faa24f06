// SPDX-License-Identifier: Apache-2.0
#include "sim/sofa/sofa_variables.h"

#include <fmt/format.h>
#include <hdf5_hl.h>

#include <algorithm>
#include <cmath>

#include "sim/base/text/text_match.h"
#include "sim/sofa/hdf5_handle.h"

namespace earshot {
namespace {

constexpr std::size_t kMaxTextBytes = 4096;
constexpr int kMaxDimensions = 4;

std::string printable(const std::string& text) {
  std::string safe;
  for (const char c : text.substr(0, 80)) safe += c >= ' ' && c <= '~' ? c : '?';
  return safe;
}

/// Text of an attribute, of a fixed or of its own length; empty if there is none.
std::string text_attribute(hid_t object, const std::string& name) {
  if (H5Aexists(object, name.c_str()) <= 0) return {};
  const Hdf5Handle attribute(H5Aopen(object, name.c_str(), H5P_DEFAULT), H5Aclose);
  if (!attribute.is_valid()) return {};
  const Hdf5Handle type(H5Aget_type(attribute.id()), H5Tclose), space(H5Aget_space(attribute.id()), H5Sclose);
  if (!type.is_valid() || !space.is_valid() || H5Tget_class(type.id()) != H5T_STRING || H5Sget_simple_extent_npoints(space.id()) != 1)
    return {};
  std::string text;
  if (H5Tis_variable_str(type.id()) > 0) {
    char* given = nullptr;
    if (H5Aread(attribute.id(), type.id(), &given) >= 0 && given) text.assign(given, std::find(given, given + kMaxTextBytes, '\0'));
    if (given) H5free_memory(given);
  } else if (const std::size_t size = H5Tget_size(type.id()); size > 0 && size <= kMaxTextBytes) {
    text.resize(size);
    if (H5Aread(attribute.id(), type.id(), text.data()) < 0) return {};
    text.resize(std::min(text.find('\0'), text.size()));
  }
  return printable(text);
}

/// Writes the letter of a dimension: that of the first scale of one letter, "/R" or "R".
herr_t take_letter(hid_t, unsigned, hid_t scale, void* letter) {
  std::string name(16, '\0');
  const ssize_t size = H5Iget_name(scale, name.data(), name.size());
  if (size < 1 || size > 2) return 0;
  *static_cast<char*>(letter) = name[static_cast<std::size_t>(size) - 1];
  return 1;
}

}  // namespace

std::string SofaVariable::shape() const {
  std::string text;
  for (const std::size_t extent : size) text += (text.empty() ? "" : " x ") + std::to_string(extent);
  return text.empty() ? "a scalar" : text;
}

SofaFile::SofaFile(const std::filesystem::path& path, std::string remedy, std::size_t max_values)
    : where_(path.string()), remedy_(std::move(remedy)), max_values_(max_values) {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // errors are thrown, not printed
  H5PLset_loading_state(0);                     // a file must not choose code that is loaded
  std::error_code error;
  if (!std::filesystem::exists(path, error)) throw InputError(where_, "no such file", "check the path");
  if (!std::filesystem::is_regular_file(path, error)) throw refuse("is not a regular file");
  file_ = H5Fopen(where_.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  if (file_ < 0) throw refuse("is not a SOFA file (HDF5), is damaged or cut short");
}

SofaFile::~SofaFile() {
  if (file_ >= 0) H5Fclose(file_);
}

InputError SofaFile::refuse(const std::string& problem) const { return {where_, problem, remedy_}; }

std::string SofaFile::attribute(const std::string& name) const { return text_attribute(file_, name); }

std::optional<SofaVariable> SofaFile::find(const std::string& name) const {
  if (H5Lexists(file_, name.c_str(), H5P_DEFAULT) <= 0) return std::nullopt;
  const Hdf5Handle variable(H5Dopen2(file_, name.c_str(), H5P_DEFAULT), H5Dclose);
  if (!variable.is_valid()) throw refuse(fmt::format("has {}, but no variable of that name", name));
  const Hdf5Handle type(H5Dget_type(variable.id()), H5Tclose), space(H5Dget_space(variable.id()), H5Sclose);
  const H5T_class_t kind = type.is_valid() ? H5Tget_class(type.id()) : H5T_NO_CLASS;
  if (kind != H5T_FLOAT && kind != H5T_INTEGER) throw refuse(fmt::format("has {} that holds no numbers", name));
  const int rank = space.is_valid() ? H5Sget_simple_extent_ndims(space.id()) : -1;
  if (rank < 0 || rank > kMaxDimensions) throw refuse(fmt::format("has {} of {} dimensions", name, rank));
  SofaVariable result{.name = name, .size = {}, .dimensions = {}, .values = {}, .type = {}, .units = {}};
  std::vector<hsize_t> extent(static_cast<std::size_t>(rank));
  if (rank > 0) H5Sget_simple_extent_dims(space.id(), extent.data(), nullptr);
  std::size_t count = 1;
  for (const hsize_t size : extent) {
    if (size == 0 || size > max_values_ / count)
      throw refuse(
          fmt::format("has {} with {} values in a dimension, {} before it: 1 to {} of all are read", name, size, count, max_values_));
    count *= size;
    result.size.push_back(size);
  }
  result.values.resize(count);
  if (H5Dread(variable.id(), H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, result.values.data()) < 0)
    throw refuse(fmt::format("has {} that cannot be read: it is damaged or cut short", name));
  for (std::size_t i = 0; i < count; ++i)
    if (!std::isfinite(result.values[i])) throw refuse(fmt::format("has a value that is not finite in {}, number {}", name, i));
  for (unsigned i = 0; i < extent.size(); ++i) {
    char letter = '?';
    H5DSiterate_scales(variable.id(), i, nullptr, take_letter, &letter);
    result.dimensions += letter;
  }
  result.type = fold_case(text_attribute(variable.id(), "Type"));
  result.units = fold_case(text_attribute(variable.id(), "Units"));
  return result;
}

SofaVariable SofaFile::get(const std::string& name) const {
  if (auto found = find(name)) return *std::move(found);
  throw refuse("has no " + name);
}

void require_convention(const SofaFile& file, std::initializer_list<std::string_view> conventions, const char* kind,
                        std::string_view data_type) {
  if (file.attribute("Conventions") != "SOFA") throw file.refuse("is HDF5, but no SOFA file: the attribute Conventions is not SOFA");
  const std::string convention = file.attribute("SOFAConventions");
  if (std::ranges::find(conventions, convention) == conventions.end())
    throw file.refuse(fmt::format("follows the SOFA convention '{}', which is not that of {}", convention, kind));
  if (const std::string type = file.attribute("DataType"); type != data_type)
    throw file.refuse(fmt::format("has DataType '{}' instead of {}", type, data_type));
}

void require_emitter_at_source(const SofaFile& file) {
  constexpr double off_origin_m = 1e-3;
  const std::optional<SofaVariable> emitter = file.find("EmitterPosition");
  if (!emitter) return;
  if (emitter->size.size() > 1 && emitter->size[0] > 1) throw file.refuse("has several emitters: write one source into a file of its own");
  for (const double value : emitter->values)
    if (std::abs(value) > off_origin_m) throw file.refuse("has an EmitterPosition off the origin of the source");
}

}  // namespace earshot
