# SPDX-License-Identifier: Apache-2.0
"""Batches of room impulse responses that the nodes of a Ray cluster make while they are read.

pip install 'earshot-rl[ray]'
EARSHOT_PROGRAM=build/release/earshot python ray_corpus.py configs/datasets/rir.yaml --set shoeboxes.count=20 --set scenes=[]
"""

from __future__ import annotations

import argparse
import time

import earshot.ray


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("config", help="config of earshot dataset rir")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides")
    parser.add_argument("--batch-size", type=int, default=32)
    args = parser.parse_args()

    arguments = [args.config, *(text for override in args.overrides for text in ("--set", override))]
    data = earshot.ray.generate("rir", arguments)
    begin, count = time.perf_counter(), 0
    for batch in data.iter_batches(batch_size=args.batch_size):
        audio, distance_m = batch["audio"], batch["distance_m"]  # [batch, channels, samples], [batch]
        count += len(audio)
        print(f"{count:6d} responses, {count / (time.perf_counter() - begin):6.1f} per second, mean distance {distance_m.mean():.2f} m")


if __name__ == "__main__":
    main()
