#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""check_layering.py [ROOT]: fails on any include against the arrows, on a library header outside the folder that owns it, on a folder of sources
without a README.md that says what it holds, on a folder of more than 35 sources and on a source of more than 500 lines.

  all              sim <- envs <- {datasets, policy};  policy <- trainer <- evaluation <- bench <- apps;  api over envs, its rooms datasets
                   and training over the folders below them; python over the public headers alone
  compat           over sim
  include          its own headers and the standard library; of the engine only sim/base/errors.h includes one (earshot/errors.h)
  in sim           base <- rays <- scene <- {acoustics, vision, nav}; audio stands on base, sofa on base and audio/measured
  in sim/base      its own files <- text <- process <- charts
  in sim/scene     mesh <- materials <- generators <- readers <- point_cloud <- its own files, annotations and habitat <- checks
  in sim/audio     transforms <- dry_sounds <- measured <- head <- stream
  in sim/acoustics core <- geometry <- model <- paths <- tracers <- source_field <- response <- synthesis <- metrics <- accuracy
  in envs          task <- episodes <- sensors <- scenes <- config <- hearing <- batch <- baselines
  in trainer       net <- launch <- collective <- learner <- rollout <- held_out <- checkpoint <- curves <- run; the first three use of the rest sim/base alone
  in evaluation    results <- leaderboard <- replay
  in bench         measure <- accuracy <- speed <- soak; questions is programs that nothing links
  in apps          options <- {sound, scene, dataset, reference, training, board, bench}
Of bench only training/ and the programs questions/learner_*_bench.cpp use policy and trainer.

ROOT: the source tree, by default the one this script is in.
"""

import collections
import pathlib
import re
import sys

ROOT = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else pathlib.Path(__file__).parent.parent).resolve()
MAX_SOURCES, MAX_LINES = 35, 500
PARTS = "include sim envs datasets api compat python policy trainer evaluation bench apps".split()
# Public headers lie here, and reach nothing but each other and the standard library.
PUBLIC, STANDARD = "include/earshot", r"[a-z_0-9]+$"
QUESTIONS_OF_THE_LEARNER = r"bench/questions/learner_[a-z_]*_bench\.cpp$"

# Room by room: each may use those before it, and what is allowed to all.
CHAINS = [
    ("sim/scene", "mesh materials generators readers point_cloud", "sim/base sim/rays"),
    ("sim/audio", "transforms dry_sounds measured head stream", "sim/base"),
    ("sim/acoustics", "core geometry model paths tracers source_field response synthesis metrics accuracy", "sim/base sim/rays sim/scene sim/audio"),
    ("envs", "task episodes sensors scenes config hearing batch baselines", "sim"),
    ("trainer", "net launch collective", "sim/base"),
    ("trainer", "net launch collective learner rollout held_out checkpoint curves run", "sim envs policy"),
    ("evaluation", "results leaderboard replay", "sim envs policy trainer"),
    ("bench", "measure accuracy speed soak", "sim envs"),
]
# What a folder and all below it may use, but for the files that match the pattern.
ALLOWED = [
    ("sim/base", f"sim/base {PUBLIC}/errors.h", None),
    ("sim/rays", "sim/base sim/rays", None),
    ("sim/scene", "sim/base sim/rays sim/scene", None),
    ("sim/audio", "sim/base sim/audio", None),
    ("sim/sofa", "sim/base sim/audio/measured sim/sofa", None),
    ("sim/acoustics", "sim/base sim/rays sim/scene sim/audio sim/acoustics", None),
    ("sim/vision", "sim/base sim/rays sim/scene sim/vision", None),
    ("sim/nav", "sim/base sim/rays sim/scene sim/nav", None),
    ("sim/reader", "sim/base sim/scene sim/audio sim/sofa sim/vision", None),
    ("envs", "sim envs", None),
    ("datasets", "sim envs datasets", None),
    ("include", "include", None),
    ("api", "include sim envs api", r"api/(datasets|training)/"),
    ("api/datasets", "include sim datasets api", None),
    ("api/training", "include sim envs policy trainer evaluation api", None),
    ("compat", "sim compat", None),
    ("python", "include python", r"python/processor/"),
    ("python/processor", "sim/base python", None),
    ("policy", "sim envs policy", None),
    ("trainer", "sim envs policy trainer", None),
    ("evaluation", "sim envs policy trainer evaluation", None),
    ("bench", "sim envs bench", rf"bench/training/|{QUESTIONS_OF_THE_LEARNER}"),
    ("bench", "sim envs policy trainer evaluation bench", None),
    ("apps", "sim envs datasets policy trainer evaluation bench apps", None),
    ("apps/bench", "sim envs datasets policy trainer evaluation bench apps/commands.h apps/options apps/bench", None),
    *((f"apps/{room}", f"sim envs datasets policy trainer evaluation apps/commands.h apps/options apps/{room}", None)
      for room in "options sound scene dataset reference training board".split()),
]
# Headers of libraries, and the files that may include them.
OWNED = [
    (r"embree", r"sim/rays/"),
    (r"Recast|Detour", r"sim/nav/"),
    (r"sndfile|mysofa|libav|libsw|samplerate", r"sim/audio/"),
    (r"hdf5", r"sim/sofa/"),
    (r"yaml-cpp", r"sim/base/text/config_reader\.cpp|sim/base/text/config_tree\.cpp"),
    (r"yaml\.h", r"sim/base/text/yaml_events\.h"),
    (r"mpi\.h", r"trainer/collective/mpi/"),
    (r"zmq", r"trainer/net/|trainer/collective/|bench/training/"),
    (r"torch", rf"policy/|trainer/|{QUESTIONS_OF_THE_LEARNER}"),
]



def is_in(path: str, folders: list[str]) -> bool:
    return any(path == folder or path.startswith(folder + "/") for folder in folders)


def rules() -> list[tuple[str, list[str], str | None]]:
    found = [(folder, allowed.split(), left_out) for folder, allowed, left_out in ALLOWED]
    for folder, names, common in CHAINS:
        rooms: list[str] = []
        for name in names.split():
            rooms.append(f"{folder}/{name}")
            found.append((rooms[-1], common.split() + rooms, None))
    # The files of sim/base itself lie under its rooms.
    own = [path.relative_to(ROOT).as_posix() for path in (ROOT / "sim/base").glob("*.h")] + [f"{PUBLIC}/errors.h"]
    rooms = []
    for name in "text process charts".split():
        rooms.append(f"sim/base/{name}")
        found.append((rooms[-1], own + rooms, None))
    found.append(("sim/base", own, r"sim/base/[^/]*/"))
    return found


def main() -> int:
    faults: list[str] = []
    sources = sorted(path for part in PARTS for suffix in ("h", "cpp") for path in (ROOT / part).rglob(f"*.{suffix}"))
    checked = rules()
    for path in sources:
        name = path.relative_to(ROOT).as_posix()
        text = path.read_text(encoding="utf-8", errors="replace")
        for number, line in enumerate(text.splitlines(), 1):
            include = re.match(r'\s*#\s*include\s*(["<])([^">]+)', line)
            if include is None:
                continue
            header = include[2]
            if header.startswith("earshot/"):
                header = f"include/{header}"
            if is_in(name, [PUBLIC]) and not is_in(header, [PUBLIC]) and not (include[1] == "<" and re.match(STANDARD, header)):
                faults.append(f"{name}:{number} includes {header}, but a public header may only use its like and the standard library")
            elif include[1] == "<" and not header.startswith("include/"):
                for pattern, owners in OWNED:
                    if re.match(pattern, header) and not re.match(owners, name):
                        faults.append(f"{name}:{number} includes <{header}>, which only {owners} may")
            elif (ROOT / header).exists():  # otherwise a library's or a generated header
                for folder, allowed, left_out in checked:
                    if is_in(name, [folder]) and not is_in(header, allowed) and not (left_out and re.match(left_out, name)):
                        faults.append(f"{name}:{number} includes {header}, but {folder} may only use: {' '.join(allowed)}")
    tests = sorted(path for suffix in ("h", "cpp") for path in (ROOT / "tests").rglob(f"*.{suffix}"))
    for path in sources + tests:
        lines = path.read_bytes().count(b"\n")
        if lines > MAX_LINES:
            faults.append(f"{path.relative_to(ROOT)} has {lines} lines, more than {MAX_LINES}")
    count = collections.Counter(path.parent for path in sources + tests)
    for folder, number in count.items():
        if number > MAX_SOURCES:
            faults.append(f"{folder.relative_to(ROOT)} has {number} sources, more than {MAX_SOURCES}")
    for folder in sorted({path.parent for path in sources}):
        if not (folder / "README.md").exists() and folder.relative_to(ROOT).parts[0] not in ("python", "include"):
            faults.append(f"{folder.relative_to(ROOT)} has no README.md that says what it holds")
    for fault in faults:
        print(f"layering: {fault}")
    if not faults:
        print("layering: every include follows the arrow")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
