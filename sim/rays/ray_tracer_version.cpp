// SPDX-License-Identifier: Apache-2.0
#include "sim/rays/ray_tracer_version.h"

#include "sim/base/errors.h"
#include "sim/rays/embree_handles.h"
#include "sim/rays/embree_options.h"

namespace earshot {
namespace {

EmbreeDevice open_device() {
  EmbreeDevice device{rtcNewDevice(embree_device_options().c_str())};
  if (!device) throw InputError("ray tracer", "cannot open a device", "check the installation of libembree and the free memory");
  return device;
}

}  // namespace

std::string ray_tracer_version() {
  const EmbreeDevice device = open_device();
  const auto part = [&](RTCDeviceProperty property) { return std::to_string(rtcGetDeviceProperty(device.get(), property)); };
  return part(RTC_DEVICE_PROPERTY_VERSION_MAJOR) + "." + part(RTC_DEVICE_PROPERTY_VERSION_MINOR) + "." +
         part(RTC_DEVICE_PROPERTY_VERSION_PATCH);
}

std::string ray_tracer_isa() {
  const EmbreeDevice device = open_device();
  constexpr std::string_view chosen = "isa=";
  if (const std::string& options = embree_device_options(); options.starts_with(chosen)) return options.substr(chosen.size());
  // Embree tells how many rays it takes at once, not by which instructions: a library built without AVX-512 takes 8 of them.
  const bool wide = rtcGetDeviceProperty(device.get(), RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED) != 0;
  std::string widest = "neon";
  for (const RayIsa& isa : ray_isas())
    if (isa.present && (wide || isa.name != "avx512")) widest = isa.name;
  return widest;
}

}  // namespace earshot
