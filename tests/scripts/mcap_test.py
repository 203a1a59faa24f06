# SPDX-License-Identifier: Apache-2.0
"""An episode written by `earshot replay --mcap`, read by the reference reader of the format (package mcap of the Python package index): the messages of
every observation, at its time, are those of the result.  Ends with 77 (skipped) without that package.

  mcap_test.py EARSHOT
"""
import base64
import json
import pathlib
import subprocess
import sys
import tempfile

try:
    from mcap.reader import make_reader
except ImportError:
    print("skipped: no python package mcap")
    sys.exit(77)


def run(*command):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"


def main(earshot):
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        episodes, result, page = folder / "set.json", folder / "result.json", folder / "episode.mcap"
        run(earshot, "dataset", "episodes", "house:7,rooms=3,area_m2=36", "--count", "1", "--sounds", "synth:bird:3", "--out", episodes)
        run(earshot, "eval", "oracle", "--episodes", episodes, "--out", result)
        run(earshot, "replay", result, "--episode", "0", "--mcap", page)
        row = json.loads(result.read_text())["episodes"][0]
        with page.open("rb") as file:
            reader = make_reader(file)
            assert reader.get_header().library.startswith("earshot ")
            messages = [(schema, channel, message, json.loads(message.data)) for schema, channel, message in reader.iter_messages()]
    topics = {}
    for schema, channel, message, value in messages:
        assert channel.message_encoding == "json" and json.loads(schema.data)["title"] == schema.name
        assert set(value) <= set(json.loads(schema.data)["properties"]), schema.name
        topics.setdefault(channel.topic, []).append((message, value))
    count = len(row["actions"]) + 1
    assert sorted(topics) == ["/agent", "/camera", "/sound", "/step"]
    for entries in topics.values():
        assert [message.log_time for message, _ in entries] == [150_000_000 * i for i in range(count)]
    steps = [value for _, value in topics["/step"]]
    assert [value["action"] for value in steps] == [None] + row["actions"]
    assert abs(sum(value["reward"] for value in steps) - row["reward"]) < 1e-3
    assert base64.b64decode(topics["/camera"][0][1]["data"]).startswith(b"\xff\xd8\xff")
    assert len(base64.b64decode(topics["/sound"][0][1]["data"])) == 2400 * 2 * 2
    print(f"{len(messages)} messages of {count} observations\npassed")


main(pathlib.Path(sys.argv[1]))
