# SPDX-License-Identifier: Apache-2.0
"""Corpora of `earshot dataset`, read by readers that are not ours: lhotse for its manifests, soundfile for the sounds, sofar for SOFA, which also
verifies the convention.  Parts whose package is missing are left out with a line; ends with 77 (skipped) if all are.

  dataset_test.py EARSHOT
"""
import importlib.util
import json
import pathlib
import subprocess
import sys
import tempfile

CONFIG = """seed: 3
shoeboxes: {count: 2, max_size_m: [5, 3, 5]}
sources_per_room: 2
listeners_per_source: 3
shared_listeners: true
acoustics: {rays: 16, rir_length_s: 0.2}
"""
SCENES = """seed: 3
shoeboxes: {count: 1, max_size_m: [5, 3, 5]}
recordings_per_room: 2
duration_s: 2
event_s: [0.5, 1.5]
classes: {alarm: synth:alarm, engine: synth:engine}
channels: ambisonic:1:sn3d:ego
acoustics: {rays: 16, rir_length_s: 0.2}
"""


def run(*command):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"


def lines_of(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def check_lhotse(folder):
    import numpy
    from lhotse import RecordingSet, SupervisionSet
    from lhotse.qa import validate_recordings_and_supervisions
    for corpus in ("corpus", "signals", "scenes"):
        recordings = RecordingSet.from_jsonl(folder / corpus / "recordings.jsonl").with_path_prefix(folder / corpus)
        if corpus != "corpus":
            supervisions = SupervisionSet.from_jsonl(folder / corpus / "supervisions.jsonl")
            validate_recordings_and_supervisions(recordings, supervisions, read_data=True)
            assert len(list(supervisions)) >= len(list(recordings))
        for recording in recordings:
            audio = recording.load_audio()
            assert audio.shape == (recording.num_channels, recording.num_samples) and numpy.isfinite(audio).all()
        print(f"lhotse: {corpus}, {len(list(recordings))} recordings")


def check_soundfile(folder):
    import soundfile
    count = 0
    for line in lines_of(folder / "signals" / "manifest.jsonl"):
        whole, rate = soundfile.read(folder / "signals" / line["file"])
        assert rate == 16000 and whole.shape == (line["num_samples"], 2) and abs(whole).max() < 1
        sum_of_stems = sum(soundfile.read(folder / "signals" / part["file"])[0] for part in line["talkers"] + [line["noise"]])
        assert abs(whole - sum_of_stems).max() < 1e-5
        count += 1
    print(f"soundfile: {count} signals are the sum of their stems")


def check_sofar(folder):
    import numpy
    import sofar
    wavs = {line["id"]: line for line in lines_of(folder / "corpus" / "manifest.jsonl")}
    has_soundfile = importlib.util.find_spec("soundfile") is not None
    files = set()
    for line in lines_of(folder / "sofa" / "manifest.jsonl"):
        path, m = folder / "sofa" / line["file"], line["measurement"]
        sofa = sofar.read_sofa(str(path), verify=True, verbose=False)
        if path not in files:
            assert sofa.verify(issue_handling="return") is None, sofa.verify(issue_handling="return")
        files.add(path)
        assert sofa.GLOBAL_SOFAConventions == "SingleRoomSRIR" and sofa.Data_IR.shape[:2] == (3, 2)
        if has_soundfile:  # the same response, to the bit
            import soundfile
            wav, rate = soundfile.read(folder / "corpus" / wavs[line["id"]]["file"], dtype="float32")
            assert rate == sofa.Data_SamplingRate and (sofa.Data_IR[m].T.astype("float32") == wav).all()
        # Direction and distance from positions in the file are those of the labels.
        toward = sofa.SourcePosition[m] - sofa.ListenerPosition[m]
        ahead, up = sofa.ListenerView[m], sofa.ListenerUp[m]
        left = numpy.cross(up, ahead)
        assert abs(numpy.linalg.norm(toward) - line["distance_m"]) < 1e-4
        azimuth = numpy.degrees(numpy.arctan2(toward @ left, toward @ ahead))
        assert abs((azimuth - line["azimuth_deg"] + 180) % 360 - 180) < 1e-2, (azimuth, line["azimuth_deg"])
    print(f"sofar: {len(files)} files keep the convention and hold the responses of the sound files")


def main(earshot):
    packages = {"lhotse": check_lhotse, "soundfile": check_soundfile, "sofar": check_sofar}
    found = [name for name in packages if importlib.util.find_spec(name)]
    for name in packages:
        if name not in found:
            print(f"left out: no python package {name}")
    if not found:
        sys.exit(77)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        (folder / "rir.yaml").write_text(CONFIG)
        (folder / "scenes.yaml").write_text(SCENES)
        run(earshot, "dataset", "rir", folder / "rir.yaml", "--out", folder / "corpus")
        speech = folder / "speech"
        speech.mkdir()
        for i in range(3):  # responses are sounds too
            (speech / f"{i}.wav").write_bytes((folder / "corpus" / lines_of(folder / "corpus" / "manifest.jsonl")[i]["file"]).read_bytes())
        run(earshot, "dataset", "convolve", folder / "corpus", "--speech", speech, "--noise", "synth", "--stems", "--out", folder / "signals")
        run(earshot, "dataset", "scenes", folder / "scenes.yaml", "--out", folder / "scenes")
        if "sofar" in found:
            done = subprocess.run([str(earshot), "dataset", "rir", str(folder / "rir.yaml"), "--sofa", "--out", str(folder / "sofa")],
                                  capture_output=True, text=True)
            if done.returncode == 2 and "has no HDF5" in done.stderr:
                print("left out: SOFA, which this build cannot write")
                found.remove("sofar")
            else:
                assert done.returncode == 0, done.stdout + done.stderr
        for package in found:
            packages[package](folder)
    print("passed")


main(pathlib.Path(sys.argv[1]))
