"""Each system of the gallery: its page holds what it computes, and its commands run."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from ballscrew.cli import main
from ballscrew.gallery import SYSTEMS
from ballscrew.gallery.finding import BEGIN, END, Finding, table_of

ROOT = Path(__file__).resolve().parents[2]
PAGES = {name: (ROOT / "gallery" / name / "page.md").read_text("utf-8") for name in SYSTEMS}
KINDS = ("export", "run", "lyapunov", "map")


def commands(page):
    return re.findall(r"^ballscrew (.+)$", page, re.M)


def cells(table):
    return [[c.strip() for c in line.strip("|").split("|")] for line in table.strip().splitlines()]


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(n, marks=[pytest.mark.xdist_group(f"gallery {n}"), *ci])
        for n in SYSTEMS
        for ci in [[] if n in ("bouncing_ball", "van_der_pol") else [pytest.mark.ci]]
    ],
)
def shown(request, tmp_path_factory, drawing):
    """A system, and the folder that the command wrote of it."""
    folder = tmp_path_factory.mktemp(request.param)
    with drawing():
        assert main(["gallery", request.param, "--out", str(folder)]) == 0
    return request.param, folder


def test_the_page_prints_the_numbers_that_are_computed(shown):
    """To a unit of the last digit that it prints, since round-off differs between machines."""
    name, folder = shown
    written = {p.name for p in folder.iterdir()}
    assert {"components.py", "page.md", "findings.json", "picture.png"} <= written
    printed = cells(PAGES[name].partition(BEGIN)[2].partition(END)[0])[2:]
    rows = json.loads((folder / "findings.json").read_text("utf-8"))["findings"]
    found = [Finding(**{k: v for k, v in row.items() if k != "agrees"}) for row in rows]
    assert len(found) >= 3
    now = cells(table_of(found))[2:]
    for row, f, fresh in zip(printed, found, now, strict=True):
        ours = row.pop(1)
        fresh.pop(1)
        assert row == fresh
        value = float(ours.split()[0])
        assert value == pytest.approx(f.ours, rel=2e-5, abs=1e-12), f.what
        assert f.source, f.what  # where it is printed, or how ours is checked
        assert f.agrees is not False or f.remark, f.what  # a difference is explained


@pytest.mark.ci
def test_the_page_has_one_command_for_each_way_of_looking_and_they_run(
    shown, tmp_path, monkeypatch
):
    """A tenth of each motion, and the corners of the map."""
    name, folder = shown
    monkeypatch.chdir(folder)
    asked = [shlex.split(c) for c in commands(PAGES[name]) if not c.startswith("gallery")]
    assert {words[0] for words in asked} >= set(KINDS)
    for words in asked:
        words[words.index("--out") + 1] = str(tmp_path / words[0])
        if words[0] == "map":
            words += ["--workers", "1"]
        words[:] = [re.sub(r"^(.+=.+:.+):\d+$", r"\1:2", word) for word in words]
        if "--stop" in words:
            stop = words.index("--stop") + 1
            words[stop] = str(float(words[stop]) / 10)
        assert main(words) in (0, 1), words


def test_a_number_agrees_within_a_digit_of_what_is_printed_and_only_then():
    near = Finding("x", 2.0149, "1", "a text", 2.0148, 1e-4)
    assert near.agrees
    assert not Finding("x", 2.0150, "1", "a text", 2.0148, 1e-4).agrees
    assert Finding("x", 2.0, "1", "a text", np.float64(2.0)).agrees is True  # JSON knows no other
    assert Finding("x", 2.0, "1", "another solver").agrees is None
    assert "| x | 2.0149 | 2.0148 | yes | a text |" in table_of([near])
