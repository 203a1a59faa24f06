// SPDX-License-Identifier: Apache-2.0
// A response before any head: its paths, late energy and room-acoustic parameters as arrays.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "earshot/rir.h"
#include "python/src/interruptible.h"

namespace earshot::python {
namespace {

nb::dict dict_of(Metrics metrics) {
  nb::dict dict;
  const std::size_t bands = metrics.bands_hz.size();
  dict["bands_hz"] = array_of(std::move(metrics.bands_hz), {bands});
  for (const MetricField& field : metric_fields()) dict[field.name] = array_of(std::move(metrics.*field.values), {bands});
  for (const MetricField& field : requested_metric_fields()) dict[field.name] = array_of(std::move(metrics.*field.values), {bands});
  dict["sti"] = metrics.sti;
  dict["drr_db"] = metrics.drr_db;
  dict["direct_delay_s"] = metrics.direct_delay_s;
  dict["direct_amplitude"] = metrics.direct_amplitude;
  nb::dict missing;
  for (const MissingMetric& one : metrics.missing) missing[one.name.c_str()] = one.reason;
  dict["missing"] = missing;
  return dict;
}

nb::dict arrivals_of(const Response& response) {
  const std::vector<Arrival>& arrivals = response.arrivals();
  const std::size_t count = arrivals.size(), bands = static_cast<std::size_t>(response.late().num_bands);
  std::vector<std::uint8_t> kind;
  std::vector<std::int32_t> order;
  std::vector<std::uint64_t> identity;
  std::vector<double> delay_s;
  std::vector<float> distance_m, direction, departure, amplitude, phase_rad;
  const auto add = [](std::vector<float>& to, const Vec3& v) {
    for (const double value : {v.x, v.y, v.z}) to.push_back(static_cast<float>(value));
  };
  for (const Arrival& a : arrivals) {
    kind.push_back(static_cast<std::uint8_t>(a.kind));
    order.push_back(a.order);
    identity.push_back(a.identity);
    delay_s.push_back(a.delay_s);
    distance_m.push_back(static_cast<float>(a.distance_m));
    add(direction, a.direction);
    add(departure, a.departure);
    amplitude.insert(amplitude.end(), a.amplitude.begin(), a.amplitude.end());
    phase_rad.insert(phase_rad.end(), a.phase_rad.begin(), a.phase_rad.end());
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

/// Energies of the late field, [bins, bands, harmonics]: the memory of the response itself.
nb::ndarray<nb::numpy, const float> late_of(nb::handle_t<Response> self) {
  const LateEnergy late = nb::inst_ptr<Response>(self)->late();
  const std::size_t shape[3] = {static_cast<std::size_t>(late.num_bins), static_cast<std::size_t>(late.num_bands),
                                static_cast<std::size_t>(late.num_harmonics)};
  return nb::ndarray<nb::numpy, const float>(late.values.data(), 3, shape, self);
}

Array<float> render(const Response& response, double heading_deg, double pitch_deg, double roll_deg, const std::string& channels,
                    const std::string& hrtf) {
  Rir rir = interruptible([=, response = response](const std::stop_token&) {
    return response.render({heading_deg, pitch_deg, roll_deg, channels, hrtf});
  });
  const auto rows = static_cast<std::size_t>(rir.num_channels), samples = static_cast<std::size_t>(rir.num_samples);
  return array_of(std::move(rir.samples), {rows, samples});
}

std::vector<float> samples_of(const Input<float>& samples, const char* name) {
  constexpr std::size_t kMostNumbers = std::numeric_limits<int>::max();
  if (samples.size() > kMostNumbers) throw InputError(name, "is too long", "give at most 2^31 - 1 numbers");
  return {samples.data(), samples.data() + samples.size()};
}

nb::dict measure_rir(const Input<float>& rir, double sample_rate_hz, std::optional<double> direct_delay_s, const std::string& bands,
                     const std::vector<std::string>& parameters, const std::vector<double>& speech_snr_db, const Input<float>& lateral,
                     const Input<float>& reference, bool green_units, std::optional<double> distance_m) {
  if (rir.ndim() != 2) throw InputError("rir", "has a wrong shape", "give [channels, samples]");
  Rir one{static_cast<int>(rir.shape(0)), static_cast<int>(rir.shape(1)), sample_rate_hz, samples_of(rir, "rir")};
  MeasureOptions options{.direct_delay_s = direct_delay_s,
                         .bands = bands,
                         .parameters = {parameters, speech_snr_db},
                         .lateral = samples_of(lateral, "lateral"),
                         .reference = samples_of(reference, "reference"),
                         .green_units = green_units,
                         .distance_m = distance_m};
  return dict_of(
      interruptible([options = std::move(options), one = std::move(one)](const std::stop_token&) { return measure(one, options); }));
}

nb::dict measure_response(const Response& response, const std::vector<std::string>& parameters, const std::vector<double>& speech_snr_db) {
  return dict_of(interruptible([=](const std::stop_token&) { return response.measure({parameters, speech_snr_db}); }));
}

nb::dict errors_of_response(const Response& response, const std::vector<std::string>& parameters, const std::vector<double>& speech_snr_db,
                            double heading_deg, double pitch_deg, double roll_deg, const std::string& hrtf) {
  return dict_of(interruptible([=](const std::stop_token&) {
    return response.standard_errors({parameters, speech_snr_db}, {heading_deg, pitch_deg, roll_deg, "binaural", hrtf});
  }));
}

}  // namespace

void bind_response(nb::module_& m) {
  using namespace nb::literals;
  nb::class_<Response>(m, "ResponseModel")
      .def("arrivals", &arrivals_of)
      .def("metrics",
           [](const Response& response) {
             return dict_of(interruptible([response](const std::stop_token&) { return response.metrics(); }));
           })
      .def("measure", &measure_response, "parameters"_a, "speech_snr_db"_a)
      .def("standard_errors", &errors_of_response, "parameters"_a, "speech_snr_db"_a, "heading_deg"_a, "pitch_deg"_a, "roll_deg"_a,
           "hrtf"_a)
      .def("late", &late_of)
      .def_prop_ro("bin_s", [](const Response& response) { return response.late().bin_s; })
      .def_prop_ro("speed_of_sound_m_per_s", &Response::speed_of_sound_m_per_s)
      .def_prop_ro("ray_efficiency", &Response::ray_efficiency)
      .def("render", &render, "heading_deg"_a, "pitch_deg"_a, "roll_deg"_a, "channels"_a, "hrtf"_a);
  m.def("measure_rir", &measure_rir, "rir"_a, "sample_rate_hz"_a, "direct_delay_s"_a.none(), "bands"_a, "parameters"_a, "speech_snr_db"_a,
        "lateral"_a, "reference"_a, "green_units"_a, "distance_m"_a.none());
}

}  // namespace earshot::python
