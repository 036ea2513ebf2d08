"""Names of a robot's file as a mechanism can have them: links and joints have names apart there, and dots in them."""

from collections.abc import Iterable

from clearance_jax.mechanism.body import GROUND


class UniqueNames:
    """Gives every part a name of its own: the one in the file where it can.

    `.` and `=` separate names and values, and become `_`. Where two parts have one name, the later one has what it is
    added to its name.
    """

    def __init__(self):
        self.taken = {GROUND, "gravity", "drive", "target"}

    def of(self, given: Iterable[str], what: str) -> dict[str, str]:
        """The names of parts of one sort, by those in the file; `what` they are, in a word."""
        return {name: self._one(name, what) for name in given}

    def _one(self, name: str, what: str) -> str:
        wanted = name.replace(".", "_").replace("=", "_")
        unique, count = wanted, 1
        while unique in self.taken:
            unique = f"{wanted}_{what}" if count == 1 else f"{wanted}_{what}_{count}"
            count += 1
        self.taken.add(unique)
        return unique
