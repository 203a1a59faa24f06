#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""newer_schema_test.py EARSHOT: every kind of file that the program reads is refused when it is of a newer schema, in one line that names the
file, its version and the remedy.  The same file of version 1, or without a version, gets past that check."""

import json
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

PROGRAM = sys.argv[1]
SOURCES = Path(__file__).resolve().parents[2]
NEWER = 4242


def run(arguments: list[str]) -> tuple[int, str]:
    done = subprocess.run([PROGRAM, *arguments], capture_output=True, text=True, check=False, timeout=300)
    return done.returncode, done.stderr.strip()


def main() -> int:
    folder = Path(tempfile.mkdtemp())
    out = str(folder / "out")

    def write(name: str, text: str) -> Path:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    shoebox = ["shoebox:5x3x4@0.2", "--source", "1,1.5,1", "--listener", "4,1.5,3", "--out", f"{out}.wav"]
    quick = str(SOURCES / "configs/train/quick.yaml")
    yaml = f"schema_version: {NEWER}\nkey_of_the_future: 1\n"
    # The version comes last, behind what this build cannot read.
    later = json.dumps({"episodes": [{"future": 1}], "materials": [{"future": 1}], "schema_version": NEWER})

    policy = bytearray((SOURCES / "configs/policies/quick.policy").read_bytes())
    struct.pack_into("<I", policy, 8, NEWER)
    (folder / "newer.policy").write_bytes(policy)
    write("corpus/corpus.json", json.dumps({"earshot_corpus": NEWER}))
    write("corpus/manifest.jsonl", "")
    (folder / "speech").mkdir()

    config = str(write("config.yaml", yaml))
    kinds: dict[str, tuple[str, list[str]]] = {
        "run config": (config, ["train", config]),
        "run config of an evaluation": (config, ["eval", "random", "--config", config]),
        "scene": (config, ["scene", config]),
        "sweep": (config, ["sweep", config]),
        "benchmark": (config, ["benchmark", config]),
        "corpus of responses": (config, ["dataset", "rir", config, "--out", out]),
        "corpus of scenes": (config, ["dataset", "scenes", config, "--out", out]),
        "balloon": (config, ["rir", *shoebox, "--source-pattern", config]),
        "microphone array": (config, ["rir", *shoebox, "--channels", f"array:{config}"]),
        "materials": (str(write("materials.json", later)), ["materials", str(folder / "materials.json")]),
        "episodes": (str(write("episodes.json", later)), ["eval", "random", "--config", quick, "--episodes", str(folder / "episodes.json")]),
        "result": (str(write("result.json", json.dumps({"earshot_result": NEWER}))), ["leaderboard", str(folder / "result.json")]),
        "result to verify": (str(folder / "result.json"), ["verify", str(folder / "result.json")]),
        "quarantined episode": (str(write("episode.json", json.dumps({"earshot_quarantine": NEWER}))), ["replay", str(folder / "episode.json")]),
        "policy": (str(folder / "newer.policy"), ["policy", str(folder / "newer.policy")]),
        "corpus": (str(folder / "corpus"), ["dataset", "convolve", str(folder / "corpus"), "--speech", str(folder / "speech"), "--out", out]),
    }
    failed = 0
    for kind, (file, arguments) in kinds.items():
        code, said = run(arguments)
        parts = (file, f"of version {NEWER}", "use a newer earshot")
        if code != 2 or said.count("\n") or not all(part in said for part in parts):
            print(f"{kind}: exit status {code}, '{said}' does not name {parts}")
            failed += 1
    # A version that this build reads is no reason to refuse.
    scene = write("scene.yaml", "schema_version: 1\nmesh: absent.obj\n")
    code, said = run(["scene", str(scene)])
    if code != 2 or "version" in said:
        print(f"schema_version 1: exit status {code}, '{said}'")
        failed += 1
    code, said = run(["policy", str(SOURCES / "configs/policies/quick.policy")])  # written by 0.1
    if code != 0:
        print(f"a policy of 0.1: exit status {code}, '{said}'")
        failed += 1
    print(f"newer_schema_test: {len(kinds) + 2 - failed} of {len(kinds) + 2} hold")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
