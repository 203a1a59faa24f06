#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Sound reflected by a rigid rectangular plate, by boundary elements in three dimensions (numpy and scipy).

Prints the table of tests/unit/sim/acoustics/response/panel_reflection_test.cpp: the energy of the octaves of 125, 250 and 500 Hz, in dB
over that of an endless plane.  With the argument `power`, the tables of tests/unit/sim/acoustics/model/wall_power_plates_test.cpp: power of
a point source beside a plate over that in the free field, in the octave of 125 Hz, from its own scattered field.  The jump of the pressure across the plate is constant on each element.  The hypersingular integral is one
round the edge of the element and k^2 times that of the free field (Maue 1949, Z. Phys. 126, 601-618).  Elements are those of Chebyshev's
nodes.  The forward amplitude and the scattered energy agree within 0.5 % (optical theorem).  About a minute; `power` five.

With `directions`: the table of tests/unit/apps/sound/panel_reflection_cli_test.cpp, ten drawn listeners and the scattered energy in dB in
the octaves of 63 Hz to 2 kHz.  About two minutes.
"""

import math
import sys

import numpy as np
import scipy.linalg

SPEED = 343.0


class Plate:
    """A plate of width x depth about the origin of the plane z = 0, at one wavenumber."""

    def __init__(self, width, depth, wavenumber, longest_m=math.inf):
        self.k = k = wavenumber
        self.longest_m = longest_m  # of an element
        edge_x, at_x = self.nodes(width)
        edge_y, at_y = self.nodes(depth)
        self.x, self.y = (a.ravel() for a in np.meshgrid(at_x, at_y, indexing="ij"))
        x0, y0 = (a.ravel() for a in np.meshgrid(edge_x[:-1], edge_y[:-1], indexing="ij"))
        x1, y1 = (a.ravel() for a in np.meshgrid(edge_x[1:], edge_y[1:], indexing="ij"))
        mid_x, mid_y, half_x, half_y = (x0 + x1) / 2, (y0 + y1) / 2, (x1 - x0) / 2, (y1 - y0) / 2
        self.area = 4 * half_x * half_y
        count = len(self.x)

        def slope(dx, dy, along_x, along_y):
            r = np.sqrt(dx * dx + dy * dy)
            return np.exp(-1j * k * r) / (4 * np.pi * r) * (-1j * k - 1 / r) * (dx * along_x + dy * along_y) / r

        edges = np.zeros((count, count), complex)
        points, weights = np.polynomial.legendre.leggauss(6)
        for piece in range(3):
            for p, w in zip(points, weights):
                t, weight = ((p + 1) / 2 + piece) / 3 * 2 - 1, w / 3
                for side in (-1, 1):
                    dx, dy = (mid_x + side * half_x)[None] - self.x[:, None], (mid_y + t * half_y)[None] - self.y[:, None]
                    edges += weight * half_y[None] * slope(dx, dy, side, 0)
                    dx, dy = (mid_x + t * half_x)[None] - self.x[:, None], (mid_y + side * half_y)[None] - self.y[:, None]
                    edges += weight * half_x[None] * slope(dx, dy, 0, side)
        inside = np.zeros((count, count), complex)
        own = np.arange(count)
        points, weights = np.polynomial.legendre.leggauss(3)
        for p, w in zip(points, weights):
            for q, v in zip(points, weights):
                dx, dy = (mid_x + p * half_x)[None] - self.x[:, None], (mid_y + q * half_y)[None] - self.y[:, None]
                r = np.sqrt(dx * dx + dy * dy)
                r[own, own] = 1
                inside += w * v * (half_x * half_y)[None] * np.exp(-1j * k * r) / (4 * np.pi * r)
        still = 0
        for a in (self.x - x0, x1 - self.x):
            for b in (self.y - y0, y1 - self.y):
                still = still + a * np.arcsinh(b / a) + b * np.arcsinh(a / b)
        inside[own, own] = still / (4 * np.pi) - 1j * k / (4 * np.pi) * self.area
        self.factors = scipy.linalg.lu_factor(-(edges + k * k * inside))

    def nodes(self, side):
        count = max(8, math.ceil(side * self.k / (2 * np.pi) * 9), math.ceil(side / self.longest_m * np.pi / 2))
        t = np.linspace(0, 1, count + 1)
        return side * (0.5 - 0.5 * np.cos(np.pi * t)) - side / 2, side * (0.5 - 0.5 * np.cos(np.pi * (t[:-1] + t[1:]) / 2)) - side / 2

    def reflected(self, source, listener):
        """Scattered pressure in Green units."""
        dx, dy, dz = self.x - source[0], self.y - source[1], -source[2]
        r = np.sqrt(dx * dx + dy * dy + dz * dz)
        jump = scipy.linalg.lu_solve(self.factors, -np.exp(-1j * self.k * r) / (4 * np.pi * r) * (-1j * self.k - 1 / r) * dz / r)
        dx, dy, dz = listener[0] - self.x, listener[1] - self.y, listener[2]
        r = np.sqrt(dx * dx + dy * dy + dz * dz)
        return (np.exp(-1j * self.k * r) / (4 * np.pi * r) * (1j * self.k + 1 / r) * dz / r * jump * self.area).sum()


def print_powers():
    """Width, depth, place from the middle, height, ratio of the powers.  Elements are shorter than the source is high."""
    draw, centre, steps = np.random.default_rng(38), 10**2.1, 5
    for _ in range(12):
        width, depth = np.exp(draw.uniform(np.log(0.3), np.log(3.6), 2))
        places = [(draw.uniform(-0.5, 0.5) * width, draw.uniform(-0.5, 0.5) * depth, np.exp(draw.uniform(np.log(0.15), np.log(1.2)))) for _ in range(4)]
        powers = np.ones(4)
        for i in range(steps):
            k = 2 * np.pi * centre * (10**-0.15 + (i + 0.5) / steps * (10**0.15 - 10**-0.15)) / SPEED
            plate = Plate(width, depth, k, 0.14)
            for place, at in enumerate(places):
                powers[place] += 4 * np.pi / k * plate.reflected(np.array(at), np.array(at)).imag / steps
        for at, power in zip(places, powers):
            print(f"{{{width:.3f}, {depth:.3f}, {at[0]:.3f}, {at[1]:.3f}, {at[2]:.3f}, {power:.4f}}},", flush=True)


def print_powers_above_floor():
    """The same of plates that stand on a rigid floor, by images: width, height, place along from the middle, above the floor, before it."""
    draw, centre, steps = np.random.default_rng(39), 10**2.1, 5
    for _ in range(10):
        width, height = np.exp(draw.uniform(np.log(0.5), np.log(2.5))), np.exp(draw.uniform(np.log(0.5), np.log(1.6)))
        places = [
            np.array([draw.uniform(-0.5, 0.5) * width, draw.uniform(0.05, 1) * height, np.exp(draw.uniform(np.log(0.15), np.log(1.2)))])
            for _ in range(3)
        ]
        powers = np.ones(3)
        for i in range(steps):
            k = 2 * np.pi * centre * (10**-0.15 + (i + 0.5) / steps * (10**0.15 - 10**-0.15)) / SPEED
            plate = Plate(width, 2 * height, k, 0.14)
            for place, at in enumerate(places):
                mirrored = at * np.array([1, -1, 1])
                own = plate.reflected(at, at).imag + plate.reflected(mirrored, at).imag
                powers[place] += (4 * np.pi / k * own + np.sinc(2 * k * at[1] / np.pi)) / steps
        for at, power in zip(places, powers):
            print(f"{{{width:.3f}, {height:.3f}, {at[0]:.3f}, {at[1]:.3f}, {at[2]:.3f}, {power:.4f}}},", flush=True)


def directions():
    rng = np.random.default_rng(38)
    low, high, steps = math.sqrt(0.5), math.sqrt(2), 5
    source = np.array([-0.9, 0.4, 2.6])
    listeners = []
    for _ in range(10):
        r, polar, around = rng.uniform(2.5, 4), math.acos(rng.uniform(math.cos(math.radians(75)), 1)), rng.uniform(0, 2 * math.pi)
        at = np.array([math.sin(polar) * math.cos(around), math.sin(polar) * math.sin(around), math.cos(polar)])
        listeners.append(np.round(r * at, 2))
    energy = np.zeros((10, 6))
    for octave in range(6):
        for i in range(steps):
            frequency = 10 ** (1.8 + 0.3 * octave) * (low + (i + 0.5) / steps * (high - low))
            plate = Plate(0.6, 0.45, 2 * np.pi * frequency / SPEED)
            for place, listener in enumerate(listeners):
                energy[place, octave] += abs(plate.reflected(source, listener)) ** 2 / steps
    for listener, row in zip(listeners, energy):
        print(*listener, ", ".join(f"{10 * math.log10(e):.2f}" for e in row))


def main():
    if sys.argv[1:] == ["power"]:
        print_powers()
        return print_powers_above_floor()
    low, high, steps = math.sqrt(0.5), math.sqrt(2), 5
    for width in (0.5, 1.0, 2.0):
        for depth in (0.5, 1.0, 2.0):
            places = []
            for degrees in (0, 40):
                for off_middle in (0, 0.15):
                    a, off = math.radians(degrees), off_middle * width
                    places.append(
                        (
                            np.array([-3 * math.sin(a) + off, 0.1, 3 * math.cos(a)]),
                            np.array([4 * math.sin(a) + off, 0.0, 4 * math.cos(a)]),
                        )
                    )
            energy = np.zeros((len(places), 3))
            for octave in range(3):
                for i in range(steps):
                    frequency = 10 ** (2.1 + 0.3 * octave) * (low + (i + 0.5) / steps * (high - low))
                    plate = Plate(width, depth, 2 * np.pi * frequency / SPEED)
                    for place, (source, listener) in enumerate(places):
                        endless_m = np.linalg.norm(listener - source * np.array([1, 1, -1]))
                        energy[place, octave] += abs(4 * np.pi * endless_m * plate.reflected(source, listener)) ** 2 / steps
            for row in energy:
                print(width, depth, ", ".join(f"{10 * math.log10(e):.2f}" for e in row))


if __name__ == "__main__":
    if sys.argv[1:] == ["directions"]:
        directions()
    else:
        main()
