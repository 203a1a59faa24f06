# SPDX-License-Identifier: Apache-2.0
"""python -m earshot_asr COMMAND: see --help."""

from __future__ import annotations

import argparse
import os
import pathlib
import shutil
import sys
from concurrent.futures.process import BrokenProcessPool

import soundfile

from .speech import DataError


def parser() -> argparse.ArgumentParser:
    top = argparse.ArgumentParser(prog="earshot_asr", description="Far-field speech recognition with simulated rooms.")
    commands = top.add_subparsers(dest="command", required=True)
    table = commands.add_parser("table", help="train a small recognizer in several kinds of rooms, test it in measured ones")
    rooms = commands.add_parser("rooms", help="play speech through measured and simulated responses of one room to recognizers as they are")
    dereverb = commands.add_parser("dereverb", help="train a mask network on early targets of dataset convolve, test it in measured rooms")
    direction = commands.add_parser("direction", help="train a network on recordings of dataset scenes, test it on measured directions")
    for command in (table, rooms, dereverb, direction):
        command.add_argument("--data", type=pathlib.Path, help="folder with speech/fsdd, speech/librivox, rir_measured, rir/dechorate")
        command.add_argument("--out", type=pathlib.Path, required=True, help="folder for responses and results; a second run reads them")
        command.add_argument("--earshot", default=shutil.which("earshot") or "build/release/earshot", help="the program (default: of PATH)")
    table.add_argument("--config", type=pathlib.Path, default=pathlib.Path("configs/datasets/rir.yaml"), help="corpus of simulated rows")
    table.add_argument("--tasks", default="digits,words", help="digits, words or both, separated by commas")
    table.add_argument("--rows", help="names of rows, separated by commas (default: all)")
    table.add_argument("--counts", default="31,2000", help="numbers of responses of the simulated rows")
    table.add_argument("--seeds", type=int, default=5)
    table.add_argument("--base-steps", type=int, default=500, help="updates on dry speech")
    table.add_argument("--steps", type=int, default=200, help="updates in rooms, from there on")
    table.add_argument("--test-strings", type=int, default=60, help="utterances that are tested in every room")
    table.add_argument("--rirs", type=pathlib.Path, help="further test responses in the layout of BUT ReverbDB, AIR or REVERB")
    table.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="seeds that train at once (default: all cores)")
    rooms.add_argument("--measured", type=pathlib.Path, help="folder of the responses (default: rir/dechorate of --data)")
    rooms.add_argument("--scene", help="SCENE (default: that of the places)")
    rooms.add_argument("--places", type=pathlib.Path, default=pathlib.Path("configs/measured/dechorate.yaml"), help="its places")
    rooms.add_argument("--speech", type=pathlib.Path, help="folder of sentences in the layout of LibriSpeech (default: of --data)")
    rooms.add_argument("--synthesized", type=int, default=24, help="sentences by espeak-ng beside those of --data")
    rooms.add_argument("--recognizers", default="whisper,pocketsphinx", help="separated by commas")
    dereverb.add_argument("--config", type=pathlib.Path, default=pathlib.Path("configs/datasets/rir.yaml"), help="corpus of responses")
    dereverb.add_argument("--rows", default="earshot,shoebox,measured", help="responses to train with, separated by commas")
    dereverb.add_argument("--rooms", type=int, default=20, help="simulated rooms, 15 responses each; one in five is a house")
    dereverb.add_argument("--utterances", type=int, default=400, help="utterances to train on")
    dereverb.add_argument("--test-utterances", type=int, default=10, help="utterances that are tested with every response")
    dereverb.add_argument("--steps", type=int, default=400, help="updates of each network")
    direction.add_argument("--config", type=pathlib.Path, default=pathlib.Path("configs/datasets/scenes.yaml"), help="corpus of recordings")
    direction.add_argument("--measured", type=pathlib.Path, help="folder of binaural responses NAME+40.wav (default: of --data)")
    direction.add_argument("--rooms", type=int, default=40, help="simulated rooms, of which one in five is for the test alone")
    direction.add_argument("--steps", type=int, default=1000, help="updates of the network")
    for command in (dereverb, direction):
        command.add_argument("--seed", type=int, default=0)
    return top


def run(arguments: argparse.Namespace) -> str:
    if shutil.which(arguments.earshot) is None:
        raise DataError(f"{arguments.earshot}: no such program; give --earshot PROGRAM")
    if arguments.command == "rooms":
        from . import rooms

        return rooms.run(arguments)
    if arguments.command == "dereverb":
        from . import dereverb

        return dereverb.run(arguments)
    if arguments.command == "direction":
        from . import direction

        return direction.run(arguments)
    from . import table, training

    known = training.Options.rows
    rows = known if arguments.rows is None else tuple(row.strip() for row in arguments.rows.split(","))
    for row in rows:
        if row not in known:
            raise DataError(f"--rows: '{row}' is none of {', '.join(known)}")
    tasks = tuple(arguments.tasks.split(","))
    for task in tasks:
        if task not in ("digits", "words"):
            raise DataError(f"--tasks: '{task}' is neither digits nor words")
    if min(arguments.seeds, arguments.base_steps, arguments.steps, arguments.test_strings, arguments.jobs) < 1:
        raise DataError("--seeds, --base-steps, --steps, --test-strings and --jobs must be at least 1")
    try:
        counts = tuple(int(count) for count in arguments.counts.split(","))
    except ValueError:
        counts = (0,)
    if min(counts) < 1:
        raise DataError(f"--counts: '{arguments.counts}' is no list of whole numbers from 1 on")
    if arguments.rirs is not None and not (arguments.data and (arguments.data / "rir_measured").is_dir()):
        raise DataError("--rirs: adds to measured test responses, which --data has not")
    options = training.Options(
        data=arguments.data,
        out=arguments.out,
        program=arguments.earshot,
        config=arguments.config,
        tasks=tasks,
        rows=rows,
        counts=counts,
        seeds=arguments.seeds,
        base_steps=arguments.base_steps,
        steps=arguments.steps,
        test_strings=arguments.test_strings,
        measured_elsewhere=arguments.rirs,
        jobs=min(arguments.jobs, arguments.seeds),
    )
    return table.run(options)


def main() -> int:
    try:
        print(run(parser().parse_args()))
    except DataError as error:
        print(f"earshot_asr: {error}", file=sys.stderr)
        return 2
    except BrokenProcessPool:
        print("earshot_asr: a worker process was killed; the same command goes on with what is done", file=sys.stderr)
        return 2
    except (OSError, soundfile.LibsndfileError) as error:
        print(f"earshot_asr: {error}", file=sys.stderr)
        return 2
    except ImportError as error:
        print(f"earshot_asr: {error.name} is missing: pip install 'earshot-asr[shoebox,recognizers]'", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
