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
