"""Frequency response of two masses with a spring: the resonance is the eigenvalue's."""

from __future__ import annotations

import argparse
import json

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

from ballscrew.identification.response import frequency_response
from ballscrew.identify_command import add_parser
from ballscrew.options import BadRequest
from ballscrew.records.record import Record

M1, M2, FINE = 2.0, 3.0, 5


def two_masses(resonance, damping, seed):
    """A record of the first mass, shaken by a multisine up to 150 Hz, and the true mode."""
    reduced = M1 * M2 / (M1 + M2)
    omega = 2 * np.pi * resonance
    k, c = reduced * omega**2, 2 * damping * reduced * omega
    a = np.array(
        [
            [0, 1, 0, 0],
            [-k / M1, -(c + 2) / M1, k / M1, c / M1],
            [0, 0, 0, 1],
            [k / M2, c / M2, -k / M2, -c / M2],
        ]
    )
    (pole,) = (p for p in np.linalg.eigvals(a) if p.imag > 1.0)
    random = np.random.default_rng(seed)
    t = 1e-3 / FINE * np.arange(20_000 * FINE)
    lines = np.fft.rfftfreq(len(t), t[1])
    phases = np.exp(2j * np.pi * random.uniform(size=len(lines)))
    force = np.fft.irfft(np.where((lines > 0.5) & (lines < 150), phases, 0), len(t))
    force *= 10 / np.std(force)
    system = StateSpace(a, [[0], [1 / M1], [0], [0]], [[1, 0, 0, 0]], [[0]])
    _, x, _ = lsim(system, force, t)
    seen = x[::FINE] + 1e-7 * random.standard_normal(20_000)
    signals = {"time": t[::FINE], "force": force[::FINE], "x": seen}
    true = abs(pole) / (2 * np.pi), -pole.real / abs(pole)
    return Record("shaken", signals, 1e-3, command="force"), *true


@pytest.mark.prove
def test_resonance_and_damping_are_the_eigenvalue_s():
    held = [0, 0]
    for seed in range(10):
        record, frequency, damping = two_masses(30 + 8 * seed, 0.02 + 0.005 * (seed % 4), seed)
        found = frequency_response(record)
        held[0] += found.resonance.low <= frequency <= found.resonance.high
        held[1] += (found.damping.low or 0.0) <= damping <= found.damping.high
        assert found.resonance.value == pytest.approx(frequency, rel=2e-3)
        assert found.damping.value == pytest.approx(damping, rel=0.1)
    assert min(held) >= 8  # fewer of ten than a share of 0.95 gives once in eighty times


def test_the_response_is_the_system_s():
    record, *_ = two_masses(40.0, 0.03, 1)
    found = frequency_response(record)
    at = np.searchsorted(found.frequency, [5.0, 15.0, 35.0, 60.0, 120.0])
    reduced = M1 * M2 / (M1 + M2)
    omega = 2 * np.pi * 40.0
    k, c = reduced * omega**2, 2 * 0.03 * reduced * omega
    for line in at:
        s = 2j * np.pi * found.frequency[line]
        whole = np.array(
            [[M1 * s**2 + (c + 2) * s + k, -c * s - k], [-c * s - k, M2 * s**2 + c * s + k]]
        )
        true = np.linalg.inv(whole)[0, 0]
        assert abs(found.position[line] / true - 1) < 0.03
        assert found.coherence[line] > 0.95


@pytest.mark.ci
def test_a_resonance_beyond_what_is_shaken_is_not_seen():
    record, *_ = two_masses(400.0, 0.03, 3)
    found = frequency_response(record)
    assert found.resonance is None
    assert found.highest == pytest.approx(150, abs=2)
    assert found.said.startswith("no resonance seen below 15")


def run(*arguments):
    parser = argparse.ArgumentParser()
    add_parser(parser.add_subparsers(), argparse.ArgumentParser)
    options = parser.parse_args(["identify", *arguments])
    return options.action(options)


@pytest.mark.ci
@pytest.mark.usefixtures("drawn")
def test_the_command_writes_table_and_picture(tmp_path, capsys):
    record, frequency, _ = two_masses(40.0, 0.03, 1)
    path = tmp_path / "shaken.csv"
    table = np.column_stack([record.time, record.force, record.x])
    np.savetxt(path, table, "%.10g", delimiter=",", header="time,u,x", comments="")
    out = tmp_path / "out"
    assert run(str(path), "--response", "--unit", "u=N", "--out", str(out)) == 0
    assert "first resonance at 40" in capsys.readouterr().out
    told = json.loads((out / "response.json").read_text())
    assert told["resonance_Hz"]["value"] == pytest.approx(frequency, rel=2e-3)
    assert told["input_unit"] == "N"
    assert (out / "response.csv").read_text().startswith("frequency [Hz],magnitude [m/N]")
    assert (out / "response.png").stat().st_size > 5000
    for more in (("--law", "dahl"), ("--mass", "fit")):
        with pytest.raises(BadRequest, match="expected one record and no law"):
            run(str(path), "--response", *more, "--out", str(out))
    with pytest.raises(BadRequest, match="--law is missing"):
        run(str(path), "--out", str(out))
