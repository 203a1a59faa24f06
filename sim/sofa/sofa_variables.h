// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <hdf5.h>

#include <cstddef>
#include <filesystem>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "sim/base/errors.h"

namespace earshot {

/// A numeric variable of a SOFA file.
struct SofaVariable {
  std::string name;
  std::vector<std::size_t> size;            ///< of each dimension
  std::string dimensions;                   ///< one letter each, '?' where the file does not say it
  std::vector<double> values;               ///< last dimension fastest
  std::string type, units;                  ///< attributes Type and Units, lower case; empty if absent
  [[nodiscard]] std::string shape() const;  ///< "5 x 3 x 7"
};

/// A SOFA file (netCDF-4, so HDF5) open for reading.  HDF5 can crash on damaged files: only for a process of its own.
class SofaFile {
 public:
  /// remedy: of what is refused.  max_values: of one variable; larger ones are refused before they are read.  Throws InputError naming the
  /// file if it cannot be opened, is damaged or no HDF5.
  SofaFile(const std::filesystem::path& path, std::string remedy, std::size_t max_values);
  ~SofaFile();
  SofaFile(const SofaFile&) = delete;
  SofaFile& operator=(const SofaFile&) = delete;

  [[nodiscard]] InputError refuse(const std::string& problem) const;
  /// A global attribute of text; empty if there is none.
  [[nodiscard]] std::string attribute(const std::string& name) const;
  /// nullopt if there is none.  Throws InputError for what holds no numbers, more than max_values of them, or any that is
  /// not finite, with its place.
  [[nodiscard]] std::optional<SofaVariable> find(const std::string& name) const;
  /// The same; throws InputError if there is none.
  [[nodiscard]] SofaVariable get(const std::string& name) const;

 private:
  std::string where_, remedy_;
  std::size_t max_values_;
  hid_t file_ = H5I_INVALID_HID;
};

/// Throws InputError unless the file follows one of these conventions, of `kind`, with this DataType.
void require_convention(const SofaFile& file, std::initializer_list<std::string_view> conventions, const char* kind,
                        std::string_view data_type);
/// Throws InputError for several emitters, and for one off the origin of the source.
void require_emitter_at_source(const SofaFile& file);

}  // namespace earshot
