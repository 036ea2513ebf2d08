"""What a process remembers of programs and answers that are kept: all of it in one object."""

import dataclasses
from pathlib import Path


@dataclasses.dataclass
class Runtime:
    """The memory of a process.

    - `folder`: where programs and answers are kept; `None`: nowhere.
    - `answers`: numbers by the texts of their questions; `new_answers`: those that are not written yet.
    - `modules`: by module of this library its contents, their text, and the modules to which it leads.
    - `altered`: names of modules of this library that were altered in this process after they were read. JAX may have
      traced functions of theirs, and remembers what it traced: from then on nothing is kept.
    """

    folder: Path | None = None
    answers: dict[str, float] = dataclasses.field(default_factory=dict)
    new_answers: dict[str, float] = dataclasses.field(default_factory=dict)
    modules: dict[str, tuple[list, str, set[str]]] = dataclasses.field(default_factory=dict)
    altered: set[str] = dataclasses.field(default_factory=set)


RUNTIME = Runtime()
