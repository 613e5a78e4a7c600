"""A component from a Python file: what is run, what is left behind, what is said of bad files."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from ballscrew.controllers.pid import pid
from ballscrew.solver.component import Component, DiscreteState, Mode, Parameter, symbol
from ballscrew.solver.component_file import load_component, read_component
from ballscrew.solver.errors import ContractError

GAIN = """
from ballscrew.solver.component import Component, Input, Output, symbol
import helper

def make():
    x = symbol("x")
    return Component(
        name=helper.NAME,
        description="A gain",
        inputs=(Input("x", "m", "position"),),
        outputs=(Output("u", "V", "command", helper.GAIN * x),),
    )
"""


def written(folder: Path, text: str = GAIN, gain: float = 2.0) -> str:
    """A component's file with a helper beside it; its name as a part."""
    folder.mkdir(exist_ok=True)
    (folder / "mine.py").write_text(text)
    (folder / "helper.py").write_text(f"NAME = {folder.name!r}\nGAIN = {gain}\n")
    return f"{folder / 'mine.py'}:make"


def gain_of(part: str) -> float:
    return float(read_component(part).output("u").value.coeff(symbol("x")))


def test_files_and_helpers_of_one_name_in_two_folders_do_not_meet(tmp_path):
    first, second = written(tmp_path / "a"), written(tmp_path / "b", gain=3.0)
    assert [gain_of(p) for p in (first, second, first)] == [2.0, 3.0, 2.0]
    assert read_component(second).name == "b"


def test_an_edit_of_the_file_or_its_helper_is_seen_at_once(tmp_path):
    part = written(tmp_path / "a")
    assert gain_of(part) == 2.0
    written(tmp_path / "a", gain=4.0)  # as many bytes, within the same second
    assert gain_of(part) == 4.0
    written(tmp_path / "a", GAIN.replace("* x", "* x * 2"), gain=4.0)
    assert load_component(part).output("u").value == 4.0 * symbol("x")  # till it is read again
    assert gain_of(part) == 8.0


def test_nothing_is_left_in_the_process_its_output_or_beside_the_file(
    tmp_path, monkeypatch, capsys
):
    first = "import sys\nsys.path.append('/nowhere')\nprint('hello')\n"
    part = written(tmp_path / "a", first + GAIN)
    monkeypatch.setitem(sys.modules, "helper", theirs := object())
    paths, modules = list(sys.path), dict(sys.modules)
    assert gain_of(part) == 2.0
    heard = capsys.readouterr()
    assert (heard.out, heard.err) == ("", "hello\n")  # what it prints is no result
    assert sys.path == paths
    assert sys.modules["helper"] is theirs
    assert {n for n in set(sys.modules) - set(modules) if not n.startswith("ballscrew")} == set()
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == ["helper.py", "mine.py"]


def test_what_a_file_finds_is_right_for_dataclasses_packages_and_its_own_place(tmp_path):
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / "__init__.py").write_text("from .inner import NAME\n")
    (tmp_path / "package" / "inner.py").write_text("NAME = 'inner'\n")
    (tmp_path / "name.txt").write_text("_text")
    (tmp_path / "mine.py").write_text(
        "from __future__ import annotations\n"
        "from dataclasses import dataclass\n"
        "from pathlib import Path\n"
        "from ballscrew import Component\n"
        "@dataclass\n"
        "class Data:\n    name: str\n"
        "def make():\n"
        "    from package import NAME\n"
        "    text = Path(__file__).with_name('name.txt').read_text()\n"
        "    return Component(Data(NAME + text).name, 'Nothing')\n"
    )
    assert read_component(f"{tmp_path / 'mine.py'}:make").name == "inner_text"
    assert "package.inner" not in sys.modules


@pytest.mark.ci
@pytest.mark.parametrize(
    ("text", "function", "said"),
    [
        ("\nimport nothing_of_it\n", "make", "mine.py, line 2: it cannot be imported: ModuleNotFo"),
        ("import broken\n", "make", "broken.py, line 2: it cannot be imported: SyntaxError: "),
        (GAIN, "", "give the function that makes the component, such as mine.py:FUNCTION; it h"),
        ("make = 3\n", "make", "mine.py: make is 3; expected a function without arguments"),
        ("def make(gain): ...\n", "make", "missing a required argument: 'gain'; give it a default"),
        ("def make(): return [1.5]\n", "make", "make() returned [1.5], which is a list; expected"),
        (
            "import helper\ndef make():\n    return helper.broken()\n",
            "make",
            "helper.py, line 3: make() failed: IndexError: list index out of range",
        ),
        (
            GAIN.replace("* x", "* symbol('q')"),
            "make",
            "mine.py, line 7: a: output u uses 'q', which is not declared",
        ),
    ],
)
def test_a_file_that_gives_no_component_is_refused_with_its_line(
    tmp_path, monkeypatch, text, function, said
):
    written(tmp_path / "a", text)
    monkeypatch.chdir(tmp_path / "a")
    with Path("helper.py").open("a", encoding="utf-8") as stream:
        stream.write("def broken(): return [][1]\n")
    Path("broken.py").write_text("\nx = = 1\n", encoding="utf-8")
    with pytest.raises(ContractError) as refused:
        read_component(f"mine.py:{function}")
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_the_digest_tells_apart_whatever_differs():
    one = pid()
    step = DiscreteState("k", "1", "a count", symbol("k") + 1)
    others: list[Component] = [
        replace(one, name="other"),
        replace(one, parameters=(replace(one.parameters[0], source="else"), *one.parameters[1:])),
        replace(one, outputs=(replace(one.outputs[0], value=one.outputs[0].value * (1 + 2e-16)),)),
        replace(one, discrete=(step,), sample_time=Parameter("Ts", 1.0, "s", "period", "any")),
        replace(one, modes=(Mode("m", derivatives={"w": symbol("x")}),)),
        replace(one, modes=(Mode("m", derivatives={"w": symbol("v")}),)),
    ]
    assert len({c.digest for c in (one, *others)}) == 1 + len(others)
    assert pid().digest == one.digest


@pytest.mark.ci
def test_the_digest_is_the_same_in_every_process():
    code = (
        "from ballscrew.orchestration.loop.catalogue import component as c; "
        "print(*(c(n).digest for n in ('plant_classical', 'iol', 'pid_sampled')))"
    )

    def told(seed):
        environment = os.environ | {"PYTHONHASHSEED": seed}
        return subprocess.check_output([sys.executable, "-c", code], env=environment)

    assert told("1") == told("2")
