"""The option `--json`: what a command finds, as one JSON object on stdout; all that it says goes to stderr."""

import functools
import inspect
import itertools
import json
import math
from collections.abc import Callable
from typing import Any

from rich.console import Console
from typer import Exit, Option

from clearance_jax.errors import ClearanceError

# Outside a terminal no line is broken: a program, or a person by `less -S`, reads it whole.
UNBROKEN = 10_000
JSON = Option(False, "--json", help="Print one JSON object, with units and result codes; all else goes to stderr.")

console, errors = Console(), Console(stderr=True)
for each in (console, errors):
    if not each.is_terminal:
        each.width = UNBROKEN

# What the running command has found so far.
answer: dict[str, Any] = {}


def answered(command: Callable[..., None]) -> Callable[..., None]:
    """A command with the option `--json`, which prints `answer` at its end, whether it succeeds or not."""

    @functools.wraps(command)
    def run(as_json: bool, **given: Any) -> None:
        answer.clear()
        if not as_json:
            return command(**given)
        exit_code, console.stderr = 1, True
        try:
            command(**given)
            exit_code = 0
        except Exit as ended:
            exit_code = ended.exit_code
            raise
        except ClearanceError as error:
            exit_code = 2
            answer["error"] = {"message": str(error), **{k: getattr(error, k) for k in ("name", "value", "allowed")}}
            raise
        except KeyboardInterrupt:
            exit_code = 130
            raise
        finally:
            console.stderr = False
            text = json.dumps(plain({"command": command.__name__, "exit_code": exit_code, **answer}))
            console.print(text, highlight=False, markup=False, soft_wrap=True)
        return None

    option = inspect.Parameter("as_json", inspect.Parameter.KEYWORD_ONLY, default=JSON, annotation=bool)
    known = inspect.signature(command)
    changed: Any = run
    changed.__signature__ = known.replace(parameters=[*known.parameters.values(), option])
    changed.__annotations__ = {**command.__annotations__, "as_json": bool}
    return run


def plain(value: Any) -> Any:
    """A value as JSON holds it: `None` for a number that is not finite, what is no number as its text."""
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, dict):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, str | int) else str(value)


def quantity(value: Any, unit: str) -> dict[str, Any]:
    """A number and its unit."""
    return {"value": float(value), "unit": unit}


def largest(dataset: Any) -> dict[str, dict[str, Any]]:
    """The largest absolute value of every quantity over the samples of a motion, by quantity and label."""
    sizes: dict[str, dict[str, Any]] = {}
    for name, values in dataset.data_vars.items():
        if values.dims[:1] != ("time",) or values.dtype.kind != "f":
            continue
        peak, unit = abs(values).max("time"), str(values.attrs.get("units", ""))
        labels = [[str(label) for label in dataset[dim].values] for dim in peak.dims]
        # "see coordinate_unit": each label has a unit of its own.
        units = dataset[unit.removeprefix("see ")].values if unit.startswith("see ") else itertools.repeat(unit)
        keys = [".".join(parts) for parts in itertools.product(*labels)]
        pairs = zip(keys, peak.values.ravel(), units, strict=False)
        sizes[str(name)] = {key: quantity(value, str(of)) for key, value, of in pairs}
    return sizes
