"""Trajectories that the fuzzer tries: good ones, with a few things changed that loggers or people get wrong."""

import random

# Cells that are no numbers, or none that a machine has been to.
CELLS = (
    "", " ", "nan", "-inf", "inf", "1e999", "1e308", "-1e308", "5e-324", "1e-300", "1_000", "0x10", "1,5", "1;5", "abc",
    "'", '"', '"1"', '"1', "9" * 400, "9" * 120_000, "--1", "1 2", "1mm", "\u0661", "\u202e", "#", "=1+1", "\0", "[1]",
    "é" * 300, "None", "-0.0", "__import__('os').system('touch canary')",
)  # fmt: skip
HEADS = (
    "", "time", "Time [s]", " TIME [ms] ", "t", "slide", "slide [mm]", "slide [deg]", "hinge [deg]", "hinge [rad]", "1",
    "hinge [mm]", "hinge []", "hinge [[deg]]", "hinge [deg", "hinge deg]", "hinge [9**9 deg]", "hinge [turn]", "bob",
    "hinge [furlong]", "hinge [N*m]", "hing", "hinge.velocity", "hinge[deg]", '"hinge, [deg]"', "hinge [1 deg]", "[m]",
    "slide [degC]", "time [min]", "slide [" + "m" * 300 + "]",
)  # fmt: skip
ENDS = ("\n", "\r\n", "\r", "\n\n", "\x0b", "\u2028", "\n# a comment\n")


def trajectory(rng: random.Random) -> bytes:
    """The bytes of a trajectory file, spoiled or not."""
    head = ["time [s]", "slide [mm]", "hinge [deg]"][: rng.choice((2, 3, 3))]
    rows = [[f"{0.1 * i:.3g}", *(f"{rng.uniform(-9, 9):.4g}" for _ in head[1:])] for i in range(rng.choice((4, 6, 30)))]
    for _ in range(rng.choice((0, 0, 1, 1, 2, 4))):
        rng.choice(CHANGES)(head, rows, rng)
    mark, end = rng.choice((*(",",) * 9, ", ", ";", "\t", "|", ",,")), rng.choice(("\n", "\n", *ENDS))
    text = end.join(mark.join(row) for row in [head, *rows]) + rng.choice(("", end, end * 3))
    return _coded(text, rng)


def _coded(text: str, rng: random.Random) -> bytes:
    """The text in one of the ways of writing it, now and then with bytes that are wrong."""
    raw = bytearray(text.encode(rng.choice((*("utf-8",) * 20, "utf-8-sig", "utf-16", "latin-1")), "replace"))
    if rng.random() < 0.1 and raw:
        for _ in range(rng.randrange(1, 5)):
            raw[rng.randrange(len(raw))] = rng.randrange(256)
    if rng.random() < 0.05:
        del raw[rng.randrange(len(raw) + 1) :]
    return bytes(raw)


def _cell(head, rows, rng) -> None:
    row = rng.choice(rows or [head])
    at = rng.randrange(len(row) or 1)
    row[at : at + 1] = [rng.choice(CELLS)]


def _name(head, rows, rng) -> None:
    at = rng.randrange(len(head) or 1)
    head[at : at + 1] = [rng.choice(HEADS)]


def _swapped(head, rows, rng) -> None:
    for row in (head, *rows):
        row.reverse()


def _shuffled(head, rows, rng) -> None:
    rng.shuffle(rows)


def _ragged(head, rows, rng) -> None:
    row = rng.choice([head, *rows])
    row[1:] = row[1:] * rng.choice((0, 2, 200))


def _shorter(head, rows, rng) -> None:
    del rows[rng.randrange(len(rows) + 1) :]


def _headless(head, rows, rng) -> None:
    head[:] = rows[0] if rows else []


def _doubled(head, rows, rng) -> None:
    for row in (head, *rows):
        row.append(row[-1] if row else "")


CHANGES = (_cell, _cell, _cell, _name, _name, _swapped, _shuffled, _ragged, _shorter, _headless, _doubled)
