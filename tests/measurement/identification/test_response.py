"""Frequency response of two masses with a spring: the resonance is the eigenvalue's."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ballscrew.cli import main
from ballscrew.measurement.identification.response import frequency_response
from ballscrew.measurement.records.record import Record
from ballscrew.solver.errors import BadRecord

M1, M2 = 2.0, 3.0


def shaken(response, late=0.0, seed=0, lowest=0.5):
    """A record of what moves as this function of s per force, by a multisine up to 150 Hz."""
    random = np.random.default_rng(seed)
    t = 1e-3 * np.arange(20_000)
    lines = np.fft.rfftfreq(len(t), 1e-3)
    s = 2j * np.pi * lines
    phases = np.exp(2j * np.pi * random.uniform(size=len(lines)))
    force = np.where((lines > lowest) & (lines < 150), phases, 0)
    force *= 10 / np.std(np.fft.irfft(force, len(t)))
    x = np.zeros_like(force)
    x[1:] = response(s[1:]) * force[1:] * np.exp(-late * s[1:])
    x, force = np.fft.irfft(x, len(t)), np.fft.irfft(force, len(t))
    signals = {"time": t, "force": force, "x": x + 1e-7 * random.standard_normal(len(t))}
    return Record("shaken", signals, 1e-3, command="force")


def spring_between(resonance, damping, m1=M1, m2=M2, of=0):
    """Position of one of two masses per force on the first, and the mode's eigenvalue."""
    reduced, omega = m1 * m2 / (m1 + m2), 2 * np.pi * resonance
    k, c = reduced * omega**2, 2 * damping * reduced * omega
    first, second = [m1, c + 2, k], [m2, c, k]
    both = np.polysub(np.polymul(first, second), np.polymul([c, k], [c, k]))
    (pole,) = (p for p in np.roots(both) if p.imag > 1.0)
    above = (second, [c, k])[of]
    return lambda s: np.polyval(above, s) / np.polyval(both, s), pole


def two_masses(resonance, damping, seed):
    """A record of the first mass, and frequency and damping of the true mode."""
    response, pole = spring_between(resonance, damping)
    return shaken(response, seed=seed), abs(pole) / (2 * np.pi), -pole.real / abs(pole)


FREE = {
    "mass": lambda s: 1 / (2 * s**2),
    "viscous": lambda s: 1 / (2 * s**2 + 500 * s),
    "spring": lambda s: 1 / (2 * s**2 + 20 * s + 4e4),
    "light motor": spring_between(100.0, 0.03, 1.0, 9.0)[0],
    "far side": spring_between(60.0, 0.03, of=1)[0],
}
HELD = {
    "PD": lambda s: -1 / (2e4 + 60 * s),
    "PID": lambda s: -1 / (2e4 + 60 * s + 1e5 / s),
    "velocity": lambda s: -1 / (6e3 + 300 * s),
}


@pytest.mark.parametrize("late", [0.0, 1e-3])
@pytest.mark.parametrize("lowest", [0.5, 4.0])
@pytest.mark.parametrize("name", [*FREE, *HELD])
def test_a_controller_is_told_from_every_drive_that_moves_by_the_force(name, late, lowest):
    """A drive's force does work on it; a controller's takes what comes from outside."""
    record = shaken((FREE | HELD)[name], late, lowest=lowest)
    if name in FREE:
        found = frequency_response(record)
        assert found.highest == pytest.approx(150, abs=3)
        assert found.said.startswith("no resonance seen below 1") == (name in ("mass", "viscous"))
    else:
        with pytest.raises(BadRecord, match="force acts against the displacement"):
            frequency_response(record)


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
    response, _ = spring_between(40.0, 0.03)
    for line in at:
        true = response(2j * np.pi * found.frequency[line])
        assert abs(found.position[line] / true - 1) < 0.03
        assert found.coherence[line] > 0.95


def run(*arguments):
    return main(["identify", *arguments])


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
        assert run(str(path), "--response", *more, "--out", str(out)) == 2
        assert "expected one record and no law" in capsys.readouterr().err
    assert run(str(path), "--out", str(out)) == 2
    assert "--law is missing" in capsys.readouterr().err
