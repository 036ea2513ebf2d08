"""What a file says first that asks something of a scene (a study, a sweep, a life): which scene, changed how, until
when.
"""

from pathlib import Path
from typing import Any, NamedTuple

from clearance_jax.errors import ClearanceError
from clearance_jax.io.files import read_toml
from clearance_jax.io.metric import Span
from clearance_jax.io.scene import Scene, read_scene
from clearance_jax.io.settings import values_by_name
from clearance_jax.io.table import Keys, Table
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import replace


class Asked(NamedTuple):
    """The file's `path`, `text` and `name`, its top `table`, the scene, and its `mechanism` with the numbers set."""

    path: Path
    text: str
    name: str
    table: Table
    scene: Scene
    mechanism: Mechanism

    def span(self, key: str = "t1") -> Span:
        """From the scene's t0 to the time that a key says, or else to the scene's t1."""
        t0, t1 = self.scene.solve.get("t0", 0.0), self.table.get(key)
        t1 = self.scene.solve.get("t1") if t1 is None else t1
        if t1 is None:
            raise ClearanceError(f"{self.table.where} lacks the key `{key}`, and the scene has no `t1`. Add it.")
        if t1 <= t0:
            raise ClearanceError(
                f"{self.table.key(key)} must be greater than the scene's t0 = {t0:g} s, but it is {t1:g} s."
            )
        return Span(t0, t1)

    def usual(self, *names: str) -> dict[str, Any]:
        """What the scene says of how to solve it, of these options."""
        return {name: value for name, value in self.scene.solve.items() if name in names}


def asked(path: Path, what: str, keys: Keys) -> Asked:
    """The beginning of such a file; `what` it is, for messages."""
    text, values = read_toml(path, f"{what} file")
    top = Table(values, f"{path}:", keys)
    scene = read_scene(path.parent / top.get("scene"))
    mechanism = replace(scene.mechanism, values_by_name(top.named("set"), scene.mechanism))
    return Asked(path, text, top.get("name") or path.stem, top, scene, mechanism)
