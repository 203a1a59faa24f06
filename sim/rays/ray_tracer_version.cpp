#include "sim/rays/ray_tracer_version.h"

#include "sim/base/errors.h"
#include "sim/rays/embree_handles.h"

namespace earshot {

std::string ray_tracer_version() {
  const EmbreeDevice device{rtcNewDevice(nullptr)};
  if (!device) throw InputError("ray tracer", "opens no device", "check the installation of libembree and the free memory");
  const auto part = [&](RTCDeviceProperty property) { return std::to_string(rtcGetDeviceProperty(device.get(), property)); };
  return part(RTC_DEVICE_PROPERTY_VERSION_MAJOR) + "." + part(RTC_DEVICE_PROPERTY_VERSION_MINOR) + "." +
         part(RTC_DEVICE_PROPERTY_VERSION_PATCH);
}

}  // namespace earshot
