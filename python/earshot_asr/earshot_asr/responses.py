# SPDX-License-Identifier: Apache-2.0
"""Sets of room impulse responses: measured ones, those of Earshot and of pyroomacoustics, and how they are matched.

A response is mono at RATE_HZ, begins 2.5 ms before its direct sound, ends where 40 dB less than its energy is left, and has unit
energy.
"""

from __future__ import annotations

import dataclasses
import io
import json
import pathlib
import re

import numpy as np
import scipy.fft

from .program import digest, package_version, program_digest, read_json, run_program
from .program import settings as set_options
from .speech import RATE_HZ, DataError, read, resample

DIRECT_S = 0.0025
LONGEST_S = 1.0
LEFT_AT_END = 1e-4  # of the energy
CORPUS_RATE_HZ = 16000


@dataclasses.dataclass(frozen=True)
class Response:
    samples: np.ndarray  # float32, RATE_HZ
    room: str
    rt60_s: float  # T20, broadband
    drr_db: float


def onset(samples: np.ndarray) -> int:
    """The first sample within 20 dB of the strongest."""
    size = np.abs(samples)
    return int(np.flatnonzero(size >= 0.1 * size.max())[0])


def decay_time_s(samples: np.ndarray) -> float:
    """T20 of the record up to where it meets its noise; not a number where it does not fall by 25 dB."""
    block = RATE_HZ // 200  # 5 ms
    energy = np.add.reduceat(samples.astype(np.float64) ** 2, np.arange(0, len(samples), block))
    smooth = np.convolve(energy, np.ones(8) / 8, mode="valid")
    noise = float(np.mean(energy[-max(len(energy) // 10, 1) :]))
    below = np.flatnonzero(smooth < 3 * noise)
    end = int(below[0]) + 4 if noise > 1e-7 * energy.max() and len(below) else len(energy)
    left = np.cumsum(energy[:end][::-1])[::-1]
    with np.errstate(divide="ignore"):
        level_db = 10 * np.log10(left / left[0])
    inside = np.flatnonzero((level_db <= -5) & (level_db >= -25))
    if len(inside) < 4 or level_db[-1] > -28:
        return float("nan")
    slope = np.polyfit(inside * block / RATE_HZ, level_db[inside], 1)[0]
    return float(-60 / slope)


def direct_ratio_db(samples: np.ndarray) -> float:
    """Energy within 2.5 ms of the onset over what follows."""
    split = onset(samples) + round(DIRECT_S * RATE_HZ)
    direct, rest = float(np.sum(samples[:split] ** 2)), float(np.sum(samples[split:] ** 2))
    return 10 * float(np.log10(direct / max(rest, 1e-12 * direct)))


def prepared(samples: np.ndarray, rate_hz: float, room: str) -> Response | None:
    """None for one without a decay time."""
    samples = resample(samples, rate_hz, RATE_HZ)
    samples = samples[max(onset(samples) - round(DIRECT_S * RATE_HZ), 0) :][: round(LONGEST_S * RATE_HZ)]
    rt60_s, drr_db = decay_time_s(samples), direct_ratio_db(samples)
    if not np.isfinite(rt60_s):
        return None
    return Response(ended(samples), room, rt60_s, drr_db)


def ended(samples: np.ndarray) -> np.ndarray:
    """Cut at its end, with unit energy."""
    left = np.cumsum(samples[::-1].astype(np.float64) ** 2)[::-1]
    samples = samples[: np.count_nonzero(left > LEFT_AT_END * left[0])]
    return (samples / np.sqrt(np.sum(samples**2))).astype(np.float32)


def measured(folder: pathlib.Path, part: str) -> list[Response]:
    """The files of `folder`/index.json under `part`, or every WAV of `folder`/`part` with its folder as the room."""
    index = folder / "index.json"
    if index.exists():
        try:
            files = [(e["file"], e["room"]) for e in read_json(index) if e["file"].startswith(part + "/") and e["usable"]]  # type: ignore[attr-defined]
        except (KeyError, TypeError, AttributeError) as error:
            raise DataError(f"{index}: must be a list of entries with file, room and usable") from error
    else:
        files = [(str(p.relative_to(folder)), p.parent.name) for p in sorted((folder / part).rglob("*.wav"))]
    found = [prepared(read(folder / file, RATE_HZ), RATE_HZ, room) for file, room in files]
    responses = [response for response in found if response]
    if not responses:
        raise DataError(f"{folder}: holds no measured responses in {part}/")
    return responses


def room_of_path(path: pathlib.Path) -> str:
    """The room of a file in the layouts of BUT ReverbDB (.../ROOM/MicID01/SpkID../RIR/*.wav), AIR (air_KIND_ROOM_...) and REVERB
    (RIR_SimRoomN_..., RIR_ROOM_...)."""
    parts = path.parts
    for i, name in enumerate(parts):
        if name.startswith("MicID") and i > 0:
            return parts[i - 1]
    if match := re.match(r"air_[a-z]+_([a-z_]+?)(_\d|$)", path.stem):
        return match.group(1)
    if match := re.match(r"RIR_([A-Za-z]+\d*)_", path.stem):
        return match.group(1)
    return path.parent.name


def measured_elsewhere(folder: pathlib.Path) -> list[Response]:
    """Every WAV below a folder in one of those layouts."""
    found = []
    for path in sorted(folder.rglob("*.wav")):
        if "RIR" in path.parts or path.stem.lower().startswith(("air_", "rir_")):
            found.append(prepared(read(path, RATE_HZ), RATE_HZ, room_of_path(path)))
    responses = [response for response in found if response]
    if not responses:
        raise DataError(f"{folder}: holds no responses in the layout of BUT ReverbDB, AIR or REVERB")
    return responses


# Each kind of Earshot's corpora by its settings over configs/datasets/rir.yaml, and how many responses a room gives.
SHOEBOXES = ["shoeboxes.count={rooms}", "scenes=[]", "randomize=null"]
HOUSES = ["shoeboxes.count=0", 'scenes=["house:{first}..{last},rooms=3,area_m2=60"]']
KINDS = {
    "earshot shoeboxes": [*SHOEBOXES, "acoustics.preset=fast"],
    "earshot houses": [*HOUSES, "randomize=null", "acoustics.preset=fast"],
    "earshot houses high": [*HOUSES, "randomize=null", "acoustics.preset=high"],
    "earshot houses randomized": [*HOUSES, "acoustics.preset=fast"],
    "earshot houses uniform": [*HOUSES, "randomize={{uniform: true}}", "acoustics.preset=fast"],
}
# Of a box, and of a house of three rooms.
RESPONSES_PER_BOX, RESPONSES_PER_HOUSE = 40, 100


def made_by(program: str, config: pathlib.Path) -> str:
    """A digest of all that simulated responses depend on beside their kind, count and seed."""
    recipe = (KINDS, RESPONSES_PER_BOX, RESPONSES_PER_HOUSE, CORPUS_RATE_HZ, RATE_HZ, DIRECT_S, LONGEST_S, LEFT_AT_END)
    return digest(recipe, program_digest(program), config.read_text())


def boxes_made_by() -> str:
    """The same of `pyroom`, beside its count and seed."""
    return digest("pyroomacoustics", package_version("pyroomacoustics"), CORPUS_RATE_HZ, RATE_HZ, DIRECT_S, LONGEST_S, LEFT_AT_END)


def packed(responses: list[Response]) -> bytes:
    """For a file that `unpacked` reads."""
    file = io.BytesIO()
    np.savez(
        file,
        samples=np.concatenate([r.samples for r in responses]),
        lengths=[len(r.samples) for r in responses],
        rooms=[r.room for r in responses],
        rt60_s=[r.rt60_s for r in responses],
        drr_db=[r.drr_db for r in responses],
    )
    return file.getvalue()


def unpacked(path: pathlib.Path) -> list[Response]:
    with np.load(path, allow_pickle=False) as file:
        parts = np.split(file["samples"], np.cumsum(file["lengths"])[:-1])
        return [
            Response(*values)
            for values in zip(parts, file["rooms"].tolist(), file["rt60_s"].tolist(), file["drr_db"].tolist(), strict=True)
        ]


def one_of_each_room(responses: list[Response]) -> list[Response]:
    return list({response.room: response for response in responses}.values())


def earshot(
    program: str, config: pathlib.Path, kind: str, count: int, folder: pathlib.Path, first_room: int = 0, per_room: int | None = None
) -> list[Response]:
    """At least `count` responses by `earshot dataset rir`, kept in `folder`."""
    per_room = per_room or (RESPONSES_PER_BOX if kind == "earshot shoeboxes" else RESPONSES_PER_HOUSE)
    rooms = -(-count // per_room) + 1
    settings = [s.format(rooms=rooms, first=first_room, last=first_room + rooms - 1) for s in KINDS[kind]]
    settings += ["channels=mono", "sources_per_room=4", f"listeners_per_source={per_room // 4}", f"seed={first_room + 1}"]
    run_program(program, "dataset", "rir", config, "--out", folder, *set_options(*settings))
    responses = []
    for line in (folder / "manifest.jsonl").read_text().splitlines():
        entry = json.loads(line)
        if response := prepared(read(folder / entry["file"], CORPUS_RATE_HZ), CORPUS_RATE_HZ, f"{kind} {entry['room']}"):
            responses.append(response)
    return responses


def stand_in(program: str, config: pathlib.Path, count: int, folder: pathlib.Path, first_room: int) -> list[Response]:
    """One response of each of at least `count` simulated houses, where there are no measured rooms."""
    made = folder / f"stand_in_{first_room}_{digest(made_by(program, config), count)}"
    return one_of_each_room(earshot(program, config, "earshot houses high", 4 * count, made, first_room=first_room, per_room=4))


def pyroom(count: int, seed: int) -> list[Response]:
    """Shoeboxes of pyroomacoustics: image sources of the third order and rays, absorption for a drawn decay time."""
    import pyroomacoustics as pra

    random = np.random.default_rng(seed)
    np.random.seed(seed)  # of its rays, or of its own generator
    if hasattr(pra, "random"):
        pra.random.seed(seed)
    responses: list[Response] = []
    while len(responses) < count:
        size = random.uniform([3, 3, 2.4], [10, 8, 4])
        try:
            absorption, _ = pra.inverse_sabine(random.uniform(0.2, 1.2), size)
        except ValueError:  # no absorption gives this room such a decay
            continue
        room = pra.ShoeBox(
            size, fs=CORPUS_RATE_HZ, materials=pra.Material(absorption, 0.1), max_order=3, ray_tracing=True, air_absorption=True
        )
        room.set_ray_tracing(n_rays=2000, receiver_radius=0.5)
        room.add_source(random.uniform(0.5, size - 0.5))
        for _ in range(4):
            room.add_microphone(random.uniform(0.5, size - 0.5))
        room.compute_rir()
        for rir in room.rir:
            if response := prepared(np.asarray(rir[0], np.float32), CORPUS_RATE_HZ, f"pyroomacoustics {seed}.{len(responses) // 4}"):
                responses.append(response)
    return responses


def matched(pool: list[Response], target: list[Response], count: int, random: np.random.Generator) -> list[Response]:
    """`count` of the pool, whose decay times and direct-to-reverberant ratios are spread as those of the target.

    Every target in turn takes the nearest response that is left, in units of 20 % of the decay time and 2 dB of the ratio.
    """
    if len(pool) < count:
        raise DataError(f"a pool of {len(pool)} responses is smaller than the {count} that are asked for")
    points = np.array([[np.log(r.rt60_s) / 0.2, r.drr_db / 2] for r in pool])
    taken = np.zeros(len(pool), bool)
    order = [target[i] for _ in range(-(-count // len(target))) for i in random.permutation(len(target))][:count]
    chosen = []
    for wanted in order:
        distance = np.sum((points - [np.log(wanted.rt60_s) / 0.2, wanted.drr_db / 2]) ** 2, axis=1)
        distance[taken] = np.inf
        nearest = int(np.argmin(distance))
        taken[nearest] = True
        chosen.append(pool[nearest])
    return chosen


def deciles(responses: list[Response]) -> dict[str, list[float]]:
    """First, fifth and ninth decile of both."""
    return {
        "rt60_s": [round(float(q), 3) for q in np.quantile([r.rt60_s for r in responses], [0.1, 0.5, 0.9])],
        "drr_db": [round(float(q), 2) for q in np.quantile([r.drr_db for r in responses], [0.1, 0.5, 0.9])],
    }


def reverberated(samples: np.ndarray, response: Response) -> np.ndarray:
    """Speech in the room, at the level of the speech."""
    length = len(samples) + len(response.samples) - 1
    size = scipy.fft.next_fast_len(length, real=True)
    wet = scipy.fft.irfft(scipy.fft.rfft(samples, size) * scipy.fft.rfft(response.samples, size), size)[:length]
    return wet * float(np.sqrt(np.mean(samples**2) / max(np.mean(wet[: len(samples)] ** 2), 1e-12)))
