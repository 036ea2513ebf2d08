"""Formulas as they are written in the docs, LaTeX or plain, and their values.

A product needs no sign, and |x| is a size. A name is a symbol with its subscript and prime (`mu_s`, `d'`, `F'`). `e` is
a symbol of its own: the exponential is `exp(x)`.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np


class NoFormulaError(ValueError):
    """A text that is no formula, or one with a symbol that nobody defined."""


def step(x, x0, h0, x1, h1):
    s = np.clip((x - x0) / (x1 - x0), 0, 1)
    return h0 + (h1 - h0) * s * s * (3 - 2 * s)


def step5(s):
    s = np.clip(s, 0, 1)
    return s**3 * (10 - 15 * s + 6 * s**2)


def step7(s):
    s = np.clip(s, 0, 1)
    return s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)


FUNCTIONS: dict[str, Callable] = {
    "max": np.maximum, "min": np.minimum, "sqrt": np.sqrt, "ln": np.log, "exp": np.exp, "tanh": np.tanh, "sin": np.sin,
    "cos": np.cos, "arccos": np.arccos, "atan2": np.arctan2, "STEP": step, "STEP5": step5, "STEP7": step7,
    "cases": lambda here, beyond, there: np.where(beyond <= 0, here, there),
}  # fmt: skip


def plain(text: str) -> str:
    """LaTeX without its commands."""
    text = re.sub(r"\\mathrm\{(\w+)\}", r"\1", text)
    text = re.sub(r"\\(left|right|mathbf|quad)(?![a-z])|\\[,;]", " ", text)
    text = re.sub(r"\\dot ?([a-z](?:_\w)?)", r"\1'", text)
    text = text.replace("E^*", "E_star").replace("E*", "E_star")
    text = re.sub(r"\\begin\{cases\}(.*?)\\end\{cases\}", _cases, text, flags=re.DOTALL)
    while r"\frac" in text:
        start = text.index(r"\frac")
        above, rest = _braces(text[start + 5 :])
        below, rest = _braces(rest)
        text = f"{text[:start]} (({above})/({below})) {rest}"
    text = re.sub(r"_\{(\w+)\}", r"_\1", text)
    text = text.replace("{", "(").replace("}", ")").replace("\\", " ")
    return re.sub(r"\b([ag]) ?\([ve]\)", r"\1", text)


def _cases(found: re.Match) -> str:
    """Two rows, of which the second holds where the first does not."""
    (here, condition), (there, otherwise) = (row.split("&") for row in found[1].split(r"\\"))
    low, high = condition.split(r"\le")
    assert otherwise.split() == f"{low}>{high}".replace(">", " > ").split(), found[0]
    return f"cases({here}, ({low}) - ({high}), {there})"


def _braces(text: str) -> tuple[str, str]:
    """What stands in the braces at the beginning, and what follows them."""
    text, depth = text.lstrip(), 0
    for i, letter in enumerate(text):
        depth += {"{": 1, "}": -1}.get(letter, 0)
        if not depth:
            return text[1:i], text[i + 1 :]
    raise NoFormulaError(text)


TOKEN = re.compile(r"\s*(\d+\.?\d*|\.\d+|[A-Za-z]+\d?(?:_\w+)?'?|[-+*/^(),|])")


class Formula:
    """The longest formula at the beginning of a text, of known symbols; `end`: where it ends.

    **Raises:** `NoFormulaError` where there is none.
    """

    def __init__(self, text: str, known: Any):
        self.text, self.known, self.end, self.inside = text, known, 0, 0
        self.value: Callable[[Callable], Any] = self._sum()

    def _next(self) -> str:
        found = TOKEN.match(self.text, self.end)
        return found[1] if found else ""

    def _take(self, *wanted: str) -> str:
        found = TOKEN.match(self.text, self.end)
        if not found or (wanted and found[1] not in wanted):
            raise NoFormulaError(self.text[: self.end] + " <here> " + self.text[self.end :])
        self.end = found.end()
        return found[1]

    def _attempt(self, part: Callable[[], Any]) -> Any:
        here = self.end, self.inside
        try:
            return part()
        except NoFormulaError:
            self.end, self.inside = here
            return None

    def _sum(self):
        total = self._product()
        while self._next() in ("+", "-"):

            def more():
                sign = 1 if self._take() == "+" else -1
                return sign, self._product()

            found = self._attempt(more)
            if found is None:
                break
            total = (lambda a, s, b: lambda get: a(get) + s * b(get))(total, *found)
        return total

    def _product(self):
        total = self._signed()
        while (after := self._next()) and after not in ("+", "-", ")", ",", "^") and not (after == "|" and self.inside):

            def more():
                over = self._next() in ("/", "*") and self._take()
                return over, self._signed()

            found = self._attempt(more)
            if found is None:
                break
            over, factor = found
            if over == "/":
                total = (lambda a, b: lambda get: a(get) / b(get))(total, factor)
            else:
                total = (lambda a, b: lambda get: a(get) * b(get))(total, factor)
        return total

    def _signed(self):
        if self._next() == "-":
            self._take()
            inner = self._signed()
            return lambda get: -inner(get)
        base = self._primary()
        if self._next() != "^":
            return base
        self._take()
        exponent = self._signed()
        return lambda get: base(get) ** exponent(get)

    def _primary(self):
        token = self._take()
        if token == "(":
            before, self.inside = self.inside, 0
            inner = self._sum()
            self._take(")")
            self.inside = before
            return inner
        if token == "|":
            self.inside += 1
            inner = self._sum()
            self._take("|")
            self.inside -= 1
            return lambda get: np.abs(inner(get))
        if token in FUNCTIONS:
            function, arguments = FUNCTIONS[token], self._arguments()
            return lambda get: function(*(one(get) for one in arguments))
        if token[0].isdigit() or token[0] == ".":
            return lambda get, number=float(token): number
        if token not in self.known:
            raise NoFormulaError(f"{token} in {self.text}")
        return lambda get: get(token)

    def _arguments(self):
        if self._next() != "(":
            return [self._signed()]
        self._take()
        before, self.inside = self.inside, 0
        arguments = [self._sum()]
        while self._next() == ",":
            self._take()
            arguments.append(self._sum())
        self._take(")")
        self.inside = before
        return arguments


class Equations:
    """The equations of a text. `symbols` have values; a left side that is a symbol without one defines it, every other
    equation is a condition.
    """

    def __init__(self, equations: list[tuple[str, str]], symbols: Mapping[str, Any], whole: bool):
        self.symbols = {"pi": np.pi, **symbols}
        named = {left for left, _ in equations if re.fullmatch(r"[A-Za-z]+\d?(_\w+)?'?", left)}
        known = {*self.symbols, *named}
        self.definitions: dict[str, Formula] = {}
        self.conditions: list[tuple[Formula, Formula]] = []
        self.used: set[str] = set()
        for left, right in equations:
            formula = Formula(right, known)
            if whole and right[formula.end :].strip():
                raise NoFormulaError(f"{left} = {right}: {right[formula.end :]}")
            if left in named and left not in self.symbols and left not in self.definitions:
                self.definitions[left] = formula
            else:
                self.conditions.append((Formula(left, known), formula))

    def __call__(self, symbol: str) -> Any:
        """The value of a symbol."""
        if symbol in self.symbols:
            return self.symbols[symbol]
        self.used.add(symbol)
        return self.definitions[symbol].value(self)

    def check(self, rtol: float) -> int:
        """Every condition holds; how many there are."""
        for left, right in self.conditions:
            np.testing.assert_allclose(left.value(self), right.value(self), rtol=rtol)
        return len(self.conditions)


def of_page(text: str) -> Iterator[tuple[str, str]]:
    """The equations between dollars; of a chain each link. Series are left out."""
    for span in re.findall(r"\$\$?([^$]+)\$\$?", text):
        if "=" in span and r"\dots" not in span:
            left, *rights = plain(span).split("=")
            yield from ((left.strip(), right.strip()) for right in rights)


def of_docstring(text: str) -> Iterator[tuple[str, str]]:
    """Of a docstring what stands before and after a sign of equality; where it ends shows as it is read."""
    text = plain(text)
    for found in re.finditer(r"(?<![\w(])([A-Za-z]+\d?(?:_\w+)?'?) = ", text):
        yield found[1], text[found.end() :]
