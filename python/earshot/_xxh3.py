# SPDX-License-Identifier: Apache-2.0
"""XXH3 with 64 bits (Collet, xxHash 0.8, doc/xxhash_spec.md) of inputs over 240 bytes, in numpy: the identity of Earshot's files."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_SECRET = bytes.fromhex(
    "b8fe6c3923a44bbe7c01812cf721ad1cded46de9839097db7240a4a4b7b3671fcb79e64eccc0e578825ad07dccff7221b8084674f743248ee03590e6813a264c"
    "3c2852bb91c300cb88d0658b1b532ea371644897a20df94e3819ef46a9deacd8a8fa763fe39c343ff9dcbbc7c70b4f1d8a51e04bcdb45931c89f7ec9d9787364"
    "eac5ac8334d3ebc3c581a0fffa1363eb170ddd51b7f0da49d316552629d4689e2b16be587d47a1fc8ff8b8d17ad031ce45cb3a8f95160428afd7fbcabb4b407e"
)
_PRIME32 = 0x9E3779B1
_PRIMES64 = (0x9E3779B185EBCA87, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0x85EBCA77C2B2AE63, 0x27D4EB2F165667C5)
_PRIMES32_OTHER = (0x85EBCA77, 0xC2B2AE3D)
_MASK = (1 << 64) - 1
_STRIPE, _LANES = 64, 8
_STRIPES_PER_BLOCK = (len(_SECRET) - _STRIPE) // 8
_BLOCK = _STRIPE * _STRIPES_PER_BLOCK

Lanes = NDArray[np.uint64]


def _lanes(data: bytes) -> Lanes:
    return np.frombuffer(data, "<u8")


def _mixed(stripes: Lanes, secrets: Lanes) -> Lanes:
    """What each stripe [n, 8] adds to the accumulators, summed over the stripes."""
    keyed = stripes ^ secrets
    products = (keyed & np.uint64(0xFFFFFFFF)) * (keyed >> np.uint64(32))
    swapped = stripes.reshape(-1, _LANES // 2, 2)[:, :, ::-1].reshape(-1, _LANES)
    total: Lanes = (products + swapped).sum(0, dtype=np.uint64)
    return total


def _avalanche(hash_: int) -> int:
    hash_ ^= hash_ >> 37
    hash_ = hash_ * 0x165667919E3779F9 & _MASK
    return hash_ ^ hash_ >> 32


def _folded_product(one: int, other: int) -> int:
    product = one * other
    return (product & _MASK) ^ (product >> 64)


def xxh3_64(data: bytes | memoryview) -> int:
    """The hash with seed 0.  data: over 240 bytes."""
    length = len(data)
    if length <= 240:
        raise ValueError("is too short for a policy file")
    secrets = np.stack([_lanes(_SECRET[8 * i : 8 * i + _STRIPE]) for i in range(_STRIPES_PER_BLOCK)])
    scramble = _lanes(_SECRET[-_STRIPE:])
    accumulators = np.array(
        [_PRIMES32_OTHER[1], _PRIMES64[0], _PRIMES64[1], _PRIMES64[2], _PRIMES64[3], _PRIMES32_OTHER[0], _PRIMES64[4], _PRIME32], np.uint64
    )
    with np.errstate(over="ignore"):
        blocks = (length - 1) // _BLOCK
        for block in range(blocks):
            stripes = np.frombuffer(data, "<u8", _BLOCK // 8, block * _BLOCK).reshape(-1, _LANES)
            accumulators += _mixed(stripes, secrets)
            accumulators = (accumulators ^ (accumulators >> np.uint64(47)) ^ scramble) * np.uint64(_PRIME32)
        rest = (length - 1 - blocks * _BLOCK) // _STRIPE
        if rest:
            stripes = np.frombuffer(data, "<u8", rest * _LANES, blocks * _BLOCK).reshape(-1, _LANES)
            accumulators += _mixed(stripes, secrets[:rest])
        last = np.frombuffer(data, "<u8", _LANES, length - _STRIPE).reshape(1, _LANES)
        accumulators += _mixed(last, _lanes(_SECRET[-_STRIPE - 7 : -7]).reshape(1, _LANES))
    hash_ = length * _PRIMES64[0] & _MASK
    keys = [int(key) for key in _lanes(_SECRET[11 : 11 + _STRIPE])]
    values = [int(value) for value in accumulators]
    for i in range(0, _LANES, 2):
        hash_ += _folded_product(values[i] ^ keys[i], values[i + 1] ^ keys[i + 1])
    return _avalanche(hash_ & _MASK)
