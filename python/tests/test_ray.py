# SPDX-License-Identifier: Apache-2.0
"""earshot.ray and earshot.dask with the real packages on two local nodes.

The tests skip where a package or the program is missing, as in scripts/test_python.sh, which installs neither Ray nor Dask.  To run them::

    python3 -m venv venv && venv/bin/pip install 'ray[data,tune]' distributed pytest gymnasium
    EARSHOT_PROGRAM=$PWD/build/release/earshot PYTHONPATH=build/release/python_package \
        venv/bin/python -m pytest -rs python/tests/test_ray.py
"""

from __future__ import annotations

import glob
import importlib
import json
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from corpora import PROGRAM, needs_program, small_config

from earshot._program import run_program
from earshot._wav import samples_of, wav

RESPONSES = small_config(shoeboxes=6, rooms_per_folder=1)

TRAINING = """
name: tiny
seed: 3
envs_per_worker: 2
rollout_steps: 4
checkpoint_every: 1
total_steps: 64
eval_envs: 2
out: run
env:
  task: {max_steps: 12}
  observation: {depth: false, camera: {width_px: 40, height_px: 40}}
  acoustics: {rays: 4, rir_length_s: 0.1, early_order: 0}
policy: {hidden_size: 8, visual_features: 8, audio_features: 8, conv_channels: 2}
data:
  train:
    {file: train.json.gz, scenes: ["shoebox:6x3x5@0.3"], episodes_per_scene: 6, sounds: ["synth:noise"],
     filter: {min_geodesic_m: 1, min_ratio: 1}}
  eval:
    {file: eval.json.gz, scenes: ["shoebox:6x3x5@0.3"], episodes_per_scene: 11, sounds: ["synth:noise"],
     filter: {min_geodesic_m: 1, min_ratio: 1}}
"""


def run(*arguments: str) -> str:
    return run_program([PROGRAM, *arguments], cwd=os.getcwd())


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def wait_until(condition: Callable[[], bool], seconds: float = 120) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "has not happened in time"
        time.sleep(0.02)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two nodes of one core each.  The head takes part."""
    os.environ.setdefault("RAY_worker_niceness", "0")  # else workers get what other processes of a busy machine leave
    ray = pytest.importorskip("ray", reason="ray is not installed: pip install 'earshot-rl[ray]'")
    cluster_utils = importlib.import_module("ray.cluster_utils")
    keys = {"num_cpus": 1, "object_store_memory": 200_000_000, "include_dashboard": False}
    nodes = cluster_utils.Cluster(initialize_head=True, head_node_args=keys)
    nodes.add_node(num_cpus=1, object_store_memory=200_000_000)
    ray.init(address=nodes.address, log_to_driver=False)
    yield nodes
    ray.shutdown()
    nodes.shutdown()


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with configs; the program reads paths from there on each node."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rir.yaml").write_text(RESPONSES)
    (tmp_path / "tiny.yaml").write_text(TRAINING)
    return tmp_path


@pytest.mark.parametrize(("module", "package", "extra"), [("earshot.ray", "ray", "ray"), ("earshot.dask", "distributed", "dask")])
def test_a_missing_package_is_named_with_its_extra(module: str, package: str, extra: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith(module)]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=rf"needs {package}: pip install 'earshot-rl\[{extra}\]'"):
        importlib.import_module(module)


@needs_program
def test_corpora_have_the_bytes_of_one_process(cluster: Any, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import earshot.ray

    run("dataset", "rir", "rir.yaml", "--out", "one")
    assert earshot.ray.corpus("rir", ["rir.yaml"], out="parts") == str(here / "parts")
    assert bytes_of(here / "parts") == bytes_of(here / "one")
    assert "corpus parts  100 %  6/6 parts" in capsys.readouterr().err.splitlines()[-1]
    earshot.ray.corpus("rir", ["rir.yaml"], out="shared", shared=True, progress=False)
    assert bytes_of(here / "shared") == bytes_of(here / "one")
    before = {path: path.stat().st_mtime_ns for path in (here / "parts").rglob("0*.wav")}
    earshot.ray.corpus("rir", ["rir.yaml"], out="parts")  # is complete
    assert {path: path.stat().st_mtime_ns for path in (here / "parts").rglob("0*.wav")} == before

    rng = np.random.default_rng(1)
    (here / "speech").mkdir()
    for number in range(3):
        (here / f"speech/{number}.wav").write_bytes(wav(rng.uniform(-0.5, 0.5, (1, 4000)).astype(np.float32), 16000))
    signals = ["one", "--speech", "speech", "--count", "12", "--signals-per-folder", "5"]
    run("dataset", "convolve", *signals, "--out", "one_signals")
    earshot.ray.corpus("convolve", signals, out="signals", progress=False)
    assert bytes_of(here / "signals") == bytes_of(here / "one_signals")
    assert not glob.glob(str(here / "earshot-*"))


@needs_program
def test_parts_of_a_killed_node_are_made_again(cluster: Any, here: Path) -> None:
    """The node is killed while it makes a part: the mark is the folder of that part, named by the node, which stays behind."""
    import earshot.ray

    slow = ["rir.yaml", "--set", "acoustics.rays=4096", "--set", "listeners_per_source=20"]
    run("dataset", "rir", *slow, "--out", "one")
    doomed = cluster.add_node(num_cpus=1, object_store_memory=200_000_000)
    cluster.wait_for_nodes()
    name = doomed.node_id[:8]
    (here / "scratch").mkdir()
    failure: list[BaseException] = []

    def work() -> None:
        try:
            earshot.ray.corpus("rir", slow, out="parts", scratch=str(here / "scratch"), progress=False)
        except BaseException as error:
            failure.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    wait_until(lambda: bool(glob.glob(f"scratch/earshot-{name}-part-*/corpus/0*/*.wav")) or not thread.is_alive())
    cluster.remove_node(doomed, allow_graceful=False)
    left = glob.glob(f"scratch/earshot-{name}-part-*")
    thread.join(300)
    assert not failure
    assert not thread.is_alive()
    assert left  # a part was lost
    assert bytes_of(here / "parts") == bytes_of(here / "one")


@needs_program
def test_evaluations_have_the_bytes_of_one_process(cluster: Any, here: Path) -> None:
    import earshot.ray

    run("dataset", "episodes", "--config", "tiny.yaml")
    run("train", "tiny.yaml")
    for agent, arguments in [("run", ["--argmax"]), ("random", ["--config", "tiny.yaml", "--seed", "4", "--name", "dice"])]:
        run("eval", agent, *arguments, "--out", f"{agent}_one.json")
        for parts in (None, 5):
            found = earshot.ray.evaluate(agent, arguments, out=f"{agent}.json", parts=parts, progress=False)
            assert (here / f"{agent}.json").read_bytes() == (here / f"{agent}_one.json").read_bytes()
            assert found == json.loads((here / f"{agent}_one.json").read_bytes())
            (here / f"{agent}.json").unlink()
    assert not glob.glob("*.parts")
    # Parts of another evaluation are not joined.
    run("eval", "random", "--config", "tiny.yaml", "--shard", "1/2", "--parts", "random.json.parts")
    with pytest.raises(earshot.InputError, match="has parts of another evaluation"):
        earshot.ray.evaluate("random", ["--config", "tiny.yaml", "--seed", "4"], out="random.json", progress=False)
    earshot.ray.evaluate("random", ["--config", "tiny.yaml"], out="random.json", progress=False)  # goes on with part 1
    run("eval", "random", "--config", "tiny.yaml", "--out", "one.json")
    assert (here / "random.json").read_bytes() == (here / "one.json").read_bytes()


@needs_program
def test_a_sweep_gives_the_runs_of_the_command(cluster: Any, here: Path) -> None:
    import earshot.ray

    run("dataset", "episodes", "--config", "tiny.yaml")
    for out in ("one", "trials"):
        text = (
            f"config: tiny.yaml\nname: tiny\nout: {out}\nseeds: [1, 2]\nevaluate: []\nruns: {{base: [], fast: [ppo.learning_rate=1e-3]}}\n"
        )
        (here / f"{out}.yaml").write_text(text)
    run("sweep", "one.yaml")
    results = earshot.ray.sweep("trials.yaml")
    for name in ("base/seed_1", "base/seed_2", "fast/seed_1", "fast/seed_2"):
        events = [curve(here / out / name) for out in ("one", "trials")]
        assert events[0] == events[1]
        one, other = (json.loads((here / out / f"{name}.result.json").read_text()) for out in ("one", "trials"))
        assert one["episodes"] == other["episodes"]
    assert len(results) == 4
    for result in results:
        points = curve(here / "trials" / result.config["run"])
        assert result.metrics["update"] == 8
        assert result.metrics["loss"] == points[-1]["policy/loss"]
        assert list(result.metrics_dataframe["policy/entropy"]) == [point["policy/entropy"] for point in points]
    assert "2/2" in (here / "trials/table.txt").read_text()
    (here / "trials.yaml").write_text((here / "trials.yaml").read_text().replace("1e-3", "2e-3"))
    with pytest.raises(earshot.InputError, match="settings that differ"):
        earshot.ray.sweep("trials.yaml")


def curve(folder: Path) -> list[dict[str, float]]:
    """Without times, and without what caches held: a run that goes on from a checkpoint fills them anew."""
    lines = (folder / "events.jsonl").read_text().splitlines()
    points = [json.loads(line)["values"] for line in lines]
    return [
        {name: value for name, value in point.items() if not name.startswith(("time/", "workers/", "fields/", "hearing/cached"))}
        for point in points
    ]


@needs_program
def test_evaluations_and_sweeps_outlive_a_killed_node(cluster: Any, here: Path) -> None:
    """Three works of one core on three nodes, one of which is killed while all are under way."""
    import earshot.ray

    keys = ["env.task.max_steps=400", "data.eval.episodes_per_scene=60", "data.eval.file=slow.json.gz", "data.train.file=other.json.gz"]
    slow = ["--config", "tiny.yaml", *(text for key in keys for text in ("--set", key))]
    run("dataset", "episodes", "--config", "tiny.yaml")
    run("dataset", "episodes", *slow)
    run("eval", "random", *slow, "--out", "one.json")
    for out in ("one", "trials"):
        text = f"config: tiny.yaml\nname: tiny\nout: {out}\nseeds: [1, 2, 3]\nset: [total_steps=800]\nruns: {{base: []}}\n"
        (here / f"{out}.yaml").write_text(text)
    run("sweep", "one.yaml")
    (here / "scratch").mkdir()
    scratch = str(here / "scratch")
    works: list[tuple[Callable[[], Any], Callable[[str], bool]]] = [
        (
            lambda: earshot.ray.evaluate("random", slow, out="parts.json", parts=3, scratch=scratch, progress=False),
            lambda name: bool(glob.glob(f"scratch/earshot-{name}-eval-*")),
        ),
        (lambda: earshot.ray.sweep("trials.yaml"), lambda _: len(glob.glob("trials/base/seed_*/checkpoints/*.ckpt")) >= 3),
    ]
    for work, is_begun in works:
        doomed = cluster.add_node(num_cpus=1, object_store_memory=200_000_000)
        cluster.wait_for_nodes()
        failure: list[BaseException] = []

        def guarded_work(work: Callable[[], Any] = work, failure: list[BaseException] = failure) -> None:
            try:
                work()
            except BaseException as error:
                failure.append(error)

        thread = threading.Thread(target=guarded_work)
        thread.start()
        while not is_begun(doomed.node_id[:8]) and thread.is_alive():
            time.sleep(0.02)
        assert thread.is_alive()
        cluster.remove_node(doomed, allow_graceful=False)
        thread.join(400)
        assert not failure
        assert not thread.is_alive()
    assert (here / "parts.json").read_bytes() == (here / "one.json").read_bytes()
    for seed in (1, 2, 3):
        assert curve(here / f"trials/base/seed_{seed}") == curve(here / f"one/base/seed_{seed}")


@needs_program
def test_tune_searches_keys_of_the_config(cluster: Any, here: Path) -> None:
    tune = pytest.importorskip("ray.tune")
    import earshot.ray

    run("dataset", "episodes", "--config", "tiny.yaml")
    space = {"ppo.learning_rate": tune.grid_search([1e-3, 0.0007]), "policy.hidden_size": 8}
    function = earshot.ray.trainable("tiny.yaml", ["total_steps=32"], out="trials")
    storage = tune.RunConfig(storage_path=str(here / "tune"), verbose=0)
    results = tune.Tuner(tune.with_resources(function, {"CPU": 1}), param_space=space, run_config=storage).fit()
    assert [result.error for result in results] == [None, None]
    for number, result in enumerate(results):
        rate = result.config["ppo.learning_rate"]
        run("train", "tiny.yaml", "total_steps=32", f"ppo.learning_rate={rate!r}", f"out=one{number}")
        points = curve(here / f"one{number}")
        assert result.metrics["policy/loss"] == result.metrics["loss"] == points[-1]["policy/loss"]
        assert result.metrics["env_steps"] == 32
    with pytest.raises(earshot.InputError, match=r"no\.yaml does not exist"):
        earshot.ray.trainable("no.yaml", out="trials")


def test_rollouts_are_those_of_one_batch(cluster: Any, small: Callable[..., dict[str, Any]]) -> None:
    import earshot.ray

    act = earshot.ray.random_actions(5)
    envs = earshot.make_vec(small(), 5, autoreset_mode="same_step", copy=True)
    with earshot.ray.Rollouts(small(), 5, actors=2) as batch:
        for seed in (11, 3):
            rollout = batch.collect(20, seed=seed, act=act)
            observations, _ = envs.reset(seed=[seed + env for env in range(5)])
            begins = np.ones(5, bool)
            for step in range(20):
                assert np.array_equal(rollout["begins"][step], begins)
                for name, value in observations.items():
                    assert np.array_equal(rollout["observations"][name][step], value), (name, step)
                observations, rewards, ends, cuts, _ = envs.step(np.asarray(act(observations, begins, np.arange(5), step)))
                assert np.array_equal(rollout["rewards"][step], rewards)
                assert np.array_equal(rollout["terminations"][step], ends)
                begins = ends | cuts
            assert rollout["begins"][1:].any()  # an episode ended
            for name, value in observations.items():
                assert np.array_equal(rollout["last_observations"][name], value)
        with pytest.raises(earshot.InputError, match=r"act returned actions of shape \(3,\)"):
            batch.collect(1, seed=1, act=lambda *_: [1, 1, 1])
    with pytest.raises(earshot.InputError, match="6 actors for 5 environments"):
        earshot.ray.Rollouts(small(), 5, actors=6)
    with pytest.raises(earshot.InputError, match="takes no render_mode"):
        earshot.ray.Rollouts(small(), 5, actors=1, render_mode="human")


def test_scenes_of_actors_render_the_bits_of_one_scene(cluster: Any) -> None:
    import earshot.ray

    scene = earshot.Scene("shoebox:6x3x5@0.3")
    places = scene.random_positions(9, seed=2)
    jobs = [(places[source], places[4 : 9 if source % 2 else 5]) for source in range(4)]
    with earshot.ray.SceneActors("shoebox:6x3x5@0.3", 2) as actors:
        rirs = list(actors.render(jobs, channels="binaural"))
        for (source, listeners), rir in zip(jobs, rirs, strict=True):
            assert np.array_equal(rir, scene.source(source).render(listeners, channels="binaural"))
        with pytest.raises(earshot.InputError, match="threads is cpus_per_actor"):
            next(actors.render(jobs, threads=2))
        with pytest.raises(earshot.InputError, match="outside"):
            next(actors.render([([99, 1, 1], places[0])]))


@needs_program
def test_ray_data_reads_and_makes_corpora(cluster: Any, here: Path) -> None:
    import earshot.ray

    run("dataset", "rir", "rir.yaml", "--out", "one")
    lines = [json.loads(line) for line in (here / "one/manifest.jsonl").read_text().splitlines()]
    with pytest.raises(earshot.InputError, match="has no complete corpus"):
        earshot.ray.read_corpus("two")
    for data in (earshot.ray.read_corpus("one"), earshot.ray.generate("rir", ["rir.yaml"])):
        rows = {row["id"]: row for row in data.take_all()}
        assert sorted(rows) == [line["id"] for line in lines]
        for line in lines:
            row = rows[line["id"]]
            samples, rate_hz = samples_of((here / "one" / line["file"]).read_bytes(), line["file"])
            assert np.array_equal(np.asarray(row["audio"]), samples)
            assert row["audio"].dtype == np.float32
            assert row["sample_rate_hz"] == rate_hz
            assert row["listener.index"] == line["listener"]["index"]
            assert list(row["source.position_m"]) == line["source"]["position_m"]
            assert row["drr_db"] == line["drr_db"]
    batch = next(iter(earshot.ray.read_corpus("one").iter_batches(batch_size=4)))
    assert batch["audio"].shape == (4, 1, 1600)
    # Signals of several lengths.
    (here / "speech").mkdir()
    for number in range(3):
        (here / f"speech/{number}.wav").write_bytes(wav(np.ones((1, 3000 + 500 * number), np.float32), 16000))
    signals = earshot.ray.generate("convolve", ["one", "--speech", "speech", "--count", "3"])
    assert len({row["audio"].shape for row in signals.take_all()}) == 3
    run("dataset", "rir", "rir.yaml", "--set", "format=flac", "--out", "flac")
    with pytest.raises(earshot.InputError, match=r"only corpora of WAV files"):
        earshot.ray.read_corpus("flac")


@needs_program
def test_wrong_use_is_refused_with_one_line(cluster: Any, here: Path) -> None:
    import earshot.ray

    def refused(match: str, function: Callable[..., Any], *arguments: Any, **keys: Any) -> None:
        with pytest.raises((earshot.InputError, TypeError), match=match) as error:
            function(*arguments, **keys)
        assert "\n" not in str(error.value)

    corpus, evaluate = earshot.ray.corpus, earshot.ray.evaluate
    refused("cpus_per_part is 0; it must be above 0", corpus, "rir", ["rir.yaml"], out="out", cpus_per_part=0)
    refused("cpus_per_part must be a number, not str", corpus, "rir", ["rir.yaml"], out="out", cpus_per_part="2")
    refused("the largest node has 1 cores", corpus, "rir", ["rir.yaml"], out="out", cpus_per_part=64)
    refused("no.yaml", corpus, "rir", ["no.yaml"], out="out")
    refused("--json is not written here", evaluate, "random", ["--json", "a.json"], out="out.json")
    refused("parts is -1", evaluate, "random", out="out.json", parts=-1)
    refused(
        "eval.json.gz: no such file", evaluate, "random", ["--config", "tiny.yaml"], out="out.json", progress=False
    )  # refused by the nodes
    refused("no.yaml", earshot.ray.sweep, "no.yaml")
    with pytest.raises(AttributeError, match="sweeep"):
        _ = earshot.ray.sweeep


@needs_program
def test_dask_gives_the_bytes_too(here: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="dask is not installed: pip install 'earshot-rl[dask]'")
    import earshot.dask

    run("dataset", "rir", "rir.yaml", "--out", "one")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local, distributed.Client(local) as client:
        earshot.dask.corpus("rir", ["rir.yaml"], out="parts", client=client, progress=False)
        assert bytes_of(here / "parts") == bytes_of(here / "one")
        with pytest.raises(earshot.InputError, match="shoebox"):
            earshot.dask.corpus("rir", ["rir.yaml", "--set", "shoebox=1"], out="other", client=client)
        # A worker that is killed amid a part.
        slow = ["rir.yaml", "--set", "acoustics.rays=4096", "--set", "listeners_per_source=20"]
        run("dataset", "rir", *slow, "--out", "slow_one")
        (here / "scratch").mkdir()
        doomed = client.run(os.getpid)

        def kill() -> None:
            wait_until(lambda: bool(glob.glob("scratch/*/corpus/0*/*.wav")))
            os.kill(min(doomed.values()), 9)

        killer = threading.Thread(target=kill)
        killer.start()
        earshot.dask.corpus("rir", slow, out="slow", client=client, scratch=str(here / "scratch"), progress=False)
        killer.join()
        assert bytes_of(here / "slow") == bytes_of(here / "slow_one")


@needs_program
def test_the_example_prints_what_it_reads(
    cluster: Any, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parent.parent / "examples"))
    monkeypatch.setattr(sys, "argv", ["ray_corpus.py", "rir.yaml", "--set", "shoeboxes.count=2", "--batch-size", "2"])
    importlib.import_module("ray_corpus").main()
    lines = capsys.readouterr().out.splitlines()
    assert [int(line.split()[0]) for line in lines if "responses" in line] == [2, 4]
