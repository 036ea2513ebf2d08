"""Names of a mechanism's parts from a URDF file, where links and joints may share names and contain dots."""

from collections.abc import Iterable

from clearance_jax.mechanism.body import GROUND


class UniqueNames:
    """Gives every part a unique name: that in the file if possible.

    `.` and `=` become `_`. If two parts have the same name, the kind of the later one is appended to its name.
    """

    def __init__(self):
        self.taken = {GROUND, "gravity", "drive", "target"}

    def of(self, given: Iterable[str], what: str) -> dict[str, str]:
        """Unique names by the names in the file; `what`: the kind of these parts in one word."""
        return {name: self._unique(name, what) for name in given}

    def _unique(self, name: str, what: str) -> str:
        wanted = name.replace(".", "_").replace("=", "_")
        unique, count = wanted, 1
        while unique in self.taken:
            unique = f"{wanted}_{what}" if count == 1 else f"{wanted}_{what}_{count}"
            count += 1
        self.taken.add(unique)
        return unique
