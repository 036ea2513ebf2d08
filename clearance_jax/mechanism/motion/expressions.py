"""Reader of ADAMS drive expressions: sums of `step(time, t0, h0, t1, h1)` and `step5(...)`, `time * rate`, constants.

Numbers may carry the suffix `d` for degrees (`90d`, `90 d`). No part of the text is evaluated as a program.
"""

import math
import re
from typing import NamedTuple

from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.motion.motion_laws import AbstractDrive, ConstantSpeed, DriveSum, Step5Sum, StepSum

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<word>[A-Za-z_]\w*)|(?P<sign>[-+*(),]))"
)


# Largest number of characters of an expression, some 500 steps. A motion of more steps should be a table of values.
LONGEST = 20_000


class Token(NamedTuple):
    """A number, word or sign, and where it stands."""

    kind: str
    text: str
    at: int


def read_expression(text: str) -> AbstractDrive:
    """The drive that an ADAMS function expression describes.

    **Raises:** `ClearanceError` with the place and what was expected there, and for a text beyond `LONGEST` characters.
    """
    if len(text) > LONGEST:
        raise ClearanceError(
            f"A drive expression must have at most {LONGEST} characters, but this one has {len(text)}. Give such a "
            'motion as a table of times and values: `drive = { type = "spline", file = "motion.csv", ... }`.'
        )
    return _Reader(text).drive()


class _Reader:
    def __init__(self, text: str):
        self.text = text
        self.tokens: list[Token] = []
        self.index = 0
        at = 0
        while text[at:].strip():
            match = _TOKEN.match(text, at)
            if match is None:
                at += len(text[at:]) - len(text[at:].lstrip())
                raise self.error(at, "a number, `step`, `step5`, `time` or a sign")
            kind = str(match.lastgroup)
            self.tokens.append(Token(kind, match[kind], match.start(kind)))
            at = match.end()
        self.tokens.append(Token("end", "", len(text)))

    def error(self, at: int, expected: str) -> ClearanceError:
        return ClearanceError(
            f"This drive expression cannot be read: expected {expected} here:\n  {self.text}\n  {' ' * at}^"
        )

    def drive(self) -> AbstractDrive:
        steps: dict[str, list[tuple[float, float, float]]] = {"step": [], "step5": []}
        totals = {"constant": 0.0, "rate": 0.0}
        sign = self.signs()
        while True:
            self.term(sign, steps, totals)
            if self.peek().kind == "end":
                break
            if self.peek().text not in ("+", "-"):
                raise self.error(self.peek().at, "`+`, `-` or the end")
            sign = self.signs()
        drives: list[AbstractDrive] = []
        for word, cls in (("step", StepSum), ("step5", Step5Sum)):
            if steps[word]:
                begin, end, rise = map(list, zip(*steps[word], strict=True))
                drives.append(cls(begin, end, rise, 0.0 if drives else totals["constant"]))
        if totals["rate"] or not drives:
            drives.append(ConstantSpeed(totals["rate"], 0.0 if drives else totals["constant"]))
        return drives[0] if len(drives) == 1 else DriveSum(tuple(drives))

    def term(self, sign: float, steps, totals) -> None:
        factor = sign
        if self.peek().kind == "number":
            factor *= self.number()
            if not self.passes("*"):
                totals["constant"] += factor
                return
        token = self.peek()
        if self.passes("time"):
            if self.passes("*"):
                factor *= self.signs() * self.number()
            totals["rate"] += factor
        elif self.passes("step") or self.passes("step5"):
            begin, low, end, high = self.arguments()
            totals["constant"] += factor * low
            steps[token.text.lower()].append((begin, end, factor * (high - low)))
        else:
            raise self.error(token.at, "a number, `step(...)`, `step5(...)` or `time`")

    def arguments(self) -> tuple[float, float, float, float]:
        self.take("(")
        self.take("time")
        values = []
        for _ in range(4):
            self.take(",")
            values.append(self.signs() * self.number())
        self.take(")")
        if not values[2] > values[0]:
            raise ClearanceError(
                f"A step must end after it begins, but one runs from {values[0]:g} s to {values[2]:g} s:\n  {self.text}"
            )
        return values[0], values[1], values[2], values[3]

    def signs(self) -> float:
        sign = 1.0
        while self.peek().text in ("+", "-"):
            sign = -sign if self.peek().text == "-" else sign
            self.index += 1
        return sign

    def number(self) -> float:
        token = self.peek()
        if token.kind != "number":
            raise self.error(token.at, "a number")
        value = float(token.text)
        if not math.isfinite(value):
            raise self.error(token.at, "a number that is finite")
        self.index += 1
        return value * (math.pi / 180 if self.passes("d") else 1.0)

    def passes(self, text: str) -> bool:
        """Whether the next token is a word or a sign; if so, go past it."""
        here = self.peek().text.lower() == text
        self.index += here
        return here

    def take(self, text: str) -> None:
        if not self.passes(text):
            raise self.error(self.peek().at, f"`{text}`")

    def peek(self) -> Token:
        return self.tokens[self.index]
