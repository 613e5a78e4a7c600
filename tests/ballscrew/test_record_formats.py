"""The commands take files of measured data in any format, or say in one line what is missing."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from ballscrew.cli import main

TIME = np.arange(0.0, 1.0, 2e-3)


def complaint(capsys, *words):
    assert main(list(map(str, words))) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


@pytest.mark.parametrize("command", [["identify", "--law", "dahl"], ["diagnose"]])
def test_a_library_that_is_not_there_is_named_with_its_extra(
    tmp_path, monkeypatch, capsys, command
):
    (tmp_path / "run.csv").write_bytes(b"TDSm" + bytes(100))
    monkeypatch.setitem(sys.modules, "nptdms", None)
    line = complaint(capsys, *command, tmp_path / "run.csv", "--out", tmp_path / "out")
    assert "run.csv: is a TDMS file and needs nptdms: pip install 'ballscrew[records]'" in line


def test_identify_takes_columns_of_a_tdms_file(tmp_path, capsys):
    from nptdms import ChannelObject, TdmsWriter

    about = {"wf_increment": 2e-3, "wf_start_offset": 0.0}
    x = 1e-3 * (1 - np.cos(6 * TIME))
    force = 2.0 * np.sign(np.gradient(x)) + 0.01 * np.random.default_rng(0).normal(size=len(TIME))
    channels = [("pos", 1e3 * x, {"unit_string": "mm"}), ("F", force, {"unit_string": "N"})]
    with TdmsWriter(str(tmp_path / "run.tdms")) as writer:
        writer.write_segment([ChannelObject("trial", n, v, about | u) for n, v, u in channels])
    named = ["--map", "trial/pos=x", "--map", "F=force"]
    out = ["--law", "classical", "--out", tmp_path / "out"]
    code = main(list(map(str, ["identify", tmp_path / "run.tdms", *named, *out])))
    assert code in (0, 1), capsys.readouterr().err
    assert (tmp_path / "out" / "parameters.toml").is_file()
