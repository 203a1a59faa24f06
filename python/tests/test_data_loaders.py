# SPDX-License-Identifier: Apache-2.0
"""Exports of a corpus read by other packages, and augmentation in a DataLoader.

Needs the environment of python/tests/data_loaders.txt; each test skips where its package is missing.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from corpora import make_corpus

import earshot
from earshot.data import Augment, CorpusResponses, SimulatedResponses, read_wav, write_parquet, write_webdataset

METHODS = ["fork", "forkserver", "spawn"]


@pytest.fixture(scope="module")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """From the program where EARSHOT_PROGRAM names it; otherwise of the same form."""
    folder = tmp_path_factory.mktemp("corpus")
    program = os.environ.get("EARSHOT_PROGRAM")
    if program is None:
        return make_corpus(folder / "corpus")
    config = folder / "rir.yaml"
    config.write_text(
        "seed: 2\nshoeboxes: {count: 3, max_size_m: [5, 3, 5]}\nsources_per_room: 2\nlisteners_per_source: 4\nstated_errors: true\n"
        "panorama: {width_px: 36, height_px: 12, views: 18}\nacoustics: {rays: 64, rir_length_s: 0.2}\n"
    )
    done = subprocess.run([program, "dataset", "rir", str(config), "--out", str(folder / "corpus")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / "corpus"


@pytest.fixture(scope="module")
def shards(corpus: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("shards") / "out"
    write_webdataset(corpus, out, license_id="cc-by-4.0", responses_per_shard=7)
    return out


@pytest.fixture(scope="module")
def table(corpus: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("pyarrow")
    out = tmp_path_factory.mktemp("table") / "out"
    write_parquet(corpus, out, license_id="cc-by-4.0", responses_per_shard=7)
    return out


def expected_of(corpus: Path) -> Iterator[tuple[dict[str, Any], np.ndarray[Any, Any]]]:
    """Lines of the manifest with the samples of the program's files."""
    for text in (corpus / "manifest.jsonl").read_text().splitlines():
        line = json.loads(text)
        yield line, read_wav((corpus / line["file"]).read_bytes())[0]


def test_webdataset(corpus: Path, shards: Path) -> None:
    webdataset = pytest.importorskip("webdataset")
    urls = sorted(str(path) for path in (shards / "data").glob("*.tar"))
    samples = list(webdataset.WebDataset(urls, shardshuffle=False))
    for sample, (line, rir) in zip(samples, expected_of(corpus), strict=True):
        assert sample["__key__"] == line["id"]
        assert json.loads(sample["json"])["drr_db"] == line["drr_db"]
        assert read_wav(sample["wav"])[0].tobytes() == rir.tobytes()
        if "rgb_file" in line:
            assert sample["rgb.png"] == (corpus / line["rgb_file"]).read_bytes()


def test_torchaudio_and_soundfile(corpus: Path, shards: Path) -> None:
    webdataset = pytest.importorskip("webdataset")
    torchaudio = pytest.importorskip("torchaudio")
    urls = sorted(str(path) for path in (shards / "data").glob("*.tar"))
    count = 0
    for sample, (_, rir) in zip(webdataset.WebDataset(urls, shardshuffle=False), expected_of(corpus), strict=True):
        samples, _rate = torchaudio.load(io.BytesIO(sample["wav"]))
        assert samples.numpy().tobytes() == rir.tobytes()
        count += 1
    assert count > 20
    line, rir = next(expected_of(corpus))
    samples, _rate = torchaudio.load(corpus / line["file"])
    assert samples.numpy().tobytes() == rir.tobytes()


def test_datasets(corpus: Path, shards: Path, table: Path, tmp_path: Path) -> None:
    datasets = pytest.importorskip("datasets")
    raw = datasets.Audio(decode=False)
    # As from the Hub, where the card names the files.
    rows = datasets.load_dataset(str(table), split="train", cache_dir=str(tmp_path)).cast_column("audio", raw)
    assert rows.features["t20_s"].feature.dtype == "float64"
    for row, (line, rir) in zip(rows, expected_of(corpus), strict=True):
        assert read_wav(row["audio"]["bytes"])[0].tobytes() == rir.tobytes()
        for key in ("id", "scene", "room", "distance_m", "drr_db", "t20_mid_s", "t20_s", "line_of_sight"):
            assert row[key] == line[key]
        assert row["source"]["position_m"] == line["source"]["position_m"]
        if "rgb_file" in line:
            assert row["rgb"].size == (36, 12)
    try:
        import torchcodec.encoders  # noqa: F401
    except (ImportError, RuntimeError):
        return  # the builder for tar files asks for it, and it for FFmpeg
    files = sorted(str(path) for path in (shards / "data").glob("*.tar"))
    samples = datasets.load_dataset("webdataset", data_files=files, split="train", cache_dir=str(tmp_path)).cast_column("wav", raw)
    for row, (line, rir) in zip(samples, expected_of(corpus), strict=True):
        assert row["__key__"] == line["id"]
        assert read_wav(row["wav"]["bytes"])[0].tobytes() == rir.tobytes()


def test_lhotse(corpus: Path, shards: Path) -> None:
    lhotse = pytest.importorskip("lhotse")
    webdataset = pytest.importorskip("webdataset")
    urls = sorted(str(path) for path in (shards / "data").glob("*.tar"))
    for sample, (line, rir) in zip(webdataset.WebDataset(urls, shardshuffle=False), expected_of(corpus), strict=True):
        recording = lhotse.Recording.from_bytes(sample["wav"], recording_id=line["id"])
        assert recording.num_samples == line["num_samples"]
        assert np.asarray(recording.load_audio(), dtype=np.float32).tobytes() == rir.tobytes()
    if (corpus / "recordings.jsonl").exists():
        recordings = lhotse.RecordingSet.from_jsonl(corpus / "recordings.jsonl").with_path_prefix(corpus)
        for recording, (_line, rir) in zip(recordings, expected_of(corpus), strict=True):
            assert np.asarray(recording.load_audio(), dtype=np.float32).tobytes() == rir.tobytes()


def test_croissant_is_valid(corpus: Path, shards: Path, table: Path, caplog: pytest.LogCaptureFixture) -> None:
    mlcroissant = pytest.importorskip("mlcroissant")
    for folder in (shards, table):
        dataset = mlcroissant.Dataset(str(folder / "croissant.json"))
        issues = dataset.metadata.ctx.issues
        assert not issues.errors
        assert not issues.warnings
        assert not [record.message for record in caplog.records if "@context" in record.message]
        records = list(dataset.records("responses"))
        for record, (line, _) in zip(records, expected_of(corpus), strict=True):
            assert record["responses/id"].decode() == line["id"]
            assert record["responses/distance_m"] == pytest.approx(line["distance_m"], rel=1e-12)
            expected, found = (np.array(list(times), dtype=np.float64) for times in (line["rt60_s"], record["responses/rt60_s"]))
            np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_card_is_read_by_the_hub(table: Path) -> None:
    hub = pytest.importorskip("huggingface_hub")
    card = hub.DatasetCard.load(table / "README.md")
    assert card.data.license == "cc-by-4.0"
    assert card.data.configs[0]["data_files"][0]["path"] == "data/*.parquet"


def speech(count: int) -> list[np.ndarray[Any, Any]]:
    draw = np.random.default_rng(2)
    return [draw.standard_normal(400 + 10 * (i % 3)).astype(np.float32) for i in range(count)]


def digest(items: Any) -> list[tuple[int, str, float]]:
    return [(int(item["index"]), hashlib.sha256(item["signal"].numpy().tobytes()).hexdigest(), float(item["snr_db"])) for item in items]


@pytest.mark.parametrize("kind", ["corpus", "simulated"])
def test_workers_change_no_bit(corpus: Path, kind: str) -> None:
    """Every number of workers and start method, over two passes of workers that live on; the parent has used the engine before it forks."""
    torch = pytest.importorskip("torch")
    from earshot.data.torch import AugmentedSpeech

    responses: Any = CorpusResponses(corpus) if kind == "corpus" else SimulatedResponses(4, 3, length_s=0.1, settings={"rays": 32})
    dataset = AugmentedSpeech(Augment(responses, noise="white", seed=9), speech(24))
    expected = []
    for epoch in range(2):
        dataset.set_epoch(epoch)
        expected.append(digest(dataset[i] for i in range(24)))
    assert {found for _, found, _ in expected[0]}.isdisjoint(found for _, found, _ in expected[1])
    for method in METHODS:
        for workers in (1, 2, 3):
            loader = torch.utils.data.DataLoader(
                dataset, batch_size=None, num_workers=workers, multiprocessing_context=method, persistent_workers=True, timeout=120
            )
            for epoch in range(2):
                dataset.set_epoch(epoch)
                assert digest(loader) == expected[epoch], (method, workers, epoch)
            del loader


def test_a_stream_has_one_order(corpus: Path) -> None:
    torch = pytest.importorskip("torch")
    from earshot.data.torch import AugmentedSpeech, AugmentedStream

    augment = Augment(CorpusResponses(corpus), noise="white")
    dataset = AugmentedSpeech(augment, speech(25))
    for method, workers, batch, rank, world in [
        (None, 0, 4, 0, 1),
        ("fork", 2, 4, 0, 1),
        ("spawn", 3, 4, 0, 1),
        ("forkserver", 2, 1, 0, 1),
        ("fork", 2, 3, 0, 2),
        ("fork", 4, 3, 1, 2),
        ("fork", 9, 16, 1, 2),
    ]:
        stream = AugmentedStream(augment, speech(25), batch_size=batch, rank=rank, world=world)
        loader = torch.utils.data.DataLoader(
            stream, batch_size=batch, collate_fn=list, num_workers=workers, multiprocessing_context=method, timeout=120 if workers else 0
        )
        items = [item for found in loader for item in found]
        assert digest(items) == digest(dataset[i] for i in range(rank, 25, world)), (method, workers, batch)
    with pytest.raises(earshot.InputError, match="rank is 2 of 2"):
        AugmentedStream(augment, speech(2), rank=2, world=2)
    with pytest.raises(earshot.InputError, match="batch_size is 0"):
        AugmentedStream(augment, speech(2), batch_size=0)
    with pytest.raises(earshot.InputError, match="speech is empty"):
        AugmentedSpeech(augment, [])


def test_objects_of_the_engine_survive_a_fork() -> None:
    """A scene that the parent has rendered with threads renders the same bits in forked workers, also beside a parent that goes on."""
    torch = pytest.importorskip("torch")
    scene = earshot.Scene("house:3,rooms=1,area_m2=20", preset="fast", settings={"rir_length_s": 0.1, "rays": 64})
    places = scene.random_positions(9, seed=1)
    source = scene.source(places[0])
    expected = source.render(places[1:], threads=2)

    class Rendered(torch.utils.data.Dataset):  # type: ignore[misc,name-defined]
        def __len__(self) -> int:
            return 8

        def __getitem__(self, index: int) -> Any:
            return torch.from_numpy(source.render(places[1 + index], threads=1))

    for _ in range(3):
        for index, rir in enumerate(
            torch.utils.data.DataLoader(Rendered(), batch_size=None, num_workers=2, multiprocessing_context="fork", timeout=120)
        ):
            assert rir.numpy().tobytes() == expected[index].tobytes()
            assert source.render(places[1 + index], threads=2).tobytes() == expected[index].tobytes()


def test_a_bad_utterance_ends_the_pass_by_name(corpus: Path) -> None:
    torch = pytest.importorskip("torch")
    from earshot.data.torch import AugmentedSpeech

    utterances = speech(6)
    utterances[4] = np.zeros(100, np.float32)
    loader = torch.utils.data.DataLoader(
        AugmentedSpeech(Augment(CorpusResponses(corpus)), utterances),
        batch_size=None,
        num_workers=2,
        multiprocessing_context="fork",
        timeout=120,
    )
    with pytest.raises(Exception, match="speech 4: is silent"):
        list(loader)


if __name__ == "__main__":
    sys.exit(pytest.main([__file__]))
