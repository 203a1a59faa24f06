// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <hdf5.h>

#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace earshot {

/// A netCDF-4 file in memory, as the NetCDF library would write it: HDF5 with dimension scales (NetCDF-4 file format specification,
/// section "Dimensions").  HDF5 is not thread-safe as Debian builds it: one object at a time.
class NetcdfFile {
 public:
  /// where: how messages name it.  All functions throw RunError if HDF5 fails.
  explicit NetcdfFile(std::string where);
  ~NetcdfFile();
  NetcdfFile(const NetcdfFile&) = delete;
  NetcdfFile& operator=(const NetcdfFile&) = delete;

  void add_attribute(const std::string& name, const std::string& text) { add_attribute(file_, name, text); }
  using Attributes = std::vector<std::pair<std::string, std::string>>;
  void add_dimension(char name, std::size_t size);
  /// A dimension with a variable of its name, of these values, as frequencies N.
  void add_coordinate(char name, std::span<const double> values, const Attributes& attributes);
  /// dimensions: one letter each, added before.  deflate: compresses, one piece per index of the first dimension.
  void add_variable(const std::string& name, const std::string& dimensions, std::span<const double> values,
                    const Attributes& attributes = {}, bool deflate = false);
  /// Closes the file and returns its bytes.
  std::string finish();

 private:
  [[noreturn]] void fail(const std::string& operation) const;
  hid_t checked(hid_t id, const std::string& operation) const;
  void add_attribute(hid_t object, const std::string& name, const std::string& text);
  /// Creates the dataset of a dimension and makes it one, of this NAME.
  void add_scale(char name, std::size_t size, hid_t type, const std::string& scale);

  struct Dimension {
    hid_t scale = H5I_INVALID_HID;
    std::size_t size = 0;
  };
  std::string where_;
  hid_t file_ = H5I_INVALID_HID;
  std::map<char, Dimension> dimensions_;
};

}  // namespace earshot
