# SPDX-License-Identifier: Apache-2.0
"""Writes unknown_operator.pt: a TorchScript file that uses an operator which no libtorch has.  Needs torch."""

import zipfile
from pathlib import Path

import torch


class Net(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.weight = torch.nn.Parameter(torch.ones(4, 2))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return torch.matmul(x, self.weight.t())


target = Path(__file__).with_suffix(".pt")
torch.jit.script(Net()).save(str(target))
with zipfile.ZipFile(target) as source:
    files = {entry.filename: source.read(entry) for entry in source.infolist() if not entry.filename.endswith(".debug_pkl")}
with zipfile.ZipFile(target, "w") as changed:
    for name, data in files.items():
        changed.writestr(zipfile.ZipInfo(name), data.replace(b"torch.matmul", b"torch.of_a_later_version"))
