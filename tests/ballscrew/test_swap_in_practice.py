"""`swap --sampled PERIOD --noise`: controllers on a computer, behind the instruments that fit."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ballscrew.cli import main

GAIN, RESOLUTION = 300.0, 1e-5
MINE = f"""
from ballscrew import Component, Input, Output, symbol

def p():
    law = {GAIN} * (symbol("x_d") - symbol("x"))
    inputs = (
        Input("x", "m", "position", role="measurement"),
        Input("x_d", "m", "set-point", role="reference"),
    )
    return Component("p", "P", inputs=inputs, outputs=(Output("u", "V", "command", law),))

"""


@pytest.fixture
def mine(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(MINE)
    return "mine.py:p"


def course(file):
    return np.genfromtxt(file, delimiter=",", names=True)


def test_commands_are_the_law_of_what_the_encoder_shows_at_samples_and_held_between(mine, capsys):
    asked = ["--sampled", "2e-3", "--noise", "--stop", "0.06", "--step", "5e-4", "--json"]
    given = ["--set", f"p.position_encoder_resolution={RESOLUTION}"]
    assert main(["swap", "--controllers", mine, *given, *asked, "--out", "out"]) == 0
    found = course("out/trajectory_p+sampled+position_encoder.csv")
    told = json.loads(capsys.readouterr().out)[0]
    assert told["controller"] == "p+sampled+position_encoder"
    assert told["sampling_period"] == 2e-3
    found = found[:-1]  # at the end of the run no step follows, and no sample is taken
    samples = np.round(found["time"] / 2e-3, 6) % 1 == 0
    assert np.ptp(found["x"]) > 100 * RESOLUTION
    # the law by hand: a whole count, next to the true position and its error between two lines
    seen = 0.08 - found["u"][samples] / GAIN
    counts = seen / RESOLUTION
    np.testing.assert_allclose(counts, np.round(counts), rtol=0, atol=1e-6)
    assert np.abs(seen - found["x"][samples]).max() < RESOLUTION + 0.2e-6
    held = np.repeat(found["u"][samples], 4)[: len(found)]
    np.testing.assert_array_equal(found["u"], held)


@pytest.mark.ci
def test_values_of_the_bare_controller_are_taken_and_those_that_were_used_come_back(mine, capsys):
    def iae(*given):
        assert main(["swap", "--stop", "0.02", "--noise", "--json", *given]) == 0
        heard = capsys.readouterr()
        return json.loads(heard.out)[0]["iae"], heard.err

    plain = ["--controllers", "pid", "--stop", "0.02", "--set", "pid.Kp=100", "--out", "plain"]
    assert main(["swap", *plain]) == 0
    capsys.readouterr()
    pid = "--controllers", "pid", "--sampled", "2e-3"
    given, _ = iae(*pid, "--set", "pid.Kp=100", "--out", "given")
    told, said = iae(*pid, "--params", "plain/parameters.toml", "--out", "told")
    assert told == given != iae(*pid, "--out", "nominal")[0]
    assert said == ""
    again, said = iae(*pid, "--params", "told/parameters.toml", "--out", "again")
    assert (again, said) == (given, "")
