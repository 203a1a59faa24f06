// SPDX-License-Identifier: Apache-2.0
#include "sim/sofa/netcdf_file.h"

#include <fmt/format.h>
#include <hdf5_hl.h>

#include <algorithm>
#include <memory>

#include "sim/base/errors.h"
#include "sim/sofa/hdf5_handle.h"

namespace earshot {
namespace {

constexpr unsigned kCreationOrder = H5P_CRT_ORDER_TRACKED | H5P_CRT_ORDER_INDEXED;

}  // namespace

void NetcdfFile::fail(const std::string& operation) const { throw RunError(where_, "cannot be written: HDF5 error: " + operation); }

hid_t NetcdfFile::checked(hid_t id, const std::string& operation) const {
  if (id < 0) fail(operation);
  return id;
}

NetcdfFile::NetcdfFile(std::string where) : where_(std::move(where)) {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // errors are thrown, not printed
  const Hdf5Handle access(checked(H5Pcreate(H5P_FILE_ACCESS), "a property list"), H5Pclose);
  const Hdf5Handle creation(checked(H5Pcreate(H5P_FILE_CREATE), "a property list"), H5Pclose);
  constexpr std::size_t growth_bytes = std::size_t{1} << 20;
  // The superblock of the oldest format: H5Fget_file_image changes a flag of later ones (1.10.8) and not their checksum.
  if (H5Pset_fapl_core(access.id(), growth_bytes, false) < 0 || H5Pset_link_creation_order(creation.id(), kCreationOrder) < 0 ||
      H5Pset_attr_creation_order(creation.id(), kCreationOrder) < 0 || H5Pset_obj_track_times(creation.id(), false) < 0)
    fail("a file in memory");
  file_ = checked(H5Fcreate("earshot.sofa", H5F_ACC_TRUNC, creation.id(), access.id()), "a file in memory");
}

NetcdfFile::~NetcdfFile() {
  for (const auto& [name, dimension] : dimensions_) H5Dclose(dimension.scale);
  if (file_ >= 0) H5Fclose(file_);
}

void NetcdfFile::add_attribute(hid_t object, const std::string& name, const std::string& text) {
  const Hdf5Handle type(checked(H5Tcopy(H5T_C_S1), "a type"), H5Tclose);
  if (H5Tset_size(type.id(), std::max<std::size_t>(1, text.size())) < 0) fail("a text");
  const Hdf5Handle space(checked(H5Screate(text.empty() ? H5S_NULL : H5S_SCALAR), "a space"), H5Sclose);
  const Hdf5Handle attribute(
      checked(H5Acreate2(object, name.c_str(), type.id(), space.id(), H5P_DEFAULT, H5P_DEFAULT), "attribute " + name), H5Aclose);
  if (!text.empty() && H5Awrite(attribute.id(), type.id(), text.data()) < 0) fail("attribute " + name);
}

void NetcdfFile::add_scale(char name, std::size_t size, hid_t type, const std::string& scale) {
  const hsize_t extent = size;
  const Hdf5Handle space(checked(H5Screate_simple(1, &extent, nullptr), "a space"), H5Sclose);
  const Hdf5Handle creation(checked(H5Pcreate(H5P_DATASET_CREATE), "a property list"), H5Pclose);
  if (H5Pset_obj_track_times(creation.id(), false) < 0 || H5Pset_attr_creation_order(creation.id(), kCreationOrder) < 0)
    fail("a property list");
  const std::string text(1, name);
  dimensions_[name] = {
      checked(H5Dcreate2(file_, text.c_str(), type, space.id(), H5P_DEFAULT, creation.id(), H5P_DEFAULT), "dimension " + text), size};
  if (H5DSset_scale(dimensions_[name].scale, scale.c_str()) < 0) fail("dimension " + text);
}

void NetcdfFile::add_dimension(char name, std::size_t size) {
  // The text by which the NetCDF library knows that the dimension has no variable of its name.
  add_scale(name, size, H5T_IEEE_F32BE, fmt::format("This is a netCDF dimension but not a netCDF variable.{:10}", size));
}

void NetcdfFile::add_coordinate(char name, std::span<const double> values, const Attributes& attributes) {
  add_scale(name, values.size(), H5T_IEEE_F64LE, std::string(1, name));
  const hid_t scale = dimensions_[name].scale;
  if (H5Dwrite(scale, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0) fail("the values of a dimension");
  for (const auto& [key, text] : attributes) add_attribute(scale, key, text);
}

void NetcdfFile::add_variable(const std::string& name, const std::string& dimensions, std::span<const double> values,
                              const Attributes& attributes, bool deflate) {
  std::vector<hsize_t> extent;
  std::size_t count = 1;
  for (const char letter : dimensions) {
    extent.push_back(dimensions_.at(letter).size);
    count *= dimensions_.at(letter).size;
  }
  EARSHOT_EXPECT(count == values.size());
  const Hdf5Handle space(checked(H5Screate_simple(static_cast<int>(extent.size()), extent.data(), nullptr), "a space"), H5Sclose);
  const Hdf5Handle creation(checked(H5Pcreate(H5P_DATASET_CREATE), "a property list"), H5Pclose);
  if (H5Pset_obj_track_times(creation.id(), false) < 0 || H5Pset_attr_creation_order(creation.id(), kCreationOrder) < 0)
    fail("a property list");
  if (deflate) {
    std::vector<hsize_t> piece = extent;
    piece[0] = 1;
    if (H5Pset_chunk(creation.id(), static_cast<int>(piece.size()), piece.data()) < 0 || H5Pset_shuffle(creation.id()) < 0 ||
        H5Pset_deflate(creation.id(), 1) < 0)
      fail("compression");
  }
  const Hdf5Handle variable(
      checked(H5Dcreate2(file_, name.c_str(), H5T_IEEE_F64LE, space.id(), H5P_DEFAULT, creation.id(), H5P_DEFAULT), "variable " + name),
      H5Dclose);
  if (H5Dwrite(variable.id(), H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0) fail("variable " + name);
  for (std::size_t i = 0; i < dimensions.size(); ++i)
    if (H5DSattach_scale(variable.id(), dimensions_.at(dimensions[i]).scale, static_cast<unsigned>(i)) < 0) fail("variable " + name);
  for (const auto& [key, text] : attributes) add_attribute(variable.id(), key, text);
}

std::string NetcdfFile::finish() {
  for (const auto& [name, dimension] : dimensions_)
    if (H5Dclose(dimension.scale) < 0) fail("the end of a dimension");
  dimensions_.clear();
  if (H5Fflush(file_, H5F_SCOPE_GLOBAL) < 0) fail("flushing");
  const ssize_t size = H5Fget_file_image(file_, nullptr, 0);
  if (size <= 0) fail("an image of the file");
  std::string bytes(static_cast<std::size_t>(size), '\0');
  if (H5Fget_file_image(file_, bytes.data(), bytes.size()) != size) fail("an image of the file");
  return bytes;
}

}  // namespace earshot
