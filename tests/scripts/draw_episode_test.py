#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""draw_episode_test.py DRAW_EPISODE: a page with a known plan gives a picture whose path, sound and levels lie where they belong."""

import json
import pathlib
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree

SVG = "{http://www.w3.org/2000/svg}"
SCRIPT = sys.argv[1]

# 560 pixels of 1 cm: a plan of 5.6 m that is drawn pixel by pixel, its corner at (-1, -2) m and at (20, 58) of the picture.
STEPS = [{"position": [0.0, 0.0, 0.0], "level_db": [-20, -20]}, {"position": [1.5, 0.0, 1.0], "level_db": [0, -10]}]
EPISODE = {
    "map": {"width_px": 560, "height_px": 300, "low": [-1, -2], "metres_per_px": 0.01, "picture": "AAAA"},
    "goals": [[2.0, 0.0, 0.5]],
    "steps": STEPS,
    "step_time_s": 2.0,
}


def draw(page, out):
    return subprocess.run([sys.executable, SCRIPT, page, out], capture_output=True, text=True, check=False)


with tempfile.TemporaryDirectory() as name:
    folder = pathlib.Path(name)
    page, out = folder / "page.html", folder / "out.svg"
    page.write_text(f'<script type="application/json" id="episode">{json.dumps(EPISODE)}</script>')
    done = draw(page, out)
    assert done.returncode == 0, done.stderr
    root = ElementTree.parse(out).getroot()
    lines = [line.get("points") for line in root.iter(f"{SVG}polyline")]
    assert lines.count("120.0,258.0 270.0,358.0") == 2, lines  # the path and its outline
    # A step takes 2 s, so each level is a mean of its own: from the bottom (334) to the top (84), and half way (209).
    assert lines[2:] == ["640.0,334.0 940.0,84.0", "640.0,334.0 940.0,209.0"], lines
    centres = [(float(c.get("cx")), float(c.get("cy"))) for c in root.iter(f"{SVG}circle")]
    assert centres.count((320.0, 308.0)) == 4, centres  # the sound and its rings
    assert root.find(f"{SVG}image").get("height") == "300.0"

    page.write_text("<html></html>")
    done = draw(page, folder / "none.svg")
    assert done.returncode == 1, done
    assert "holds no episode" in done.stderr, done
    assert not (folder / "none.svg").exists()
print("draw_episode: path, sound and levels where they belong")
