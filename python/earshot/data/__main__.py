# SPDX-License-Identifier: Apache-2.0
"""``python -m earshot.data``: exports and figures of a corpus."""

from __future__ import annotations

import argparse
import sys

from .._engine import InputError, RunError
from ._corpus import Corpus
from ._export import write_parquet, write_webdataset
from ._figure import rt60_figure


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m earshot.data", description="Files of a corpus of earshot dataset rir for other loaders."
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, text in (("webdataset", "tar shards"), ("parquet", "Parquet files (extra data)")):
        command = commands.add_parser(name, help=f"copy a corpus into {text} with a dataset card; the same command completes a stopped one")
        command.add_argument("folder", help="what earshot dataset rir or dataset pano wrote as --out")
        command.add_argument("--out", required=True, metavar="DIR", help="folder of the copy")
        command.add_argument("--license", required=True, metavar="ID", help="licence of the corpus, such as cc-by-4.0")
        command.add_argument("--name", default="", help="name on the card (default: that of the folder)")
        command.add_argument(
            "--input-license",
            action="append",
            default=[],
            metavar="INPUT=ID",
            help="licence of a scene, head or pattern file that the corpus was made from, by the beginning of its name; may be repeated",
        )
        command.add_argument("--per-shard", type=int, default=1000, metavar="N", help="responses per file (default 1000)")
    figure = commands.add_parser("figure", help="draw the distribution of reverberation times as SVG")
    figure.add_argument("folder", help="what earshot dataset rir or dataset pano wrote as --out")
    figure.add_argument("--out", required=True, metavar="FILE.svg")
    figure.add_argument("--title", default="", help="default: the name of the folder")
    options = parser.parse_args(arguments)
    try:
        if options.command == "figure":
            rt60_figure(options.folder, options.out, title=options.title)
            print(options.out)
            return 0
        licenses = {}
        for text in options.input_license:
            name, _, licence = text.rpartition("=")
            if not name or not licence:
                raise InputError(f"--input-license {text!r}: has no licence; write it as INPUT=ID")
            licenses[name] = licence
        write = write_webdataset if options.command == "webdataset" else write_parquet
        paths = write(
            options.folder,
            options.out,
            license_id=options.license,
            name=options.name,
            input_licenses=licenses,
            responses_per_shard=options.per_shard,
            progress=_progress if sys.stderr.isatty() else None,
        )
    except (InputError, RunError, ImportError) as error:
        print(f"earshot.data: {error}", file=sys.stderr)
        return 2 if isinstance(error, InputError) else 1
    count = len(Corpus(options.folder))
    print(f"{options.out}: complete, {count} responses in {len(paths)} shards; README.md, croissant.json")
    return 0


def _progress(done: int, total: int) -> None:
    print(f"\rshards {done}/{total}", end="\n" if done == total else "", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
