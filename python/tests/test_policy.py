# SPDX-License-Identifier: Apache-2.0
"""earshot.Policy: the logits of libtorch, the actions of the program, the same through ONNX, and refusals."""

from __future__ import annotations

import contextlib
import json
import os
import struct
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xxhash
from numpy.typing import NDArray

import earshot
from earshot._network import Architecture, Network, Sensor
from earshot._policy_file import read_policy_file
from earshot._xxh3 import xxh3_64

QUICK = Path(__file__).parents[2] / "configs" / "policies" / "quick.policy"
HEADER = 20

#: [3 steps, 4 envs, 4 actions] of the shipped policy for drawn_observations(0), (1) and (2), where env 1 begins an episode at step 2: by
#: torch.nn.functional and torch.nn.GRUCell of libtorch 1.13.
LOGITS = np.array([
    [
        [-6.007322, 0.637075, 0.236795, -0.282899],
        [-5.373582, 0.056896, 0.042575, 0.092160],
        [-4.344074, 0.750025, -0.857453, -0.065870],
        [-3.339010, 0.726368, -1.077037, -0.225624],
    ],
    [
        [-6.724841, -0.187678, 2.370247, -1.515641],
        [-5.715580, -0.203055, 2.271445, -1.888844],
        [-6.357516, 1.120006, 0.325981, -1.002165],
        [-6.903989, 1.487215, -0.176257, -0.595324],
    ],
    [
        [-6.318087, -0.051189, 3.174581, -2.622449],
        [-5.956140, -0.713967, 3.461064, -2.280764],
        [-6.413684, -0.198376, 2.471487, -1.834824],
        [-6.574071, -0.314384, 2.118107, -1.328655],
    ],
])  # fmt: skip
TOLERANCE = 1e-5  #: of libtorch's float32, relative to 1 + size


def weyl(shape: tuple[int, ...], start: float) -> NDArray[np.float64]:
    """Multiples of an irrational number, modulo 1."""
    values = (np.arange(np.prod(shape), dtype=np.float64) * 0.7548776662466927 + start) % 1.0
    return np.asarray(values, np.float64).reshape(shape)


def drawn_observations(step: int, count: int = 4) -> dict[str, NDArray[Any]]:
    start = 0.1 * step
    return {
        "depth": weyl((count, 64, 64, 1), start + 0.1).astype(np.float32),
        "interaural": (4 * weyl((count, 65, 26, 4), start + 0.2) - 2).astype(np.float32),
        "collision": (weyl((count, 1), start + 0.3) > 0.5).astype(np.uint8),
        "previous_action": (np.floor(5 * weyl((count, 1), start + 0.4)) - 1).astype(np.int32),
    }


def policy() -> earshot.Policy:
    return earshot.Policy.load(QUICK)


def test_logits_are_those_of_libtorch_through_time_and_at_the_start_of_episodes() -> None:
    agent = policy()
    state = agent.initial_state(4)
    for step, expected in enumerate(LOGITS):
        if step == 2:
            state[1] = 0
        logits, _, state = agent.step(drawn_observations(step), state)
        np.testing.assert_allclose(logits, expected, rtol=0, atol=TOLERANCE * (1 + np.abs(expected).max()))
        assert (logits.argmax(1) == expected.argmax(1)).all()


def test_act_keeps_the_state_and_takes_single_environments() -> None:
    batch, single = policy(), policy()
    for step in range(3):
        observations = drawn_observations(step)
        begins = np.array([step == 0, step in (0, 2), step == 0, step == 0])
        actions = batch.act(observations, begins)
        assert actions.dtype == np.int32
        assert (actions == LOGITS[step].argmax(1)).all()
        assert single.act({name: rows[1] for name, rows in observations.items()}, step in (0, 2)) == actions[1]


def test_sampled_actions_have_the_distribution_of_the_logits() -> None:
    agent, count = policy(), 4000
    one = {name: np.repeat(rows[3:4], count, 0) for name, rows in drawn_observations(0).items()}
    actions = agent.act(one, sample=True, rng=np.random.default_rng(5))
    probabilities = np.exp(LOGITS[0, 3]) / np.exp(LOGITS[0, 3]).sum()
    expected = count * probabilities
    # Chi-square of 3 degrees of freedom: over 21.1 once in 10,000; the seed is fixed.
    assert ((np.bincount(actions, minlength=4) - expected) ** 2 / expected).sum() < 21.1


def test_describes_itself() -> None:
    agent = policy()
    assert agent.observation_shapes == {"depth": (64, 64, 1), "interaural": (65, 26, 4), "collision": (1,), "previous_action": (1,)}
    assert agent.num_parameters == 370987  # as `earshot train` prints it
    assert not agent.has_value
    assert "name: quick" in agent.config_text
    assert agent.architecture.startswith("actor-critic v1: depth 64x64x1")


def test_the_package_brings_the_shipped_agent() -> None:
    agent = earshot.Policy.load("earshot:policies/quick")
    assert agent.architecture == policy().architecture
    assert all(np.array_equal(agent.weights[name], array) for name, array in policy().weights.items())
    with pytest.raises(earshot.InputError, match="earshot:policies/slow: the package has no such policy; it has earshot:policies/quick"):
        earshot.Policy.load("earshot:policies/slow")


def few_episodes(folder: Path) -> tuple[Path, list[str]]:
    """Episodes of a house that the agent has not seen, and how the environments hear there: without the stored fields, which take long."""
    config = folder / "few.yaml"
    data = '{{file: {}, scenes: ["house:2000,rooms=3,area_m2=36"], episodes_per_scene: 3, sounds: ["synth:telephone:100"], seed: 2, {}}}'
    reach = "filter: {min_geodesic_m: 1.5, max_geodesic_m: 5, min_ratio: 1.0}"
    sets = [data.format(folder / f"{name}.json", reach) for name in ("train", "eval")]
    config.write_text(f"name: few\ndata:\n  train: {sets[0]}\n  eval: {sets[1]}\n")
    return config, ["env.acoustics.field=off", "env.task.max_steps=60", f"env.quarantine_dir={folder / 'quarantine'}"]


def test_takes_the_actions_of_the_program_on_what_the_environments_show(tmp_path: Path) -> None:
    program = os.environ.get("EARSHOT_PROGRAM")
    if not program or "site-packages" in earshot.__file__:
        pytest.skip("EARSHOT_PROGRAM names no program that was built with the libraries of the package")
    config, overrides = few_episodes(tmp_path)
    subprocess.run([program, "dataset", "episodes", "--config", str(config)], check=True, capture_output=True)
    episodes, result = tmp_path / "eval.json", tmp_path / "result.json"
    command = [program, "eval", str(QUICK), "--episodes", str(episodes), "--argmax", "--out", str(result)]
    for override in [*overrides, "eval_envs=3"]:
        command += ["--set", override]
    subprocess.run(command, check=True, capture_output=True)
    expected = [episode["actions"] for episode in json.loads(result.read_text())["episodes"]]

    agent = policy()
    run_config = tmp_path / "quick.yaml"
    run_config.write_text(agent.config_text)
    where = [f"data.eval.file={episodes}", "data.eval.scenes=[]", "env.order=once"]
    envs = earshot.make_vec(run_config, num_envs=3, split="eval", overrides=[*overrides, *where], autoreset_mode="same_step")
    observations, _ = envs.reset()  # a seed would make other sound of the same episodes
    begins, done = np.ones(3, bool), np.zeros(3, bool)
    taken: list[list[int]] = [[], [], []]
    while not done.all():
        actions = agent.act(observations, begins)
        for env in np.flatnonzero(~done):
            taken[env].append(int(actions[env]))
        observations, _, terminated, truncated, _ = envs.step(actions)
        begins = terminated | truncated
        done |= begins
    assert taken == expected
    assert sum(map(len, taken)) > 20


def test_onnx_has_the_same_logits_and_actions_for_ten_thousand_observations(tmp_path: Path) -> None:
    pytest.importorskip("onnx")
    runtime = pytest.importorskip("onnxruntime")
    agent, path, count, steps = policy(), tmp_path / "quick.onnx", 500, 20
    agent.to_onnx(path)
    options = runtime.SessionOptions()
    options.intra_op_num_threads = 1
    session = runtime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    state = other = agent.initial_state(count)
    for step in range(steps):
        observations = drawn_observations(step, count)
        logits, _, state = agent.step(observations, state)
        exported, other = session.run(["logits", "next_state"], observations | {"state": other})
        np.testing.assert_allclose(exported, logits, rtol=0, atol=1e-4)
        sorted_logits = np.sort(logits, 1)
        clear = sorted_logits[:, 3] - sorted_logits[:, 2] > 1e-4  # rounding decides the others
        assert clear.mean() > 0.999
        assert (exported.argmax(1) == logits.argmax(1))[clear].all()


def made_network(line: str, seed: int = 3) -> Network:
    """With drawn weights of the shapes that the architecture wants."""
    architecture = Architecture.of(line)
    rng = np.random.default_rng(seed)
    weights: dict[str, NDArray[np.float32]] = {}

    def add(name: str, *shape: int) -> None:
        weights[name] = rng.normal(0, 0.2, shape).astype(np.float32)

    features = 0
    for sensor in architecture.sensors:
        if not sensor.is_picture and not sensor.is_sound:
            features += {"gps_compass": 4, "pose": 5, "previous_action": 5}.get(sensor.kind, int(np.prod(sensor.shape)))
    for encoder in architecture.encoders:
        rows, columns = encoder.sensors[0].shape[:2]
        channels = sum(sensor.shape[2] for sensor in encoder.sensors)
        kernels = (5, 3, 3) if encoder.prefix == "audio" and min(rows, columns) < 30 else (8, 4, 3)
        for layer, (kernel, stride, out) in enumerate(zip(kernels, encoder.strides, (4, 8, 8), strict=True), 1):
            add(f"{encoder.prefix}.conv{layer}.weight", out, channels, kernel, kernel)
            add(f"{encoder.prefix}.conv{layer}.bias", out)
            rows, columns, channels = (rows - kernel) // stride + 1, (columns - kernel) // stride + 1, out
        add(f"{encoder.prefix}.linear.weight", 6, rows * columns * channels)
        add(f"{encoder.prefix}.linear.bias", 6)
        features += 6
    size = architecture.hidden_size
    for name, shape in {
        "rnn.weight_ih": (3 * size, features), "rnn.weight_hh": (3 * size, size), "rnn.bias_ih": (3 * size,), "rnn.bias_hh": (3 * size,),
        "actor.weight": (4, size), "actor.bias": (4,), "critic.weight": (1, size), "critic.bias": (1,),
        "value_mean": (1,), "value_deviation": (1,),
    }.items():  # fmt: skip
        add(name, *shape)
    return Network(architecture, weights)


def test_features_and_values_are_those_of_the_engine() -> None:
    """By hand: two distances, the cosine and the sine of the angle, the rest; values in the scale of returns."""
    pose = np.array([[1, 2, np.pi / 3, 7]], np.float32)
    np.testing.assert_allclose(Network._features(Sensor("pose", (4,)), pose), [[1, 2, 0.5, 3**0.5 / 2, 7]], rtol=1e-6)
    compass = np.array([[1, 2, np.pi / 6]], np.float32)
    np.testing.assert_allclose(Network._features(Sensor("gps_compass", (3,)), compass), [[1, 2, 3**0.5 / 2, 0.5]], rtol=1e-6)
    network = made_network("actor-critic v1: pointgoal 2, conv 4, gru 5, actions 4, normalized values")
    network.weights = {
        **network.weights,
        "critic.weight": np.zeros((1, 5), np.float32),
        "critic.bias": np.array([3], np.float32),
        "value_mean": np.array([-1], np.float32),
        "value_deviation": np.array([2], np.float32),
    }
    _, value, _ = network.step({"pointgoal": np.zeros((1, 2), np.float32)}, np.zeros((1, 5), np.float32))
    assert value is not None
    assert np.ravel(value).tolist() == [5]


def test_bytes_of_pictures_count_as_fractions() -> None:
    network = made_network("actor-critic v1: rgb 36x36x3, conv 4, gru 5, actions 4")
    white = np.full((1, 36, 36, 3), 255, np.uint8)
    weights = {name: np.zeros_like(array) for name, array in network.weights.items()}
    encoder = network.architecture.encoders[0]
    # One path of unit weights through the convolutions and the linear layer, so that the output is the value of a pixel.
    for layer in (1, 2, 3):
        weights[f"{encoder.prefix}.conv{layer}.weight"][0, 0, 0, 0] = 1
    weights[f"{encoder.prefix}.linear.weight"][0, 0] = 1
    network.weights = {**network.weights, **weights}
    assert network._encoded(encoder, {"rgb": white})[0, 0] == 1
    assert network._encoded(encoder, {"rgb": white // 5})[0, 0] == np.float32(51) / np.float32(255)


RICH = (
    "actor-critic v1: depth 40x44x1 -> 6, rgb 40x44x3 -> 6, left_depth 36x36x1 -> 6, spectrogram 65x69x2 -> 6, pose 4, gps_compass 3, "
    "pointgoal 2, collision 1, previous_action 1, topdown_map 48x48x2 -> 6, conv 4, gru 9, actions 4, normalized values"
)


@pytest.mark.parametrize("line", [RICH, RICH + " without memory", "actor-critic v1: pointgoal 2, conv 4, gru 5, actions 4"])
def test_every_kind_of_sensor_goes_to_onnx(line: str, tmp_path: Path) -> None:
    pytest.importorskip("onnx")
    runtime = pytest.importorskip("onnxruntime")
    from earshot._onnx import write_onnx

    network, count = made_network(line), 5
    write_onnx(network.architecture, network.weights, tmp_path / "rich.onnx")
    session = runtime.InferenceSession(str(tmp_path / "rich.onnx"), providers=["CPUExecutionProvider"])
    state = other = np.zeros((count, network.architecture.hidden_size), np.float32)
    for step in range(3):
        observations: dict[str, NDArray[Any]] = {}
        for index, sensor in enumerate(network.architecture.sensors):
            drawn = weyl((count, *sensor.shape), 0.17 * index + 0.31 * step)
            if sensor.kind == "previous_action":
                observations[sensor.name] = (np.floor(5 * drawn) - 1).astype(np.int32)
            elif sensor.is_bytes or sensor.kind == "collision":
                observations[sensor.name] = np.floor(256 * drawn if sensor.is_bytes else 2 * drawn).astype(np.uint8)
            else:
                observations[sensor.name] = (6 * drawn - 3).astype(np.float32)
        logits, values, state = network.step(observations, state)
        exported = session.run(["logits", "value", "next_state"], observations | {"state": other})
        other = exported[2]
        for one, expected in zip(exported, (logits, values, state), strict=True):
            np.testing.assert_allclose(one, expected, rtol=0, atol=1e-4)


@pytest.mark.parametrize("size", [241, 256, 257, 1023, 1024, 1025, 1088, 5000, 16384, 100003])
def test_the_hash_is_that_of_xxhash(size: int) -> None:
    data = np.random.default_rng(size).bytes(size)
    assert xxh3_64(data) == xxhash.xxh3_64_intdigest(data)


def packed(value: Any) -> bytes:
    """MessagePack, as far as a policy file needs it."""
    if isinstance(value, dict):
        items = b"".join(packed(key) + packed(item) for key, item in value.items())
        return struct.pack(">BI", 0xDF, len(value)) + items
    if isinstance(value, list):
        return struct.pack(">BI", 0xDD, len(value)) + b"".join(map(packed, value))
    if isinstance(value, str):
        return struct.pack(">BI", 0xDB, len(value.encode())) + value.encode()
    if isinstance(value, bytes | memoryview):
        return struct.pack(">BI", 0xC6, len(value)) + bytes(value)
    if isinstance(value, float):
        return struct.pack(">Bd", 0xCB, value)
    return struct.pack(">Bq", 0xD3, value)


def rewritten(body: bytes) -> bytes:
    """A file with this body whose header and hash are right."""
    return struct.pack("<8sIQ", b"EARSHOT\0", 2, len(body)) + body + struct.pack("<Q", xxhash.xxh3_64_intdigest(body))


def written(path: Path, weights: dict[str, NDArray[Any]]) -> Path:
    """The shipped policy with other weights."""
    fields = read_policy_file(QUICK)
    tensors = {name: {"dtype": str(array.dtype), "shape": list(array.shape), "data": array.tobytes()} for name, array in weights.items()}
    path.write_bytes(rewritten(packed({key: fields[key] for key in ("architecture", "config_yaml")} | {"weights": tensors})))
    return path


def test_files_of_half_precision_are_read(tmp_path: Path) -> None:
    weights = read_policy_file(QUICK)["weights"]
    agent = earshot.Policy.load(written(tmp_path / "half.policy", {name: array.astype(np.float16) for name, array in weights.items()}))
    for name, array in weights.items():
        assert agent.weights[name].dtype == np.float32
        np.testing.assert_allclose(agent.weights[name], array, rtol=2**-11, atol=2**-25)
    logits, _, _ = agent.step(drawn_observations(0), agent.initial_state(4))
    np.testing.assert_allclose(logits, LOGITS[0], atol=0.05)


@pytest.mark.parametrize(("name", "words"), [("actor.bias", "actor.bias"), ("visual.conv2.weight", "visual.conv2.weight")])
def test_weights_that_are_not_finite_or_do_not_fit_are_refused(name: str, words: str, tmp_path: Path) -> None:
    weights = dict(read_policy_file(QUICK)["weights"])
    array = weights[name].copy()
    array.flat[1] = np.nan
    with pytest.raises(earshot.InputError, match=words + ".*finite"):
        earshot.Policy.load(written(tmp_path / "nan.policy", weights | {name: array}))
    with pytest.raises(earshot.InputError, match="do not fit"):
        earshot.Policy.load(written(tmp_path / "short.policy", weights | {name: weights[name][:3]}))
    del weights[name]
    with pytest.raises(earshot.InputError, match="do not fit.*" + words):
        earshot.Policy.load(written(tmp_path / "none.policy", weights))


def test_damaged_files_are_refused_in_one_line(tmp_path: Path) -> None:
    whole, path = QUICK.read_bytes(), tmp_path / "damaged.policy"
    rng = np.random.default_rng(11)
    damaged = [b"", whole[:8], whole[:-1], whole + b"x", b"PK" + whole[2:], whole[:8] + b"\x07" + whole[9:]]
    for _ in range(20):
        at = int(rng.integers(HEADER, len(whole)))
        damaged.append(whole[:at] + bytes([whole[at] ^ (1 << int(rng.integers(8)))]) + whole[at + 1 :])
        damaged.append(whole[:at])
    for data in damaged:
        path.write_bytes(data)
        with pytest.raises(earshot.InputError) as refusal:
            earshot.Policy.load(path)
        assert str(path) in str(refusal.value)
        assert "\n" not in str(refusal.value)
    with pytest.raises(earshot.InputError, match="cannot be read"):
        earshot.Policy.load(tmp_path / "none.policy")


def test_damage_behind_a_right_hash_never_ends_otherwise_than_by_a_refusal(tmp_path: Path) -> None:
    body, path = QUICK.read_bytes()[HEADER:-8], tmp_path / "crafted.policy"
    rng = np.random.default_rng(12)
    refused = 0
    for _ in range(200):
        changed = bytearray(body)
        for _ in range(3):
            changed[int(rng.integers(min(len(body), 12000)))] = int(rng.integers(256))
        path.write_bytes(rewritten(bytes(changed[: int(rng.integers(300, len(changed)))] if rng.random() < 0.3 else changed)))
        with contextlib.suppress(earshot.InputError):
            earshot.Policy.load(path)
            continue
        refused += 1
    assert refused > 40


def test_a_module_is_refused_with_the_way_out() -> None:
    with pytest.raises(ValueError, match="TorchScript"):
        Architecture.of("module v1 0123456789abcdef: depth 64x64x1, state 128, actions 4")
    with pytest.raises(ValueError, match="does not know"):
        Architecture.of("actor-critic v9: depth 64x64x1, gru 128")


def without(name: str) -> dict[str, NDArray[Any]]:
    return {key: rows for key, rows in drawn_observations(0).items() if key != name}


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (without("depth"), "'depth'.*reads depth, interaural"),
        (drawn_observations(0) | {"depth": np.zeros((4, 64, 32, 1), np.float32)}, "'depth'.*4x64x32x1.*Nx64x64x1"),
        (drawn_observations(0) | {"interaural": np.full((4, 65, 26, 4), np.nan, np.float32)}, "'interaural'.*finite"),
        (drawn_observations(0) | {"collision": np.zeros((3, 1), np.uint8)}, "different numbers of rows"),
        (drawn_observations(0) | {"previous_action": np.full((4, 1), 4, np.int32)}, "'previous_action'.*outside"),
        (drawn_observations(0) | {"collision": np.array([["a"]] * 4)}, "'collision'.*numbers"),
        (drawn_observations(0) | {"collision": np.full((4, 1), 0.5)}, "'collision'.*float64; the policy reads integers or bools"),
        (drawn_observations(0) | {"collision": np.full((4, 1), 255, np.uint8)}, "'collision'.*outside 0 to 1"),
        (drawn_observations(0) | {"previous_action": np.full((4, 1), 1.7)}, "'previous_action'.*float64; the policy reads integers"),
        (drawn_observations(0) | {"previous_action": np.ones((4, 1), bool)}, "'previous_action'.*bool; the policy reads integers"),
        (drawn_observations(0) | {"depth": np.full((4, 64, 64, 1), 200, np.uint8)}, "'depth'.*uint8; the policy reads floats"),
        (drawn_observations(0) | {"depth": np.full((4, 64, 64, 1), 1e300)}, "'depth'.*finite"),
        (drawn_observations(0) | {"interaural": [[[[1.0] * 4], [[1.0] * 3]]]}, "'interaural' has rows of different lengths; give rows of"),
        ({name: rows[:0] for name, rows in drawn_observations(0).items()}, "'depth'.*no rows; give those of at least one env"),
    ],
)
def test_observations_that_do_not_fit_are_named(changed: dict[str, NDArray[Any]], words: str) -> None:
    with pytest.raises(earshot.InputError, match=words):
        policy().step(changed, policy().initial_state(4))
    with pytest.raises(earshot.InputError, match=words) as caught:
        policy().act(changed)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("seed", range(3))
def test_every_kind_of_sensor_takes_its_kind_of_numbers_alone(seed: int) -> None:
    """Pictures of bytes that are given as floats would be divided by 255 twice, floats that are given as bytes not at all."""
    network = made_network(RICH)
    agent = earshot.Policy({"architecture": RICH, "weights": network.weights, "config_yaml": ""}, "made")
    kinds = {"rgb": "u", "topdown_map": "u", "previous_action": "iu", "collision": "iub"}
    rng = np.random.default_rng(seed)
    right = {"u": np.uint8, "iu": np.int32, "iub": np.uint8, "f": np.float32}
    rows = {
        sensor.name: rng.integers(0, 2, (2, *sensor.shape)).astype(right[kinds.get(sensor.name, "f")])
        for sensor in network.architecture.sensors
    }
    expected = agent.step(rows, agent.initial_state(2))[0]
    for name, array in rows.items():
        for kind in (np.bool_, np.uint8, np.uint16, np.int8, np.int64, np.float16, np.float64, np.complex64, object):
            changed, state = rows | {name: array.astype(kind)}, agent.initial_state(2)
            if np.dtype(kind).kind in kinds.get(name, "f"):
                assert (agent.step(changed, state)[0] == expected).all(), (name, kind)
                continue
            with pytest.raises(earshot.InputError, match=f"^observation '{name}': has numbers of type {np.dtype(kind)}; the policy reads"):
                agent.step(changed, state)
    with pytest.raises(earshot.InputError, match=r"^observation 'rgb': has values that are outside 0 to 255$"):
        agent.step(rows | {"rgb": rows["rgb"].astype(np.uint16) + 300}, agent.initial_state(2))


def test_states_and_masks_that_do_not_fit_are_named() -> None:
    agent, rows = policy(), drawn_observations(0)
    expected = agent.step(rows, agent.initial_state(4))[0]
    assert (agent.step(rows, agent.initial_state(4).tolist())[0] == expected).all()
    broken = agent.initial_state(4)
    for value in (np.nan, np.inf, -np.inf):
        broken[2, 5] = value
        with pytest.raises(earshot.InputError, match=r"^Policy.step: state has values that are not finite"):
            agent.step(rows, broken)
    for state, words in (
        (np.zeros((4, 5), np.float32), "has the shape 4x5; start with initial_state"),
        (0.0, "has the shape of a single number"),
        ([[0.0] * 128, [0.0] * 127], "has rows of different lengths; give floats"),
        (np.full((4, 128), 1e300), "has values that are not finite"),
        (np.full((4, 128), "a"), "is of type <U1; give floats"),
        (None, "has the shape of a single number"),
    ):
        with pytest.raises(earshot.InputError, match=f"^Policy.step: state {words}"):
            agent.step(rows, state)  # type: ignore[arg-type]
    with pytest.raises(earshot.InputError, match=r"different numbers of rows, .*'state': 3"):
        agent.step(rows, agent.initial_state(3))
    for begins, words in (
        (np.ones(3, bool), "has the shape 3"),
        ([[True], [True, False]], "has rows of different lengths"),
        (["no"] * 4, "is of type <U2"),
    ):
        with pytest.raises(earshot.InputError, match=f"^Policy.act: begins {words}; give one bool for each of 4 envs"):
            agent.act(rows, begins)
    for count in (0, -1, 2**40):
        with pytest.raises(earshot.InputError, match=r"^Policy.initial_state: num_envs is .*; give an integer from 1 to"):
            agent.initial_state(count)
    with pytest.raises(TypeError, match=r"^observations are of type list; give a dict of arrays by name$"):
        agent.act([1])  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"^Policy.act: rng is 3; give a numpy.random.Generator$"):
        agent.act(rows, sample=True, rng=3)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", [["float32"], {"float32": 1}, 4, "float8"])
def test_a_type_of_weights_that_is_none_is_refused(kind: Any, tmp_path: Path) -> None:
    fields = read_policy_file(QUICK)
    tensor = {"dtype": kind, "shape": [1], "data": b"\0\0\0\0"}
    body = {key: fields[key] for key in ("architecture", "config_yaml")} | {"weights": {"actor.bias": tensor}}
    (tmp_path / "crafted.policy").write_bytes(rewritten(packed(body)))
    with pytest.raises(earshot.InputError, match=r"has weights 'actor.bias' that are no tensor; copy it again"):
        earshot.Policy.load(tmp_path / "crafted.policy")
