"""The pages that are made from the code and kept: every key of scene and study files.

`python docs/generate.py` (`make reference`) writes them to docs/reference; a test compares them with the code.
"""

import json
import re
import sys
from collections.abc import Iterable
from pathlib import Path

HERE = Path(__file__).parent / "reference"
sys.path.insert(0, str(HERE.parent / "_ext"))

SCENE_HEAD = """# Scene files: every key

A scene is a TOML file: bodies, joints, points, and how to solve. Quantities carry their unit in a string
(`"0.1 mm"`, `"5000 rpm"`, `"2.487e6 N/mm^1.5"`); any unit of the right dimension is accepted, the tables give the SI
one. A number without dimension is bare. A key that is not here is refused, with the nearest one that is.
[Scenes](../scenes.md) builds a scene step by step; `clearance examples` lists some, and `clearance new NAME`
writes one with comments.

Editors with a TOML language server (Taplo, Even Better TOML) complete keys and check values by a JSON schema, which is
part of the package. The first line of a file says where it is: `#:schema PATH`, relative to the file, or an address
that begins with `file://`. Neither needs a network. `clearance examples` and `clearance new` write this line.

*This page is generated from the reader's own declarations.*
"""
STUDY_HEAD = """# Study files: every key

A study asks something of a scene: metrics over numbers that vary (`sweep`), the largest clearances with which limits
hold (`design`), how a joint wears and how long it lasts (`wear`), numbers from measured motion (`calibrate`).
`clearance run STUDY` does what it says. [Sweeps](../sweeps.md), [Tolerance design](../design.md), [Wear](../wear.md)
and [Calibration](../calibration.md) say what the words mean.
`clearance examples slider_crank_design` writes one, with its scene and the line that lets editors complete its keys.

*This page is generated from the reader's own declarations.*
"""


def cell(text: str) -> str:
    """Text as it may stand in a cell of a table."""
    return " ".join(text.split()).replace("|", "\\|")


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A Markdown table."""
    lines = [list(head), *([cell(c) for c in row] for row in rows)]
    lines.insert(1, ["---"] * len(lines[0]))
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def code(text: str) -> str:
    """Text as code, nothing where there is none."""
    return f"`{text}`" if text else ""


def value(key) -> str:
    """What a key's value is, and in which unit."""
    return f"{key.kind}, {key.unit}" if key.unit else key.kind


def anchor(title: str) -> str:
    """The link to the heading of a table."""
    return "#" + re.sub(r"[^\w\- ]", "", title).lower().replace(" ", "-")


def keys_page(head: str, file: str) -> str:
    """Every table of one kind of file, each key a row; where a table has the keys of another one too, a link to it."""
    from key_reference import reference

    tables, parts = reference(), [head]
    home = {one.title: one.file for one in reversed(tables)}

    def links(titles: Iterable[str]) -> str:
        pages = {title: "" if home[title] == file else f"{home[title]}.md" for title in titles}
        return ", ".join(f"[{title}]({page}{anchor(title)})" for title, page in pages.items())

    for one in tables:
        if one.file != file:
            continue
        choice = f", with `{one.choice}`" if one.choice else ""
        where = "" if one.name == file else f"Table `[{one.name}]`{choice}. "
        parts.append(f"## {one.title}\n\n{where}{one.help}\n")
        if one.shared:
            parts.append(f"It has the keys of {links(one.shared)}{' too' if one.keys else ''}.\n")
        if one.kinds:
            rows = [
                (code(kind.word), kind.help, ", ".join([*map(code, kind.keys), *filter(None, [links(kind.shared)])]))
                for kind in one.kinds
            ]
            parts.append(table((code(one.head), "what it is", "its other keys"), rows))
        rows = [
            (code(key.name), key.help, value(key), "**required**" if key.required else key.default, code(key.example))
            for key in one.keys
        ]
        if rows:
            parts.append(table(("key", "meaning", "value, SI unit", "default", "example"), rows))
    return "\n".join(parts)


def pages() -> dict[str, str]:
    """Every generated file by its name."""
    from key_reference import schema

    return {
        **{f"{file}.schema.json": json.dumps(schema(file), indent=1) + "\n" for file in ("scene", "study")},
        "scene.md": keys_page(SCENE_HEAD, "scene"),
        "study.md": keys_page(STUDY_HEAD, "study"),
    }


def write() -> None:
    """Write every page that has changed."""
    from key_reference import reference

    HERE.mkdir(exist_ok=True)
    for file in ("scene", "study"):
        print(f"{file}: {sum(len(table.keys) for table in reference() if table.file == file)} keys")
    for name, text in pages().items():
        path = HERE / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write()
