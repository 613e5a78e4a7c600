"""No name or message of a file's own reaches a terminal as what it obeys."""

import numpy as np
import pytest
from third_party_fmus import proportional

from ballscrew import supervision
from ballscrew.cli import main

BELL, RED, C1, TURNED = "\x07", "\x1b[31m", "\x9b31m", "\u202e"
SPOOF = f"a{RED}{BELL}{C1}{TURNED}\rb"
OBEYED = {chr(c) for c in (*range(32), *range(127, 160), 0x202E)} - {"\n", "\t"}


def columns(folder):
    rows = "".join(f"{t},0,0\n" for t in np.arange(50) / 100)
    path = folder / "record.csv"
    path.write_text(f"time,{SPOOF.replace(chr(13), '')},u\n{rows}")
    return ["identify", str(path), "--law", "dahl", "--out", str(folder / "out")]


def words_of_an_fmu(folder):
    path = proportional(folder, "Says", at_start=f"raise RuntimeError({SPOOF!r})")
    return ["run", "--controller", str(path), "--out", str(folder / "out")]


def the_name_of_a_file(folder):
    return ["run", "--controller", str(folder / f"{SPOOF}.fmu"), "--out", str(folder / "out")]


@pytest.mark.parametrize(
    "asked",
    [
        words_of_an_fmu,
        *(pytest.param(f, marks=pytest.mark.ci) for f in (columns, the_name_of_a_file)),
    ],
)
def test_what_a_command_prints_holds_no_order_to_the_terminal(asked, tmp_path, capsys):
    main(asked(tmp_path))
    out, said = capsys.readouterr()
    assert "\\x1b[31m" in out + said  # it was named, in letters
    assert not OBEYED & set(out + said)


def test_the_line_of_an_interrupt_holds_none(capsys, monkeypatch):
    monkeypatch.setattr(supervision, "_heard", lambda number: SPOOF.encode() * (number == 0))
    supervision.interrupted()
    said = capsys.readouterr().err
    assert "\\x1b[31m" in said
    assert not OBEYED & set(said)
