"""Figures on pages are those of the stored proofs; one that is not stops the build of the docs."""

from __future__ import annotations

import importlib.util
import shutil
import sys
from types import SimpleNamespace

import provenance
import pytest

ROOT = provenance.ROOT


def loaded(name: str):
    """A module of ``docs/``, which is no package."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


claims = loaded("claims")


@pytest.fixture
def pages(tmp_path):
    """A copy of all pages that claim something."""
    for name in {claim["page"] for claim in claims.claims()}:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    return tmp_path


@pytest.fixture
def conf(monkeypatch):
    monkeypatch.setitem(sys.modules, "claims", claims)
    monkeypatch.setattr(sys, "path", [*sys.path])
    return loaded("conf")


def changed(page, old: str, new: str) -> None:
    text = page.read_text(encoding="utf-8")
    assert text.count(old) == 1
    page.write_text(text.replace(old, new), encoding="utf-8")


def test_all_figures_are_those_of_now():
    assert claims.check() == []


def test_the_overview_is_what_the_claims_and_the_proofs_say():
    assert claims.PAGE.read_text(encoding="utf-8") == claims.overview()


@pytest.mark.ci
def test_a_changed_number_on_a_page_is_found_and_put_right(pages):
    readme = pages / "README.md"
    before = readme.read_text(encoding="utf-8")
    changed(readme, "with 1400 random", "with 1300\nrandom")
    (line,) = claims.check(pages)
    assert line == (
        "README.md: 1300 has to be 1400: with 1300 random loops no wrong result was trusted"
    )
    claims.check(pages, write=True)
    assert claims.check(pages) == []
    assert readme.read_text(encoding="utf-8") == before.replace(
        "with 1400 random", "with 1400\nrandom"
    )


def test_a_sentence_that_is_gone_is_found(pages):
    changed(pages / "README.md", "no wrong result was trusted", "all went well")
    assert "README.md: found 0 times, not once" in claims.check(pages)[0]


def test_a_test_that_is_not_there_proves_nothing(monkeypatch):
    claim = next(c for c in claims.FILE["claim"] if c["page"] == "README.md" and "by" in c)
    monkeypatch.setitem(claim, "by", claim["by"] + "_no_more")
    assert [line.partition(" to prove")[0] for line in claims.check()] == [
        f"README.md: {claim['by']} is not there"
    ]


@pytest.mark.ci
def test_the_build_of_the_site_stops_on_a_changed_number(conf, pages):
    app = SimpleNamespace(srcdir=str(pages / "docs"))
    conf.stop_on_stale_figures(app)
    changed(pages / "docs" / "systems.md", "of 82 wrong", "of 83 wrong")
    with pytest.raises(SystemExit, match="83 has to be 82"):
        conf.stop_on_stale_figures(app)


def test_every_proof_has_its_command_in_the_makefile():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for name, command in claims.FILE["commands"].items():
        assert (ROOT / command.split()[0]).is_file()
        if name != "ablation":
            assert f"$(BIN)/python {command}" in makefile
    proved = {claim["proof"] for claim in claims.FILE["claim"] if "proof" in claim}
    assert proved <= set(claims.FILE["commands"]) <= set(provenance.SHOWS)


STANDS = {
    "/a/n": "12",
    "/a/n + /a/m | .1f": "12.5",
    "100 * /a/m per /a/n | .2g": "4.2",
    "len /rows": "3",
    "len /rows/[kind==x]": "2",
    "max /rows/[kind==x, good==True]/error | .1e": "1.3e-8",
    "sum /rows/*/count | _d": "12 345",
    "list /rows/*/kind": "x, x, y",
    "list /rows/[kind==z]/kind": "nothing",
    "len /none | no": "no",
    "len /rows | none": "3",
    "/a/n | Word": "Twelve",
    "/rows/1/kind": "x",
    "/key with~1slash": "7",
}


def test_a_figure_is_taken_as_the_expression_says():
    report = {
        "a": {"n": 12, "m": 0.5},
        "none": [],
        "key with/slash": 7,
        "rows": [
            {"kind": "x", "good": True, "error": 1.26e-8, "count": 12000},
            {"kind": "x", "good": False, "error": 2.0, "count": 300},
            {"kind": "y", "good": True, "error": 3.0, "count": 45},
        ],
    }
    assert {how: claims.figure(how, report) for how in STANDS} == STANDS
