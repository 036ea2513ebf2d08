"""`clearance examples` and `clearance new`: files to begin with, written into the current folder."""

import re
from pathlib import Path

from typer import Argument, Option

from clearance_jax.cli import common
from clearance_jax.errors import ClearanceError, unknown_name, wrong_value
from clearance_jax.examples import kinds, names, path, template

# The first line of a file, which tells editors where its schema is.
_SCHEMA = re.compile(r"#:schema \S*?(schemas/\w+\.schema\.json)\n")
_FILE = re.compile(r'"((?:\.\./)?\w+\.(?:toml|urdf|csv))"')


def examples(
    name: str | None = Argument(None, metavar="[NAME]", help="Write this one here.", autocompletion=names),
) -> None:
    """List the examples: scenes, robots, studies. With a name, write this one and all files that it names into the
    current folder.
    """
    if name is None:
        for each in names():
            common.say(f"{each:<28} {_about(path(each))}")
        common.note("`clearance examples NAME` writes one into the current folder.")
        return
    _write(needed(path(name)))


def new(
    name: str = Argument(..., metavar="NAME", help="Name of the files: NAME.toml and NAME_study.toml."),
    kind: str = Option("arm", help=f"What it begins with: {', '.join(kinds())}.", autocompletion=kinds),
) -> None:
    """Write a scene of a mechanism, with comments, and a study that asks for its largest clearances: to be changed."""
    if kind not in kinds():
        raise unknown_name(f"`--kind`: there is no kind `{kind}`.", kind, kinds(), "--kind")
    if not re.fullmatch(r"\w[\w-]*", name):
        raise wrong_value("`NAME`", "letters, digits, `_` and `-`", name, fix="The files get their endings by it.")
    _write({each.replace(kind, name): text.replace("NAME", name) for each, text in template(kind).items()})
    common.note(f"Next: clearance check {name}.toml")
    common.note(f"      clearance simulate {name}.toml -o {name}.nc --plot {name}.png")
    common.note(f"      clearance run {name}_study.toml --report {name}.html")


def _about(file: Path) -> str:
    """The first sentence or line of a file's comment."""
    text = re.sub(r"^<\?.*?>\s*|^#:schema.*\n", "", file.read_text(encoding="utf-8"))
    comment = re.match(r"<!--\s*(.*?)-->|((?:#.*\n)+)", text, re.DOTALL)
    told = "" if comment is None else " ".join((comment[1] or comment[2]).replace("#", " ").split())
    return re.split(r"(?<=[.?]) (?=[A-Z])| clearance ", told)[0]


def needed(file: Path) -> dict[str, str]:
    """The text of a file, and of all that it names, by the name of each; they will lie in one folder."""
    text = file.read_text(encoding="utf-8")
    files = {file.name: _FILE.sub(lambda m: f'"{Path(m[1]).name}"', text)}
    for each in _FILE.findall(text):
        files |= needed(file.parent / each)
    return files


def _write(files: dict[str, str]) -> None:
    """Write files into the current folder, with the address of their schema. None replaces another one."""
    home = path("arm").parent
    texts = {
        Path(name): _SCHEMA.sub(lambda m: f"#:schema {(home / m[1]).as_uri()}\n", text)
        for name, text in files.items()
    }
    for file, text in texts.items():
        common.check_writable(file)
        if file.exists() and file.read_text(encoding="utf-8", errors="replace") != text:
            raise ClearanceError(f"`{file}` is there already, and differs. Rename it, or go to another folder.")
    for file, text in texts.items():
        file.write_text(text, encoding="utf-8")
        common.say(str(file))
