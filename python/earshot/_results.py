# SPDX-License-Identifier: Apache-2.0
"""Values that scenes and responses give: arrays and numbers without the engine behind them, which pickle as they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
ARRIVAL_KINDS = ("direct", "reflection", "diffraction", "transmission")


@dataclass(frozen=True)
class EffectDecision:
    """One decision of the effect plan: whether an effect is simulated in a scene, and the reason."""

    effect: str
    decision: str
    on: bool
    change: float  #: largest change of a response if the effect is off; NaN if not estimated
    unit: str
    kind: str  #: basis of the decision: exact, bounded, approximated, user_set
    saved_ms: float
    why: str


@dataclass(frozen=True)
class Metrics:
    """Room-acoustic parameters after ISO 3382-1, one value per band; NaN for an undefined value (no decay to fit, no direct sound)."""

    bands_hz: Floats
    edt_s: Floats  #: first 10 dB of the decay curve, direct sound included
    edt_after_direct_s: Floats  #: first 10 dB below the step of the direct sound
    t20_s: Floats
    t30_s: Floats
    rt60_s: Floats
    c50_db: Floats
    c80_db: Floats
    d50: Floats
    ts_s: Floats
    g_db: Floats
    drr_band_db: Floats
    iacc: Floats  #: this and the next two: binaural RIRs only
    iacc_early: Floats
    iacc_late: Floats
    j_lf: Floats  #: this and the next five: on request only
    j_lfc: Floats
    lg_db: Floats
    st_early_db: Floats
    st_late_db: Floats
    mti: Floats
    sti: float  #: on request only
    drr_db: float
    direct_delay_s: float
    direct_amplitude: float
    missing: dict[str, str]  #: parameters that were asked for, or G, that do not exist, with reasons

    def __repr__(self) -> str:
        middle = int(np.abs(self.bands_hz - 1000).argmin())
        return (
            f"earshot.Metrics(at {self.bands_hz[middle]:g} Hz: T20 {self.t20_s[middle]:.3g} s, EDT {self.edt_s[middle]:.3g} s, "
            f"C50 {self.c50_db[middle]:.3g} dB; DRR {self.drr_db:.3g} dB; {len(self.bands_hz)} bands)"
        )

    def _repr_html_(self) -> str:
        from ._html import metrics_table

        return metrics_table(self)


@dataclass(frozen=True)
class Arrivals:
    """Deterministic paths from source to listener, sorted by distance: n arrivals, b bands."""

    kind: NDArray[np.uint8]  #: [n], index into ARRIVAL_KINDS
    order: NDArray[np.int32]  #: [n], number of reflections, edges or walls
    identity: NDArray[np.uint64]  #: [n], identifies the planes or edges; a path keeps its number when the listener moves
    delay_s: Floats  #: [n], after emission
    distance_m: NDArray[np.float32]  #: [n]
    direction: NDArray[np.float32]  #: [n, 3], unit vector from the listener to the incoming sound
    departure: NDArray[np.float32]  #: [n, 3], unit vector from the source along the outgoing sound
    amplitude: NDArray[np.float32]  #: [n, b], pressure in Green units
    phase_rad: NDArray[np.float32]  #: [n, b], in addition to the phase of the delay

    def __len__(self) -> int:
        return len(self.kind)

    @property
    def kind_names(self) -> list[str]:
        return [ARRIVAL_KINDS[kind] for kind in self.kind]

    def __repr__(self) -> str:
        names = self.kind_names
        counts = ", ".join(f"{names.count(kind)} {kind}" for kind in ARRIVAL_KINDS if kind in names)
        return f"earshot.Arrivals({len(self)} paths: {counts or 'none'})"


@dataclass(frozen=True)
class AccuracyChoice:
    """Settings for the responses of a source, tested at a few listeners."""

    method: str  #: listener rays, source field or both ends
    settings: dict[str, str]  #: for ``Scene(settings=...)``
    predicted: dict[str, float]  #: errors at other listeners: t20_pct, drr_db, edc_db; NaN if undefined
    per_source_ms: float
    per_response_ms: float


@dataclass(frozen=True)
class AccuracyPlan:
    """The cheapest settings that meet a target accuracy, and all tested settings."""

    choice: AccuracyChoice
    tried: list[AccuracyChoice]  #: in the order of trial
    reference_error: dict[str, float]  #: standard error of the reference paths
    calibration_s: float

    def _repr_html_(self) -> str:
        from ._html import accuracy_table

        return accuracy_table(self)
