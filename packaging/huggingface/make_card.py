#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""make_card.py CORPUS --name NAME --license ID [--out FILE]: the dataset card (README.md) of a corpus of `earshot dataset rir`.

Fills dataset_card.md.in from CORPUS/corpus.json.  NAME is shown on the Hub; ID is a licence of the Hub, such as cc-by-4.0.  Default of --out:
CORPUS/README.md.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

TEMPLATE = Path(__file__).with_name("dataset_card.md.in")
#: Upper ends and names of the Hub's size categories.
SIZES = (
    (10**3, "n<1K"),
    (10**4, "1K<n<10K"),
    (10**5, "10K<n<100K"),
    (10**6, "100K<n<1M"),
    (10**7, "1M<n<10M"),
    (10**8, "10M<n<100M"),
)


def size_category(responses: int) -> str:
    return next((name for end, name in SIZES if responses < end), "100M<n<1B")


def card(corpus: dict, name: str, license_id: str) -> str:
    values = {
        "NAME": json.dumps(name, ensure_ascii=False),
        "LICENSE": license_id,
        "SIZE": size_category(corpus["responses"]),
        "RESPONSES": f"{corpus['responses']:,}",
        "ROOMS": f"{corpus['rooms']:,}",
        "ENGINE": corpus["engine"],
        "CHANNELS": ", ".join(corpus["channels"]),
        "RATE": f"{corpus['sample_rate_hz']:g}",
        "BANDS": ", ".join(f"{band:g}" for band in corpus["bands_hz"]),
        "CONFIG": corpus["config"].strip(),
    }
    text = TEMPLATE.read_text(encoding="utf-8").replace("# @NAME@", f"# {name}")
    for key, value in values.items():
        text = text.replace(f"@{key}@", value)
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description="Write the dataset card of a corpus of responses.")
    parser.add_argument("corpus", type=Path)
    parser.add_argument("--name", required=True)
    parser.add_argument("--license", required=True)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    try:
        corpus = json.loads((options.corpus / "corpus.json").read_text(encoding="utf-8"))
        text = card(corpus, options.name, options.license)
    except (OSError, ValueError, KeyError) as error:
        sys.exit(f"make_card: {options.corpus}: is no complete corpus of earshot dataset rir ({error})")
    if not (options.corpus / "manifest.jsonl").exists():
        sys.exit(f"make_card: {options.corpus}: has no manifest.jsonl; complete the corpus with the command that began it")
    out = options.out or options.corpus / "README.md"
    out.write_text(text, encoding="utf-8")
    print(out)


if __name__ == "__main__":
    main()
