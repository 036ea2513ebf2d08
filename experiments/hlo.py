"""Programs in XLA's own language (HLO): read, and their arithmetic counted.

An operation counts as often as its result has entries, and wherever it stands: what stands in two kernels counts twice.
What only moves numbers counts nothing, nor does what serves `share` to keep a value from being computed twice. Loops
and branches count as if each were run once.
"""

import math
import re
from typing import NamedTuple

from clearance_jax._compile.barriers import BARRIER

# Operations that compute nothing, or count by what they call.
MOVES = {
    *("parameter", "constant", "iota", "tuple", "get-tuple-element", "bitcast", "bitcast-convert", "convert", "copy"),
    *("broadcast", "reshape", "transpose", "reverse", "pad", "slice", "concatenate", "gather", "scatter"),
    *("dynamic-slice", "dynamic-update-slice", "after-all", "opt-barrier"),
}
CALLS = {"fusion", "call", "while", "conditional"}
_HEAD = re.compile(r"^(?:ENTRY )?%?([\w.\-]+) .*\{$|^(?:ENTRY )?%?([\w.\-]+) \{$")
_ENTRY = re.compile(r"^ENTRY %?([\w.\-]+) ", re.MULTILINE)
_LINE = re.compile(r"^\s+(?:ROOT )?%?([\w.\-]+) = (\(.*?\)|\S+) ([a-z][\w\-]*)\((.*)$")
_CALLED = re.compile(r"(?:calls|body|to_apply|true_computation|false_computation)=%?([\w.\-]+)")
_BRANCHES = re.compile(r"branch_computations=\{([^}]*)\}")
_NAME = re.compile(r'op_name="([^"]*)"')
_BARRIER = re.compile(rf"(?:^|[/(]){BARRIER}(?:[/)]|$)")


class Operation(NamedTuple):
    """One line of a program: what it does, entries of its result, its operands, what it calls, and its name in JAX."""

    kind: str
    size: int
    operands: tuple[str, ...]
    called: tuple[str, ...]
    name: str


Program = dict[str, dict[str, Operation]]


def read(text: str) -> Program:
    """The computations of a program, each its operations, by their names."""
    program, inside = {}, None
    for line in text.splitlines():
        if line and not line[0].isspace():
            head = None if line.startswith("HloModule") else _HEAD.match(line)
            inside = None if head is None else program.setdefault(head[1] or head[2], {})
        elif inside is not None and (found := _LINE.match(line)):
            name, shape, kind, rest = found.groups()
            inside[name] = _operation(kind, shape, rest)
    return program


def _operation(kind: str, shape: str, rest: str) -> Operation:
    sizes = re.match(r"\(?\w+\[([\d,]*)\]", shape)
    size = math.prod(int(n) for n in sizes[1].split(",") if n) if sizes else 0
    operands = re.findall(r"%?([\w.\-]+)(?:,|\)|$)", re.sub(r"/\*.*?\*/", "", rest.split("), ")[0]))
    branches = (name.strip(" %") for group in _BRANCHES.findall(rest) for name in group.split(","))
    mark = _NAME.search(rest)
    return Operation(kind, size, tuple(operands), (*_CALLED.findall(rest), *branches), mark[1] if mark else "")


def busiest_loop(text: str) -> int:
    """The arithmetic of one turn of the loop that has most of it."""
    program = read(text)
    counted = counts(program)
    loops = [x for inside in program.values() for x in inside.values() if x.kind == "while"]
    return max((sum(counted[name] for name in loop.called) for loop in loops), default=0)


def arithmetic(text: str) -> int:
    """The arithmetic of a whole program."""
    entry = _ENTRY.search(text)
    assert entry is not None
    return counts(read(text))[entry[1]]


def counts(program: Program) -> dict[str, int]:
    """The arithmetic of every computation of a program, with what it calls."""
    counted: dict[str, int] = {}

    def of(name: str) -> int:
        if name not in counted:
            counted[name] = sum(one(program[name], operation) for operation in program[name].values())
        return counted[name]

    def one(inside: dict[str, Operation], operation: Operation) -> int:
        # A fusion has the name of its last operation, and holds others.
        if operation.kind in MOVES or (operation.kind != "fusion" and _BARRIER.search(operation.name)):
            return 0
        if operation.kind in CALLS:
            return sum(of(name) for name in operation.called)
        # A reduction computes once for every entry that it reads.
        return inside[operation.operands[0]].size if operation.kind == "reduce" else operation.size

    return {name: of(name) for name in program}
