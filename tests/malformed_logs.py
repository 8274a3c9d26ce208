"""Logs as tables of text of a leg with a torso, as they are or with a cell or the times changed."""

import numpy as np

from ident import Body, Mechanism, Tree, read_log

N = 40
T = np.arange(N) / 100
JOINTS = ("ankle", "hip")
Q = np.stack([0.3 * np.sin(5 * T), 0.6 * np.cos(7 * T)], axis=1)
DQ = np.stack([1.5 * np.cos(5 * T), -4.2 * np.sin(7 * T)], axis=1)
WRENCH = np.arange(6 * N).reshape(N, 6) + 0.5
PLAIN = {"time": T, "q_ankle": Q[:, 0], "q_hip": Q[:, 1]}
GROUND_COLUMNS = {f"ground_{name}": WRENCH[:, k] for k, name in enumerate(("fx", "fy", "fz", "mx", "my", "mz"))}


def text(columns, delimiter=",", decimal=".", end="\n"):
    rows = (
        delimiter.join(repr(float(x)).replace(".", decimal) for x in row) for row in zip(*columns.values(), strict=True)
    )
    return end.join([delimiter.join(columns), *rows, ""])


def replaced(row, column, cell):
    """The plain log with one cell changed; the header is row 1."""
    lines = [line.split(",") for line in text(PLAIN).splitlines()]
    lines[row - 1][list(PLAIN).index(column)] = cell
    return "\n".join(map(",".join, lines))


def retimed(time):
    return text({**PLAIN, "time": time})


def leg(weight=None):
    bodies = [Body(name, k - 1, np.eye(4), np.eye(6)[4], JOINTS[k]) for k, name in enumerate(("leg", "torso"))]
    prior = None if weight is None else np.tile(np.repeat([weight / 2 / 9.81, 0], [1, 9]), 2)
    return Mechanism(Tree(tuple(bodies)), np.array([0, 0, -9.81]), prior)


LEG = leg()


def read(folder, content, mapping=None, mechanism=LEG, **options):
    """Recording of a log, text or columns, read with a mapping."""
    content = text(content) if isinstance(content, dict) else content
    (folder / "log.csv").write_bytes(content.encode() if isinstance(content, str) else content)
    if mapping is not None:
        (folder / "columns.toml").write_text(mapping, encoding="utf-8")
    return read_log(folder / "log.csv", mechanism, None if mapping is None else folder / "columns.toml", **options)
