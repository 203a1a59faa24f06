// A response before any head: its paths, late energy and room-acoustic parameters as arrays.
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <limits>
#include <optional>

#include "python/src/acoustic_model.h"
#include "python/src/bindings.h"
#include "sim/acoustics/metrics/band_metric_keys.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/base/errors.h"

namespace earshot::python {
namespace {

/// What does not exist is NaN in arrays: no decay that could be fitted, no direct sound.
double number(const std::optional<double>& value) { return value.value_or(std::numeric_limits<double>::quiet_NaN()); }

nb::dict dict_of(const RoomMetrics& metrics) {
  nb::dict dict;
  const std::size_t bands = metrics.bands.size();
  std::vector<double> centres(metrics.bands_hz.begin(), metrics.bands_hz.end());
  dict["bands_hz"] = array_of(std::move(centres), {bands});
  for (const BandMetricKey& entry : kBandMetricKeys) {
    std::vector<double> values;
    for (const BandMetrics& band : metrics.bands) values.push_back(number(band.*entry.value));
    dict[entry.key] = array_of(std::move(values), {bands});
  }
  dict["drr_db"] = number(metrics.drr_db);
  dict["direct_delay_s"] = number(metrics.direct_delay_s);
  dict["direct_amplitude"] = number(metrics.direct_amplitude);
  return dict;
}

nb::dict arrivals_of(const ResponseModel& model) {
  const std::vector<Arrival>& arrivals = model.response.arrivals;
  const std::size_t count = arrivals.size(), bands = static_cast<std::size_t>(model.parts.acoustics->num_bands());
  std::vector<std::uint8_t> kind;
  std::vector<std::int32_t> order;
  std::vector<std::uint64_t> identity;
  std::vector<double> delay_s;
  std::vector<float> distance_m, direction, departure, amplitude, phase_rad;
  for (const Arrival& a : arrivals) {
    kind.push_back(static_cast<std::uint8_t>(a.kind));
    order.push_back(a.order);
    identity.push_back(a.identity);
    delay_s.push_back(static_cast<double>(a.distance_m) / static_cast<double>(model.response.speed_of_sound_m_per_s));
    distance_m.push_back(a.distance_m);
    for (int axis = 0; axis < 3; ++axis) {
      direction.push_back(a.direction[axis]);
      departure.push_back(a.departure[axis]);
    }
    for (std::size_t band = 0; band < bands; ++band) {
      amplitude.push_back(a.amplitude[band]);
      phase_rad.push_back(a.phase_rad[band]);
    }
  }
  nb::dict dict;
  dict["kind"] = array_of(std::move(kind), {count});
  dict["order"] = array_of(std::move(order), {count});
  dict["identity"] = array_of(std::move(identity), {count});
  dict["delay_s"] = array_of(std::move(delay_s), {count});
  dict["distance_m"] = array_of(std::move(distance_m), {count});
  dict["direction"] = array_of(std::move(direction), {count, 3});
  dict["departure"] = array_of(std::move(departure), {count, 3});
  dict["amplitude"] = array_of(std::move(amplitude), {count, bands});
  dict["phase_rad"] = array_of(std::move(phase_rad), {count, bands});
  return dict;
}

}  // namespace

void bind_response(nb::module_& m) {
  using namespace nb::literals;
  nb::class_<ResponseModel>(m, "ResponseModel")
      .def("arrivals", &arrivals_of)
      .def("metrics",
           [](const ResponseModel& r) {
             RoomMetrics metrics;
             {
               const nb::gil_scoped_release released;
               metrics = measure(*r.parts.acoustics, r.response);
             }
             return dict_of(metrics);
           })
      .def("late",
           [](nb::handle_t<ResponseModel> self) {
             auto* r = nb::inst_ptr<ResponseModel>(self);
             EnergyHistogram& late = r->response.late;
             const std::size_t shape[3] = {static_cast<std::size_t>(late.num_bins()), static_cast<std::size_t>(late.num_bands()),
                                           static_cast<std::size_t>(late.num_coefficients())};
             return nb::ndarray<nb::numpy, const float>(late.values().data(), 3, shape, self);
           })
      .def_prop_ro("bin_s", [](const ResponseModel& r) { return static_cast<double>(r.response.late.bin_s()); })
      .def_prop_ro("speed_of_sound_m_per_s", [](const ResponseModel& r) { return static_cast<double>(r.response.speed_of_sound_m_per_s); })
      .def_prop_ro("ray_efficiency", [](const ResponseModel& r) { return r.response.stats.ray_efficiency(); })
      .def(
          "render",
          [](const ResponseModel& r, double heading_deg, double pitch_deg, double roll_deg, const std::string& channels,
             const std::string& hrtf) {
            Rir rir;
            {
              const nb::gil_scoped_release released;
              rir = render(r, {{}, heading_deg, pitch_deg, roll_deg}, channels, hrtf);
            }
            const auto rows = static_cast<std::size_t>(rir.num_channels), samples = static_cast<std::size_t>(rir.num_samples);
            return array_of(std::move(rir.samples), {rows, samples});
          },
          "heading_deg"_a, "pitch_deg"_a, "roll_deg"_a, "channels"_a, "hrtf"_a);

  m.def(
      "measure_rir",
      [](const Input<float>& rir, double sample_rate_hz, double direct_delay_s) {
        if (rir.ndim() != 2 || rir.shape(0) == 0 || rir.shape(1) == 0)
          throw InputError("rir", "has a wrong shape", "give [channels, samples]");
        Rir one{static_cast<int>(rir.shape(0)), static_cast<int>(rir.shape(1)), static_cast<float>(sample_rate_hz),
                std::vector<float>(rir.data(), rir.data() + rir.size())};
        RoomMetrics metrics;
        {
          const nb::gil_scoped_release released;
          metrics = measure(one, direct_delay_s);
        }
        return dict_of(metrics);
      },
      "rir"_a, "sample_rate_hz"_a, "direct_delay_s"_a);
}

}  // namespace earshot::python
