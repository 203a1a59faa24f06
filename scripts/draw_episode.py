#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Draws an episode as an SVG picture: the plan of the house, the path of the agent, and the level of the sound at both ears.

draw_episode.py PAGE.html OUT.svg        PAGE: a page of `earshot replay ... --html`

The picture of the README, by the shipped agent on the episodes of the main job:

    build/release/earshot eval configs/policies/quick.policy --episodes runs/quick/eval.json.gz --out result.json
    build/release/earshot replay result.json --episode 10 --policy configs/policies/quick.policy --html episode.html
    scripts/draw_episode.py episode.html docs/figures/episode.svg
"""

import json
import pathlib
import sys

PLAN_WIDTH, PLAN_HEIGHT, TOP, LEFT = 560, 400, 58, 20
CHART_LEFT, CHART_WIDTH, CHART_HEIGHT = 640, 300, 250
PATH, SOUND, LEFT_EAR, RIGHT_EAR = "#1f77d0", "#d6304a", "#7a4fd0", "#1a9a63"


def episode_of(page):
    text = pathlib.Path(page).read_text(encoding="utf-8")
    marker = 'id="episode">'
    start = text.find(marker)
    if start < 0:
        sys.exit(f"draw_episode: {page}: holds no episode; write it by 'earshot replay RESULT --episode N --html PAGE'")
    start += len(marker)
    return json.loads(text[start : text.index("</script>", start)])


def text(x, y, words, size=14, color="#222", anchor="start", weight="normal", halo=False):
    outline = ' stroke="#fff" stroke-width="4" stroke-linejoin="round" paint-order="stroke"' if halo else ""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" fill="{color}" text-anchor="{anchor}" font-weight="{weight}"{outline}>'
        f"{words}</text>"
    )


def polyline(points, color, width):
    joined = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    ends = 'stroke-linejoin="round" stroke-linecap="round"'
    return f'<polyline points="{joined}" fill="none" stroke="{color}" stroke-width="{width}" {ends}/>'


def plan(episode):
    """The house from above, with the agent's path and the sound."""
    plan_map = episode["map"]
    pixel = min(PLAN_WIDTH / plan_map["width_px"], PLAN_HEIGHT / plan_map["height_px"])
    scale = pixel / plan_map["metres_per_px"]

    def place(position):
        return LEFT + (position[0] - plan_map["low"][0]) * scale, TOP + (position[2] - plan_map["low"][1]) * scale

    width, height = pixel * plan_map["width_px"], pixel * plan_map["height_px"]
    path = [place(step["position"]) for step in episode["steps"]]
    (sound_x, sound_y), (start_x, start_y), (end_x, end_y) = place(episode["goals"][0]), path[0], path[-1]
    parts = [
        f'<image x="{LEFT}" y="{TOP}" width="{width:.1f}" height="{height:.1f}" href="data:image/jpeg;base64,{plan_map["picture"]}"/>',
        polyline(path, "#fff", 8),
        polyline(path, PATH, 4),
        f'<circle cx="{start_x:.1f}" cy="{start_y:.1f}" r="8" fill="{PATH}" stroke="#fff" stroke-width="2"/>',
    ]
    for radius in (14, 24, 34):
        ring = f'r="{radius}" fill="none" stroke="{SOUND}" stroke-width="2.5" opacity="{1.1 - radius / 45:.2f}"'
        parts.append(f'<circle cx="{sound_x:.1f}" cy="{sound_y:.1f}" {ring}/>')
    parts += [
        f'<circle cx="{sound_x:.1f}" cy="{sound_y:.1f}" r="7" fill="{SOUND}" stroke="#fff" stroke-width="2"/>',
        f'<circle cx="{end_x:.1f}" cy="{end_y:.1f}" r="6" fill="#fff" stroke="{PATH}" stroke-width="3"/>',
        text(start_x, start_y - 14, "agent starts", 16, PATH, "middle", "bold", True),
        text(sound_x, sound_y - 40, "sound", 16, SOUND, "middle", "bold", True),
        text(end_x, end_y + 30, "agent stops", 16, PATH, "middle", "bold", True),
    ]
    return parts, TOP + height


def levels(episode):
    """Level at both ears over time, mean of about a second, in dB over the quietest."""
    every = [step["level_db"] for step in episode["steps"]]
    half = round(0.5 / episode["step_time_s"])
    near = [every[max(i - half, 0) : i + half + 1] for i in range(len(every))]
    rows = [[sum(row[ear] for row in part) / len(part) for ear in (0, 1)] for part in near]
    top = max(max(row) for row in rows)
    low = min(min(row) for row in rows)
    bottom = TOP + 26 + CHART_HEIGHT

    def curve(ear):
        return [
            (CHART_LEFT + CHART_WIDTH * i / max(len(rows) - 1, 1), bottom - CHART_HEIGHT * (row[ear] - low) / max(top - low, 1e-9))
            for i, row in enumerate(rows)
        ]

    seconds = (len(rows) - 1) * episode["step_time_s"]
    axis = f"M{CHART_LEFT},{TOP + 20} V{bottom + 6} H{CHART_LEFT + CHART_WIDTH}"
    return [
        text(CHART_LEFT, TOP + 8, "Loudness at its ears while it walks", 15, weight="bold"),
        f'<path d="{axis}" fill="none" stroke="#888" stroke-width="1.2"/>',
        polyline(curve(0), LEFT_EAR, 2.5),
        polyline(curve(1), RIGHT_EAR, 2.5),
        text(CHART_LEFT + 12, TOP + 40, "left ear", 14, LEFT_EAR, weight="bold"),
        text(CHART_LEFT + 12, TOP + 60, "right ear", 14, RIGHT_EAR, weight="bold"),
        text(CHART_LEFT - 8, TOP + 30, f"+{top - low:.0f} dB", 12, "#555", "end"),
        text(CHART_LEFT - 8, bottom + 4, "0 dB", 12, "#555", "end"),
        text(CHART_LEFT, bottom + 24, "0 s", 12, "#555"),
        text(CHART_LEFT + CHART_WIDTH, bottom + 24, f"{seconds:.0f} s", 12, "#555", "end"),
    ]


def main(arguments):
    if len(arguments) != 2:
        sys.exit(__doc__)
    episode = episode_of(arguments[0])
    drawn, bottom = plan(episode)
    height = max(bottom, TOP + CHART_HEIGHT + 70) + 20
    title = "An agent walks to a sound that it cannot see, in a house that it has never been in"
    svg = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 960 {height:.0f}" font-family="Helvetica, Arial, sans-serif">',
        f"<title>{title}</title>",
        f'<rect width="960" height="{height:.0f}" fill="#fff"/>',
        text(LEFT, 34, title, 20, weight="bold"),
        *drawn,
        *levels(episode),
        "</svg>",
    ]
    pathlib.Path(arguments[1]).write_text("\n".join(svg) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
