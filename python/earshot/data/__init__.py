# SPDX-License-Identifier: Apache-2.0
"""Corpora of ``earshot dataset rir`` for training: shards, tables and speech augmented on the fly.

``python -m earshot.data webdataset FOLDER --out SHARDS --license ID`` and ``parquet`` copy a corpus into files that other loaders read
(extra ``data`` for Parquet).  Speech through its responses, in any number of worker processes::

    augment = earshot.data.Augment(earshot.data.CorpusResponses("runs/rir"), snr_db=(5, 25))
    signal = augment(speech, epoch=0, index=17).signal    # float32 [channels, samples]

>>> import numpy as np
>>> from earshot.data import Augment, ArrayResponses
>>> augment = Augment(ArrayResponses([np.ones((1, 1), np.float32)], rate_hz=16000))
>>> augment(np.ones(4, np.float32), index=0).signal.shape
(1, 4)
"""

from __future__ import annotations

from ._augment import Augment, Augmented
from ._convolve import Convolved, convolve
from ._corpus import Corpus
from ._export import write_parquet, write_webdataset
from ._figure import rt60_figure
from ._responses import ArrayResponses, CorpusResponses, Responses, SimulatedResponses
from ._wav_reader import read_wav

__all__ = [
    "ArrayResponses",
    "Augment",
    "Augmented",
    "Convolved",
    "Corpus",
    "CorpusResponses",
    "Responses",
    "SimulatedResponses",
    "convolve",
    "read_wav",
    "rt60_figure",
    "write_parquet",
    "write_webdataset",
]
