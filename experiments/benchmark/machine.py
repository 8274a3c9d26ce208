"""The benchmark's machine: its description, its measured limits, and how far our times are from them."""

import importlib.metadata
import os
import platform
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.benchmark.identification import ACCUMULATION, AGAIN, REGRESSOR, arms
from experiments.benchmark.mechanisms import ARM, PENDULUM, TREE, Subject, mechanisms
from experiments.benchmark.timing import Effort, alternating, timed
from ident.estimation.accumulator import accumulate
from ident.model.regressor import regressor_program

TRIES = 7
"""Repetitions of which the best measures a limit."""


def description() -> dict[str, Any]:
    """Processor, memory, system and versions."""
    packages = ("numpy", "scipy", "mujoco", "pin")
    blas = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    versions = {"python": platform.python_version()}
    for name in packages:
        with suppress(importlib.metadata.PackageNotFoundError):
            versions[name] = importlib.metadata.version(name)
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "memory_gb": _memory_gb(),
        "system": _system(),
        "versions": versions,
        "blas": f"{blas['name']} {blas['version']}",
        "blas_threads": os.environ.get("OPENBLAS_NUM_THREADS"),
    }


def _processor() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _memory_gb() -> float | None:
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9, 1)
    except (AttributeError, ValueError, OSError):
        return None


def _system() -> str:
    with suppress(OSError):
        return f"{platform.freedesktop_os_release()['PRETTY_NAME']}, {platform.machine()}"
    return platform.platform(terse=True)


@dataclass(frozen=True)
class Limits:
    """Measured limits of a machine, the best of several repetitions in one thread.

    Attributes:
        write: Bandwidth of filling a large array, GB/s.
        first_write: The same for an array whose memory was never touched, GB/s.
        product: Rate of a matrix product in double precision, GFlop/s.
    """

    write: float
    first_write: float
    product: float


def limits(effort: Effort) -> Limits:
    """Measured limits of this machine."""
    old, gigabytes = np.zeros(effort.array), 8 * effort.array / 1e9
    A = np.random.default_rng(0).normal(size=(effort.matrix, effort.matrix))

    def best(way: Any) -> float:
        return min(timed(way) for _ in range(TRIES))

    return Limits(
        write=gigabytes / best(lambda: old.fill(1)),
        first_write=gigabytes / best(lambda: np.full(effort.array, 1.0)),
        product=2 * effort.matrix**3 / best(lambda: A @ A) / 1e9,
    )


@dataclass(frozen=True)
class Distance:
    """Time of a task beside the times that its arithmetic and its results would take at the limits.

    Attributes:
        task: Name of the task.
        mechanism: Name of the mechanism.
        bodies: Its number of bodies b.
        samples: Number of samples N.
        seconds: Median time.
        operations: Floating-point operations per sample.
        megabytes: Size of the result, MB.
        arithmetic: Share of the time that the operations would take in a matrix product.
        writing: Share of the time that filling old memory with the result would take.
        first_writing: Share of the time that filling new memory with it would take.
    """

    task: str
    mechanism: str
    bodies: int
    samples: int
    seconds: float
    operations: int
    megabytes: float
    arithmetic: float
    writing: float
    first_writing: float


def distances(effort: Effort, reached: Limits) -> list[Distance]:
    """Distances from the limits at the largest number of samples, and those of arms."""
    rows, number = [], effort.sizes[-1]
    for mechanism in mechanisms():
        if mechanism.name in (PENDULUM, ARM, TREE):
            samples = mechanism.samples(number)
            regressor, sums = partial(mechanism.regressor, samples), partial(accumulate, mechanism.equations, samples)
            rows.append(_distance(REGRESSOR, mechanism, number, regressor, effort, reached))
            rows.append(_distance(ACCUMULATION, mechanism, number, sums, effort, reached))
    for arm, samples in arms(effort):
        again = partial(arm.regressor, samples, out=arm.regressor(samples))
        rows.append(_distance(AGAIN, arm, len(samples), again, effort, reached))
    return rows


def _distance(
    task: str, mechanism: Subject, number: int, way: Callable[[], object], effort: Effort, reached: Limits
) -> Distance:
    columns, gigabytes, products = tuple(range(10 * len(mechanism.tree.inertial))), 0.0, 0
    if task == ACCUMULATION:
        columns = mechanism.parameters.kept
        # For each channel: half of the Gram matrix of its columns, and their products with the measurements.
        _, first = mechanism.equations.order(mechanism.samples(1))
        products = sum((width := mechanism.parameters.rank + 1 - start) * (width + 3) for start in first)
    else:
        gigabytes = 8 * 6 * len(columns) * number / 1e9
    program = regressor_program(mechanism, columns, moving=mechanism.moving, torques=False)
    operations = len(program.code) + products
    seconds = float(np.median(alternating([way], effort.seconds / 2, effort.least)))
    return Distance(
        task,
        mechanism.name,
        len(mechanism.tree.bodies),
        number,
        seconds,
        operations,
        1e3 * gigabytes,
        operations * number / 1e9 / reached.product / seconds,
        gigabytes / reached.write / seconds,
        gigabytes / reached.first_write / seconds,
    )
