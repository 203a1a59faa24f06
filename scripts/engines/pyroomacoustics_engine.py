#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs pyroomacoustics as an engine of `earshot bench accuracy` (docs/evidence/accuracy.md, the protocol of --engine).

pyroomacoustics_engine.py [--method hybrid|images] REQUEST.json

hybrid: image sources of order three and ray tracing for what follows, as the package's documentation recommends for rooms of frequency-dependent
walls; images: image sources alone, of an order as high as the time allows.  The largest setting whose time per response fits is used; the
smallest one where none does.  Writes listener_N.wav and result.json beside the request.  Exit code 69, with one line, where the package is absent.
"""
import argparse
import json
import os
import pathlib
import sys
import time

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "PRA_NUM_THREADS"):
    os.environ[name] = "1"  # before numpy reads them

UNAVAILABLE = 69
HYBRID_ORDER = 3
HYBRID_RAYS = [100, 300, 1000, 3000, 10000, 30000, 100000, 300000]
IMAGE_ORDERS = [1, 2, 3, 5, 8, 12, 17, 25, 35, 50, 70, 100, 140]


def build(pra, np, request, order, rays):
    centres = request["bands_hz"]
    nothing = {"coeffs": [request["scattering"]] * len(centres), "center_freqs": centres, "description": "scattering"}

    def material(wall):
        coefficients = {"coeffs": request["absorption"][wall], "center_freqs": centres, "description": "absorption"}
        return pra.Material(coefficients, nothing)

    # Walls of the package: west x0, east x1, south and north of its second axis, floor and ceiling of its third.  Here y points up.
    walls = {"west": 0, "east": 1, "south": 4, "north": 5, "floor": 2, "ceiling": 3}

    def turned(point):
        return [point[0], point[2], point[1]]

    room = pra.ShoeBox(turned(request["size_m"]), fs=int(request["sample_rate_hz"]),
                       materials={name: material(wall) for name, wall in walls.items()}, max_order=order,
                       ray_tracing=rays > 0, air_absorption=request["air_absorption"])
    room.set_sound_speed(request["speed_of_sound_m_per_s"])
    if rays > 0:
        room.set_ray_tracing(n_rays=rays, receiver_radius=0.5, energy_thres=1e-7, time_thres=request["length_s"])
    room.add_source(turned(request["source_m"]))
    room.add_microphone(np.array([turned(point) for point in request["listeners_m"]]).T)
    return room


def timed(pra, np, request, order, rays):
    """Seconds per response and the room with its responses."""
    room = build(pra, np, request, order, rays)
    start = time.perf_counter()
    room.compute_rir()
    return (time.perf_counter() - start) / len(request["listeners_m"]), room


def write_wav(np, path, samples, rate):
    """Float WAV, as 32-bit samples of IEEE 754."""
    data = np.asarray(samples, dtype="<f4").tobytes()
    header = (b"RIFF" + (36 + len(data)).to_bytes(4, "little") + b"WAVEfmt " + (16).to_bytes(4, "little") + (3).to_bytes(2, "little") +
              (1).to_bytes(2, "little") + rate.to_bytes(4, "little") + (4 * rate).to_bytes(4, "little") + (4).to_bytes(2, "little") +
              (32).to_bytes(2, "little") + b"data" + len(data).to_bytes(4, "little"))
    path.write_bytes(header + data)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--method", choices=("hybrid", "images"), default="hybrid")
    parser.add_argument("request", type=pathlib.Path)
    arguments = parser.parse_args()
    try:
        import numpy as np
        import pyroomacoustics as pra
    except ImportError as missing:
        print(f"the Python package {missing.name} is not installed for {sys.executable}: pip install pyroomacoustics", file=sys.stderr)
        return UNAVAILABLE
    pra.constants.set("num_threads", 1)
    request = json.loads(arguments.request.read_text())
    allowed_s = request["seconds_per_response"]
    hybrid = arguments.method == "hybrid"
    ladder = [(HYBRID_ORDER, rays) for rays in HYBRID_RAYS] if hybrid else [(order, 0) for order in IMAGE_ORDERS]
    timed(pra, np, request, *ladder[0])  # warms up
    best, last_s = None, 0.0
    for setting in ladder:
        spent_s, tried = timed(pra, np, request, *setting)
        if best is not None and spent_s > allowed_s:
            break
        best, seconds, room = setting, spent_s, tried
        if spent_s > allowed_s or (last_s > 0 and spent_s * spent_s / last_s > allowed_s):
            break  # the next one would not fit: times grow by the same factor again
        last_s = spent_s
    # Responses of the package begin half the length of its fractional delays after emission.
    delay = pra.constants.get("frac_delay_length") // 2
    samples = round(request["length_s"] * request["sample_rate_hz"])
    folder = arguments.request.parent
    for index, response in enumerate(room.rir):
        response = np.asarray(response[0])[delay:delay + samples]
        write_wav(np, folder / f"listener_{index}.wav", np.pad(response, (0, samples - len(response))), int(request["sample_rate_hz"]))
    setting = f"images {best[0]}, {best[1]} rays" if hybrid else f"images {best[0]}"
    result = {"seconds": [seconds] * len(request["listeners_m"]), "setting": setting, "engine": f"pyroomacoustics {pra.__version__}"}
    (folder / "result.json").write_text(json.dumps(result) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
