"""What README and docs say is so: examples run, files load, links lead somewhere, every key and law has its place."""

import ast
import importlib
import importlib.util
import json
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import catalogue
import jax
import jax.numpy as jnp
import pytest
import typer
from key_reference import reference
from places import ROOT
from sphinx.search.en import SearchEnglish

import clearance_jax as cj
from clearance_jax.cli.examples import needed
from clearance_jax.cli.main import UsageError, app
from clearance_jax.io.scene.scene import load_scene
from clearance_jax.io.study.study import load_study
from clearance_jax.laws import FRICTION_LAWS, NORMAL_LAWS, Geometry
from experiments import pages as benchmark_pages
from experiments import titles

DOCS = ROOT / "docs"
GENERATED = DOCS / "reference"
sys.path.append(str(DOCS / "_ext"))
names: Any = importlib.import_module("names")
runner: Any = importlib.import_module("runner")
outputs: Any = importlib.import_module("outputs")
mathml: Any = importlib.import_module("mathml")
stale: Any = importlib.import_module("stale")
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
PAGES += sorted(p for p in DOCS.rglob("*.md") if not {"notebooks", "names"} & {*p.parts})
RUN = [ROOT / "README.md", *outputs.pages()]
EXAMPLES = ROOT / "clearance_jax" / "examples"
ARM = EXAMPLES / "arm.toml"


def blocks(path: Path, language: str) -> list[str]:
    """The fenced blocks of a page in one language; of a shell, lines that go on are one."""
    found = re.findall(rf"^```{language}\n(.*?)^```$", path.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return [text.replace("\\\n", "") for text in found] if language == "sh" else found


def title(path: Path) -> str:
    return str(path.relative_to(ROOT))


def having(language: str) -> list[Path]:
    return [path for path in PAGES if blocks(path, language)]


def ran() -> list:
    """The pages whose code runs, those marked that run longer than they compile."""
    long = {"docs/wear.md": [pytest.mark.optimised], "docs/tutorials/life.md": [pytest.mark.optimised]}
    return [pytest.param(path, id=title(path), marks=long.get(title(path), [])) for path in RUN]


@pytest.fixture
def empty(tmp_path, monkeypatch):
    """An empty folder, in which examples may write."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def beside_examples(empty):
    """A folder with every example, as `clearance examples` writes them: files that pages show may name them."""
    for file in EXAMPLES.rglob("*"):
        if file.suffix in (".toml", ".urdf", ".csv"):
            (empty / file.name).write_bytes(file.read_bytes())
    return empty


# Files ---------------------------------------------------------------------------------------------------------------


def named(text: str) -> str:
    """The name of the file that a block shows, in its first line."""
    found = re.match(r"# (\w+\.toml)\n", text)
    return found[1] if found else "shown.toml"


def completed(text: str) -> str:
    """A fragment of a joint, or of a scene, put where it belongs: in the arm's."""
    keys, host = tomllib.loads(text), ARM.read_text(encoding="utf-8")
    for key in keys.keys() & {"normal", "friction", "drive"}:
        host = re.sub(rf"(?m)^{key} = .*$\n", "", host)
        text = "\n".join(line for line in text.splitlines())
    inside = keys.keys() <= {"normal", "friction", "drive"}
    return host.replace('child = "arm"\n', f'child = "arm"\n{text}\n') if inside else f"{host}\n{text}"


def shown(path: Path, folder: Path) -> None:
    """Write every file that a page shows, and read it."""
    for text in blocks(path, "toml"):
        keys = tomllib.loads(text)
        file = folder / named(text)
        file.write_text(text if keys.keys() & {"body", "robot", "scene"} else completed(text), encoding="utf-8")
        (load_study if "scene" in keys else load_scene)(file)


@pytest.mark.parametrize("path", having("toml"), ids=title)
def test_files_shown_are_read(path, beside_examples):
    shown(path, beside_examples)


def test_the_scene_of_the_readme_is_the_one_that_its_examples_load():
    for path in (ROOT / "README.md", DOCS / "getting_started.md"):
        assert ARM.read_text(encoding="utf-8").partition("\n")[2] in blocks(path, "toml")


# Commands and Python -------------------------------------------------------------------------------------------------


def words_of(text: str) -> str:
    """An outcome without its numbers and spaces: these differ from one machine to the next."""
    return " ".join(re.sub(r"[-+]?\d[\d.,e+-]*|nan|inf", " # ", re.sub(r"[\[\]()|-]", " ", text)).split())


@pytest.mark.slow
@pytest.mark.parametrize("path", ran())
def test_code_of_a_page_runs_in_an_empty_folder(path, empty):
    """Every command and every block of Python, in the order of the page; what is kept of it says the same."""
    text = path.read_text(encoding="utf-8")
    found = list(runner.run_page(text, empty, title(path)))
    assert found
    kept = outputs.place(path, outputs.KEPT) if DOCS in path.parents else None
    if kept is None or not kept.exists():
        return
    says = {one["key"]: one["text"] for one in json.loads(kept.read_text(encoding="utf-8"))["blocks"]}
    for block, outcome in zip((b for b in runner.blocks(text) if b.runs), found, strict=True):
        if block.language == "python":
            assert words_of(outcome.text) == words_of(says[block.key]), f"{title(path)}: run `make outputs`"


@pytest.mark.parametrize("path", RUN[1:], ids=title)
def test_every_page_shows_what_its_code_gives(path):
    """What is kept belongs to the code as it is; and a page whose blocks of Python show nothing is no example."""
    text, kept = path.read_text(encoding="utf-8"), outputs.place(path, outputs.KEPT)
    if kept.exists():
        assert json.loads(kept.read_text(encoding="utf-8"))["page"] == runner.page_key(text), "run `make outputs`"
    for block in runner.blocks(text):
        if block.language == "python":
            tree = ast.parse(block.text)
            shows = any(
                isinstance(node, ast.Call) and getattr(node.func, "id", "") == "print" for node in ast.walk(tree)
            )
            last = isinstance(tree.body[-1], ast.Expr)
            assert shows or last, f"{title(path)}: nothing is shown by\n{block.text}"


def test_kept_outputs_belong_to_pages():
    wanted = {outputs.place(path, outputs.KEPT).name for path in outputs.pages()}
    for file in outputs.KEPT.glob("*.json"):
        assert file.name in wanted, f"{file.name} is of no page"
        found = json.loads(file.read_text(encoding="utf-8"))
        for picture in (name for one in found["blocks"] for name in one["pictures"]):
            assert (file.parent / picture).stat().st_size < 250_000, picture


def test_commands_that_are_not_of_the_library_are_there():
    for path in having("sh"):
        for line in "".join(blocks(path, "sh")).splitlines():
            words = shlex.split(line, comments=True)
            if words[:2] == ["python", "-m"]:
                assert importlib.util.find_spec(words[2]), line
            elif words[:1] == ["make"]:
                assert f"\n{words[1]}:" in (ROOT / "Makefile").read_text(encoding="utf-8"), line
            elif words[:1] == ["pre-commit"]:
                assert (ROOT / ".pre-commit-config.yaml").exists(), line
            else:
                assert words[:1] in ([], ["pip"], ["clearance"]), f"{line}: nothing checks this command"


COMMANDS: Any = typer.main.get_command(app)
# What a command reads, beside its argument.
READ = ("trajectory",)


def commands(text: str) -> tuple[list[str], list[str]]:
    """The commands in a page's blocks, and those in its running text."""
    quoted = re.findall(r"(?<!`)`((?:clearance|python -m|make) [^`]+)`(?!`)", text)
    inline = [" ".join(found.split()) for found in quoted]
    shells = "".join(re.findall(r"^```sh\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)).replace("\\\n", "").splitlines()
    begin = "clearance ", "python -m ", "make "
    return [line for line in shells if line.startswith(begin)], [line for line in inline if line.startswith(begin)]


def checked(line: str, made: set[str], whole: bool = True) -> None:
    """Parse a command, without running it: its options are there, and the files that it reads are in the clone, shown
    in the page, or `made` by a command before. A name in capitals stands for a file of the reader's. What is not
    `whole` may lack its file, or the value of its last option.
    """
    words = shlex.split(line, comments=True)
    if words[:2] == ["python", "-m"]:
        assert importlib.util.find_spec(words[2].removesuffix(".NAME")), line
        return
    if words[0] == "make":
        assert f"\n{words[1]}:" in (ROOT / "Makefile").read_text(encoding="utf-8"), line
        return
    if words[1].startswith("-"):
        assert any(words[1] in parameter.opts for parameter in COMMANDS.params) or words[1] == "--help", line
        return
    assert words[1] in COMMANDS.commands, line
    if words[1] == "examples":
        made |= {name for example in words[2:] if not example.isupper() for name in needed(cj.examples.path(example))}
    if words[1] == "new" and len(words) > 2:
        made |= {f"{words[2]}.toml", f"{words[2]}_study.toml"}
    command = COMMANDS.commands[words[1]]
    known = {option for parameter in command.params for option in parameter.opts}
    try:
        context = command.make_context(words[1], words[2:])
    except UsageError:
        if whole or not all(word in known for word in words[2:] if word.startswith("-")):
            pytest.fail(f"This is no command: {line}")
        return
    for parameter in command.params:
        given = context.params[str(parameter.name)]
        if not isinstance(given, Path):
            continue
        if parameter.param_type_name == "argument" or parameter.name in READ:
            is_there = (ROOT / given).exists() or str(given) in made
            assert is_there or given.stem.isupper(), f"{line}: there is no {given}"
        else:
            made.add(str(given))


@pytest.mark.parametrize("path", PAGES, ids=title)
def test_every_command_of_a_page_is_one(path):
    text = path.read_text(encoding="utf-8")
    made = {named(block) for block in blocks(path, "toml")}
    called, named_only = commands(text)
    for line in called:
        checked(line, made)
    for line in named_only:
        checked(line, made, whole=False)


def test_every_command_of_the_help_is_one():
    lines = [line for line in str(app.info.help).splitlines() if line.startswith("clearance ")]
    assert len(lines) > 5
    made: set[str] = set()
    for line in lines:
        checked(line, made)
    for bad in ("clearance simulate missing.toml", "clearance simulate SCENE --moive a.gif", "clearance simulat SCENE"):
        with pytest.raises((AssertionError, pytest.fail.Exception)):
            checked(bad, set())


# Completeness --------------------------------------------------------------------------------------------------------


def test_readme_fits_on_two_screens():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 100


def test_generated_pages_are_those_of_the_code():
    spec = importlib.util.spec_from_file_location("generate", DOCS / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    generate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generate)
    for name, text in generate.pages().items():
        assert (GENERATED / name).read_text(encoding="utf-8") == text, f"{name} is stale: run `make reference`"


def test_every_key_stands_in_the_docs():
    for table in reference():
        page = (GENERATED / f"{table.file}.md").read_text(encoding="utf-8")
        section = page.partition(f"## {table.title}\n")[2].partition("\n## ")[0]
        for key in table.keys:
            assert f"| `{key.name}` | {key.help[:20]}" in section, f"{table.title}: {key.name}"


def test_every_public_name_is_documented():
    """Each has a summary, and says what each of its arguments is; each stands in one table of the reference."""
    places = names.tables(GENERATED / "python")
    for name in names.public_names():
        assert name.sentence.endswith((".", ":")), f"{name.short}: its documentation begins with no sentence"
        assert len(places[name]) == 1, f"{name.short}: it stands in the tables {places[name]}"
        told = name.told | {*(name.declared() if name.kind == "class" else ())}
        assert told.issuperset(name.arguments), f"{name.short}: it does not say what its arguments are"


def test_every_law_has_a_paragraph_and_a_curve():
    page, pictures = ((DOCS / name).read_text(encoding="utf-8") for name in ("laws.md", "pictures.py"))
    for name in (*NORMAL_LAWS, *FRICTION_LAWS):
        assert re.search(rf"^(`[\w-]+`, )*`{name}`", page, re.MULTILINE), name
        assert f'"{name}": ' in pictures, name


def test_the_tables_of_laws_are_those_of_the_code():
    page = (DOCS / "laws.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `([\w-]+)` \| (C[-\d]+ .*?\| C[-\d]+) \|", page, re.MULTILINE))
    assert sorted(rows) == sorted([*NORMAL_LAWS, *FRICTION_LAWS])
    for name, row in rows.items():
        law: Any = (catalogue.NORMAL if name in NORMAL_LAWS else catalogue.FRICTION)[name]
        assert row.split(" | ")[0].split()[0] == law.smoothness, name
        assert row.split(" | ")[-1] == law.smoothed(1e-6).smoothness, name
    # Limits of the penetration over the clearance.
    sizes = (jnp.asarray(x) for x in (0.01, 0.0101, 1e-4, 0.02))
    geometry = Geometry(*sizes)
    for name, limit in re.findall(r"^\| `([\w-]+)` \|.* d up to ([\d.]+) c \|$", page, re.MULTILINE):
        law = catalogue.NORMAL[name]
        assert float(law.validity(law.constants(geometry))) / 1e-4 == pytest.approx(float(limit), abs=0.06), name


def test_what_the_table_says_that_laws_deliver():
    """Within so many per cent of the restitution given, from it on or up to it, on this side of it."""
    page, asked = (DOCS / "laws.md").read_text(encoding="utf-8"), 0
    told = re.findall(r"^\| `([\w-]+)` \|[^|]*\|[^|]*\|([^|]*within (\d) %[^|]*)\|", page, re.MULTILINE)
    for name, words, share in told:
        least, most = (re.search(pattern, words) for pattern in (r"from e = ([\d.]+) on", r"up to e = ([\d.]+)"))
        every = jnp.linspace(0.05, 0.99, 30)
        found = jax.vmap(lambda e, make=NORMAL_LAWS[name]: make(1e10, e).delivered_restitution())(every)
        for e, delivered in zip(every.tolist(), found.tolist(), strict=True):
            if "above e" in words or "below e" in words:
                assert (delivered > e) == ("above e" in words), (name, e)
            if (least is None or e >= float(least[1])) and (most is None or e <= float(most[1])):
                assert abs(delivered / e - 1) <= 0.01 * float(share), (name, e, delivered)
                asked += 1
    assert len(told) == 9
    assert asked > 60


# Formulas, search, age ----------------------------------------------------------------------------------------------


def test_bold_letters_are_characters_of_their_own():
    """MathML Core drops `mathvariant="bold"`, so nothing bold may depend on it."""
    made = mathml.converted(r"\mathbf e = \boldsymbol\omega \times \mathbf{t}_1 + \mathbf A\, q_x", "inline")
    assert "bold" not in made
    for letter in (
        "\N{MATHEMATICAL BOLD SMALL E}",
        "\N{MATHEMATICAL BOLD ITALIC SMALL OMEGA}",
        "\N{MATHEMATICAL BOLD CAPITAL A}",
    ):
        assert letter in made
    assert "<mi>q</mi>" in made
    for path in PAGES:
        for formula in re.findall(r"(?<!\$)\$\$?([^$`]+?)\$\$?(?!\$)", path.read_text(encoding="utf-8")):
            if "\\mathbf" in formula or "\\boldsymbol" in formula:
                assert "bold" not in mathml.converted(formula, "block"), formula


def test_a_page_says_whether_its_code_has_changed(monkeypatch):
    stamp = "*Written by `python -m experiments.batches --save` at commit {}; 2 cores.*"
    said = {"cat-file": "", "log": ""}
    monkeypatch.setattr(stale, "_git", lambda *words: said[words[0]])
    assert stale.verdict("# No stamp") == ""
    assert "has not changed" in stale.verdict(stamp.format("abcdef1"))
    assert "differed" in stale.verdict(stamp.format("abcdef1-dirty"))
    said["log"] = "1234567 2026-01-02\n7654321 2026-01-01"
    assert "2 commits, the last one 1234567 of 2026-01-02" in stale.verdict(stamp.format("abcdef1"))
    said["cat-file"] = None
    assert "cannot be known" in stale.verdict(stamp.format("abcdef1"))
    files = {path.name for path in stale.measured("experiments.batches")}
    assert {"batches.py", "common.py", "publish.py"} <= files


def test_every_benchmark_page_has_a_title_and_a_command():
    stems = {path.stem for path in (DOCS / "benchmarks").glob("*.md")} - {"index"}
    assert stems == set(titles.TITLES)
    for stem in stems:
        first = (DOCS / "benchmarks" / f"{stem}.md").read_text(encoding="utf-8").splitlines()[0]
        assert first == f"# {titles.title(stem)}"
    known = benchmark_pages.commands()
    for words in known.values():
        assert importlib.util.find_spec(words[0]), words
    # Three pages were written before commands wrote them: their commands make pages of other names.
    assert stems - {"allocations", "derivatives"} <= set(known)


def test_every_section_of_the_gallery_is_a_machine_of_its_list():
    machines = tomllib.loads((DOCS / "gallery.toml").read_text(encoding="utf-8"))["machine"]
    assert len(machines) >= 15
    heads = re.findall(r"^## (.*)$", (DOCS / "gallery.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert heads == [machine["title"] for machine in machines if machine["title"] in heads]
    for machine in machines:
        assert machine["example"] in cj.examples.names()


SYNONYMS = ("backlash", "lash", "slop", "free play", "bushing", "hysteresis", "monte carlo", "tolerance stack-up")


# Links ---------------------------------------------------------------------------------------------------------------


def anchors(path: Path) -> set[str]:
    heads = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head).strip().lower().replace(" ", "-") for head in heads}


@pytest.mark.parametrize("path", [*PAGES, ROOT / "optimize" / "README.md"], ids=title)
def test_links_lead_somewhere(path):
    for target in re.findall(r"\]\(([^)\s]+)\)", path.read_text(encoding="utf-8")):
        if target.startswith(("https://", "http://")):
            continue
        file, _, anchor = target.partition("#")
        there = (path.parent / file).resolve() if file else path
        # The site has copies of the notebooks, so that a page may link them where they are shown.
        if there.parent == DOCS / "notebooks":
            there = ROOT / "experiments" / "notebooks" / there.name
        assert there.exists(), f"{title(path)}: {target}"
        assert not anchor or anchor in anchors(there), f"{title(path)}: {target}"


def test_pictures_are_small_and_all_used():
    pages = "".join(path.read_text(encoding="utf-8") for path in PAGES)
    for picture in (DOCS / "images").iterdir():
        assert picture.stat().st_size < (400_000 if picture.suffix == ".gif" else 150_000), picture.name
        assert f"images/{picture.name})" in pages, picture.name


@pytest.mark.slow
def test_the_site_is_built_without_a_warning_and_loads_nothing(tmp_path):
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", str(DOCS), str(tmp_path)]
    built = subprocess.run(command, capture_output=True, text=True, timeout=900)
    assert built.returncode == 0, built.stderr[-2000:]
    index = json.loads(
        (tmp_path / "searchindex.js").read_text(encoding="utf-8").removeprefix("Search.setIndex(").rstrip(")\n")
    )
    # The search of the site looks for the stems of words, and leaves short and common ones out.
    terms, language = {**index["terms"], **index["titleterms"]}, SearchEnglish({})
    stems = {
        language.stem(word) for phrase in SYNONYMS for word in re.findall(r"\w+", phrase) if language.word_filter(word)
    }
    assert len(stems) >= len(SYNONYMS)
    assert stems - set(terms) == set(), "a search for these finds nothing"
    glossary = (tmp_path / "glossary.html").read_text(encoding="utf-8").lower()
    assert all(phrase in glossary for phrase in SYNONYMS)
    for page in tmp_path.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r"<(?:script|img|iframe)[^>]*src=\"(https?:[^\"]*)|<link[^>]*href=\"(https?:[^\"]*)", text)
        assert not loaded, f"{page.name}: {loaded}"
    for style in tmp_path.rglob("*.css"):
        assert not re.search(r"(?:url\(|@import )[\"']?https?:", style.read_text(encoding="utf-8")), style.name
