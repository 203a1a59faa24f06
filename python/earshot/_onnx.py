# SPDX-License-Identifier: Apache-2.0
"""The built-in network as an ONNX model, by the package onnx."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._network import NUM_ACTIONS, Architecture, Encoder, Sensor

_OPSET = 17  #: of onnx 1.12 and later
_IR_VERSION = 8  #: that runtimes of that time read


class _Graph:
    """Nodes and constants; each call returns the name of its result."""

    def __init__(self, helper: Any, numpy_helper: Any) -> None:
        self._helper = helper
        self._numpy_helper = numpy_helper
        self.nodes: list[Any] = []
        self.constants: dict[str, Any] = {}

    def add(self, kind: str, *inputs: str, name: str = "", **attributes: Any) -> str:
        result = name or f"{kind.lower()}_{len(self.nodes)}"
        self.nodes.append(self._helper.make_node(kind, list(inputs), [result], **attributes))
        return result

    def constant(self, name: str, array: NDArray[Any]) -> str:
        if name not in self.constants:
            self.constants[name] = self._numpy_helper.from_array(np.ascontiguousarray(array), name)
        return name

    def numbers(self, *values: int) -> str:
        return self.constant("numbers_" + "_".join(map(str, values)), np.array(values, np.int64))

    def part(self, rows: str, first: int, end: int) -> str:
        return self.add("Slice", rows, self.numbers(first), self.numbers(end), self.numbers(1))


class _Export:
    def __init__(self, architecture: Architecture, weights: Mapping[str, NDArray[Any]], graph: _Graph, proto: Any) -> None:
        self.architecture = architecture
        self.weights = weights
        self.graph = graph
        self.proto = proto

    def weight(self, name: str) -> str:
        return self.graph.constant(name, self.weights[name])

    def linear(self, name: str, rows: str, result: str = "") -> str:
        return self.graph.add("Gemm", rows, self.weight(name + ".weight"), self.weight(name + ".bias"), name=result, transB=1)

    def features(self, sensor: Sensor) -> str:
        graph, name = self.graph, sensor.name
        if sensor.kind == "previous_action":
            index = graph.add("Add", graph.add("Cast", name, to=self.proto.INT64), graph.numbers(1))
            table = graph.constant("actions_apart", np.eye(NUM_ACTIONS + 1, dtype=np.float32))
            return graph.add("Reshape", graph.add("Gather", table, index), graph.numbers(-1, NUM_ACTIONS + 1))
        values = graph.add("Cast", name, to=self.proto.FLOAT)
        if sensor.kind not in ("gps_compass", "pose"):
            return values
        angle = graph.part(values, 2, 3)
        parts = [graph.part(values, 0, 2), graph.add("Cos", angle), graph.add("Sin", angle)]
        if sensor.shape[0] > 3:
            parts.append(graph.part(values, 3, sensor.shape[0]))
        return graph.add("Concat", *parts, axis=1)

    def encoded(self, encoder: Encoder) -> str:
        graph = self.graph
        channels = []
        for sensor in encoder.sensors:
            rows = graph.add("Cast", sensor.name, to=self.proto.FLOAT)
            if sensor.is_bytes:
                rows = graph.add("Div", rows, graph.constant("largest_byte", np.array(255, np.float32)))
            channels.append(rows)
        picture = channels[0] if len(channels) == 1 else graph.add("Concat", *channels, axis=3)
        picture = graph.add("Transpose", picture, perm=[0, 3, 1, 2])
        for layer, stride in enumerate(encoder.strides, 1):
            name = f"{encoder.prefix}.conv{layer}"
            picture = graph.add("Conv", picture, self.weight(name + ".weight"), self.weight(name + ".bias"), strides=[stride, stride])
            if layer < len(encoder.strides):
                picture = graph.add("Relu", picture)
        return graph.add("Relu", self.linear(encoder.prefix + ".linear", graph.add("Flatten", picture)))

    def gru(self, inputs: str) -> str:
        graph, size = self.graph, self.architecture.hidden_size
        state = "state"
        if not self.architecture.remembers:
            state = graph.add("Mul", state, graph.constant("forgets", np.zeros(1, np.float32)))
        product = {}
        for source, rows in (("ih", inputs), ("hh", state)):
            weight, bias = self.weight(f"rnn.weight_{source}"), self.weight(f"rnn.bias_{source}")
            product[source] = graph.add("Gemm", rows, weight, bias, transB=1)
        gates = [{source: graph.part(rows, i * size, (i + 1) * size) for source, rows in product.items()} for i in range(3)]
        reset = graph.add("Sigmoid", graph.add("Add", gates[0]["ih"], gates[0]["hh"]))
        update = graph.add("Sigmoid", graph.add("Add", gates[1]["ih"], gates[1]["hh"]))
        candidate = graph.add("Tanh", graph.add("Add", gates[2]["ih"], graph.add("Mul", reset, gates[2]["hh"])))
        kept = graph.add("Mul", update, graph.add("Sub", state, candidate))
        return graph.add("Add", candidate, kept, name="next_state")

    def value(self, state: str) -> None:
        graph = self.graph
        value = graph.add(
            "Reshape", self.linear("critic", state), graph.numbers(-1), name="" if self.architecture.normalizes_values else "value"
        )
        if self.architecture.normalizes_values:
            scaled = graph.add("Mul", value, self.weight("value_deviation"))
            graph.add("Add", scaled, self.weight("value_mean"), name="value")


def _input_type(sensor: Sensor, proto: Any) -> int:
    if sensor.kind == "previous_action":
        return int(proto.INT32)
    return int(proto.UINT8) if sensor.is_bytes or sensor.kind == "collision" else int(proto.FLOAT)


def write_onnx(architecture: Architecture, weights: Mapping[str, NDArray[Any]], path: Path) -> None:
    try:
        import onnx
        from onnx import TensorProto, helper, numpy_helper
    except ImportError as error:
        raise ImportError("to_onnx needs the package onnx: pip install 'earshot-rl[onnx]'") from error
    graph = _Graph(helper, numpy_helper)
    export = _Export(architecture, weights, graph, TensorProto)
    vectors = [sensor for sensor in architecture.sensors if not sensor.is_picture and not sensor.is_sound]
    features = [export.features(sensor) for sensor in vectors] + [export.encoded(encoder) for encoder in architecture.encoders]
    state = export.gru(features[0] if len(features) == 1 else graph.add("Concat", *features, axis=1))
    export.linear("actor", state, "logits")
    outputs: dict[str, list[str | int]] = {"logits": ["N", NUM_ACTIONS], "next_state": ["N", architecture.hidden_size]}
    if not architecture.guided_critic:
        export.value(state)
        outputs["value"] = ["N"]
    inputs = [
        helper.make_tensor_value_info(sensor.name, _input_type(sensor, TensorProto), ["N", *sensor.shape])
        for sensor in architecture.sensors
    ]
    inputs.append(helper.make_tensor_value_info("state", TensorProto.FLOAT, ["N", architecture.hidden_size]))
    results = [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in outputs.items()]
    model = helper.make_model(
        helper.make_graph(graph.nodes, "earshot", inputs, results, list(graph.constants.values())),
        opset_imports=[helper.make_opsetid("", _OPSET)],
        ir_version=_IR_VERSION,
        producer_name="earshot",
    )
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, str(path))
