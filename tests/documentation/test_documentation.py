"""The documentation says what is true: its code runs and prints what it shows, and nothing public is missing."""

import importlib.util
import re
import types
import warnings

import pytest
from documentation_blocks import DOCS, FIGURES, PAGES, ROOT, Block, agrees, blocks_of, printed_by, run_page, stale

import mbdcasadi as mbd

EXAMPLES = sorted(path.stem for path in (ROOT / "examples").glob("*.py"))


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if blocks_of(page)], ids=lambda page: page.stem)
def test_code_prints_what_the_page_shows(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    assert not "\n".join(run_page(page))
    drawn = {path.name for path in tmp_path.glob("*.png")}
    shown = set(re.findall(r"\(figures/([\w.]+\.png)\)", page.read_text(encoding="utf-8").replace("../", "")))
    assert drawn <= shown or page.name == "README.md", (
        f"drawn by the code and not shown on the page: {sorted(drawn - shown)}"
    )
    outdated = [text for name in sorted(drawn & shown) if (text := stale(FIGURES / name, tmp_path / name))]
    assert not outdated, f"{outdated}: regenerate them by tests/documentation_blocks.py"
    if page.parent == DOCS:
        assert shown <= drawn, f"shown on the page and not drawn by its code: {sorted(shown - drawn)}"


def test_what_agrees():
    assert agrees("a 1.50 m\n  b", "a 1.51 m\nb") and not agrees("a 1.50 m", "a 1.53 m")
    assert agrees("x = ... s, done", "x = 0.31 s, done") and not agrees("x = ... s, done", "x = 0.31 s")
    assert agrees("3 rows", "3 rows") and not agrees("3 rows", "4 rows") and not agrees("", "something")
    assert agrees("1.0e-06", "1.1e-06") and not agrees("1.0e-06", "1.0e-05")


def test_errors_appear_as_text(tmp_path):
    block = Block(tmp_path / "page.md", 1, 'mbd.Body("a", mass=-1, inertia=1)', "ModelError: ", (0, 0))
    assert printed_by(block, {"mbd": mbd}).startswith("ModelError: body 'a': mass")
    silent = Block(tmp_path / "page.md", 1, block.code, None, (0, 0))
    with pytest.raises(mbd.ModelError):
        printed_by(silent, {"mbd": mbd})


def public():
    """Everything that the package offers, by name."""
    return {name: getattr(mbd, name) for name in dir(mbd)}


def test_everything_public_is_in_the_reference():
    listed = "\n".join(path.read_text(encoding="utf-8") for path in (DOCS / "reference").glob("*.rst"))
    words = set(re.findall(r"\w+", listed))
    names = {n for n, v in public().items() if not n.startswith("_") and not isinstance(v, types.ModuleType)}
    assert names <= words, sorted(names - words)
    ready = {name for name in mbd.library.__all__ if isinstance(getattr(mbd.library, name), types.FunctionType)}
    assert ready <= words, sorted(ready - words)


def test_every_element_is_in_the_catalogue():
    text = "\n".join(path.read_text(encoding="utf-8") for path in (DOCS / "catalogue").glob("*.md"))
    kinds = {n for n, v in public().items() if isinstance(v, type) and issubclass(v, mbd.Element | mbd.FrictionLaw)}
    kinds -= {"Element", "ConstraintElement", "Joint", "FrictionLaw"}  # to derive from
    missing = {name for name in kinds if f"mbdcasadi.{name}`" not in text}
    assert not missing, sorted(missing)


def test_errors_and_warnings_are_explained():
    text = (DOCS / "errors.md").read_text(encoding="utf-8")
    kinds = [n for n, v in public().items() if isinstance(v, type) and issubclass(v, BaseException)]
    assert all(f"`{name}`" in text or f"mbdcasadi.{name}`" in text for name in kinds)


def load(name):
    """A script of the documentation as a module."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_example_is_in_the_gallery():
    gallery = load("gallery")
    assert sorted(name for names in gallery.GROUPS.values() for name in names) == EXAMPLES
    for name in EXAMPLES:
        assert (gallery.PICTURES / f"{name}.png").exists() and (gallery.PICTURES / f"{name}_mechanism.png").exists()
    assert all(gallery.question(name)[0] for name in EXAMPLES)


@pytest.mark.slow
def test_pictures_of_the_catalogue(tmp_path):
    figures = load("catalogue_figures")
    outdated = []
    with warnings.catch_warnings():
        warnings.simplefilter("error", mbd.MechanismWarning)
        for name in figures.SCENES:
            figures.save(name, tmp_path)
            outdated.append(stale(figures.TARGET / f"{name}.png", tmp_path / f"{name}.png"))
    assert not any(outdated), f"{list(filter(None, outdated))}: regenerate them by docs/catalogue_figures.py"
    text = "\n".join(path.read_text(encoding="utf-8") for path in (DOCS / "catalogue").glob("*.md"))
    shown = set(re.findall(r"figures/catalogue/(\w+)\.png", text))
    assert shown == {*figures.SCENES, "friction_laws"} == {path.stem for path in (FIGURES / "catalogue").glob("*.png")}


@pytest.mark.slow
def test_a_stale_figure_is_found(tmp_path):
    """Another pose of the same mechanism, and the same drawing at another resolution."""
    link = mbd.Body("link", 1, 0.1, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), link.at(-0.5, 0))
    mechanism = mbd.Mechanism([link], [pin])
    for name, angle, dpi in (("a", 0.3, 80), ("b", 0.3, 110), ("c", 0.45, 80), ("d", -1.0, 80)):
        mbd.draw(mbd.assemble(mechanism, [pin.angle == angle])).figure.savefig(tmp_path / f"{name}.png", dpi=dpi)
    assert stale(tmp_path / "a.png", tmp_path / "b.png") is None
    assert stale(tmp_path / "a.png", tmp_path / "c.png") and stale(tmp_path / "a.png", tmp_path / "d.png")


def test_commands_of_the_pages_are_the_package_s_own():
    """The shell blocks that call the package are run on its example model by the tests of the command line."""
    for page in PAGES:
        for command in re.findall(r"python -m mbdcasadi [^\n`]*", page.read_text(encoding="utf-8")):
            for file in re.findall(r"examples/\S+", command):
                assert (ROOT / file).exists(), f"{page.name}: {command}"
