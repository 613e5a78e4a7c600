"""``ballscrew lyapunov`` and ``ballscrew map`` as a person uses them."""

import csv
import json
import time

import numpy as np
import pytest

from ballscrew.cli import main


def test_lyapunov_writes_what_it_promises(tmp_path, capsys):
    arguments = ["lyapunov", "--controller", "nctf", "--stop", "300", "--out", str(tmp_path)]
    assert main(arguments) == 0
    figures = json.loads((tmp_path / "lyapunov.json").read_text())
    promised = "exponents_bits_per_s exponents_nats_per_s asymptotic_bits_per_s"
    promised += " mean_trace_bits_per_s sum_rule_error lambda1_times_t_bits verdict evidence"
    assert set(promised.split()) <= set(figures)
    assert figures["verdict"] == "stuck on a line of equilibria"
    assert figures["neutral_directions"] == 1
    assert figures["rest"]["plant_x"] == pytest.approx(0.08, abs=1e-9)
    # the thesis' -0.0134 (Table 3.3); the limit is zero, and the estimate goes there as c/t
    assert figures["exponents_bits_per_s"][0] == pytest.approx(-0.0134, abs=1e-4)
    assert figures["lambda1_times_t_bits"] == pytest.approx(-4.008, abs=2e-3)
    assert figures["asymptotic_bits_per_s"][0] == 0.0
    assert 0.0 < figures["sum_rule_error"] < 1e-3
    bits = np.array(figures["exponents_bits_per_s"])
    assert bits == pytest.approx(np.array(figures["exponents_nats_per_s"]) / np.log(2))
    assert np.all(np.diff(bits) <= 0)
    with open(tmp_path / "lyapunov.csv", encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(stream))
    assert rows[0][:2] == ["time", "lambda1_bits_per_s"]
    assert float(rows[-1][1]) == pytest.approx(bits[0])
    assert (tmp_path / "lyapunov.png").read_bytes()[:4] == b"\x89PNG"
    printed = capsys.readouterr().out
    assert "stuck on a line of equilibria" in printed
    assert "neutral" in printed


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("loop", "words", "below"),
    [
        (
            "pid --plant plant_classical --stop 20",
            "at once: a direction that is contracted at",
            None,
        ),
        # a number has 52 bits, so less is left than 2^-52 after a sample of 1 ms
        ("pid_sampled --stop 1", "below -5.2e+04: a direction that is contracted within", -5.2e4),
    ],
)
def test_directions_that_vanish_have_words_and_strict_json(tmp_path, capsys, loop, words, below):
    command = ["lyapunov", "--controller", *loop.split(), "--out", str(tmp_path)]
    assert main(command) in (0, 1)
    printed, said = capsys.readouterr()
    assert words in printed
    assert "inf" not in printed + said
    assert "nan" not in printed + said

    def refuse(name):
        raise AssertionError(f"{name} is not JSON")

    text = (tmp_path / "lyapunov.json").read_text(encoding="utf-8")
    figures = json.loads(text, parse_constant=refuse)
    assert figures["contracted_at_once"] == figures["exponents_bits_per_s"].count(None) > 0
    assert figures["contracted_below_bits_per_s"] == (below and pytest.approx(below, rel=1e-9))
    assert words in (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.mark.ci
def test_exponents_that_take_too_long_end_with_what_is_known_and_a_verdict(tmp_path, capsys):
    """All of it takes minutes: 300 000 samples, each with a tangent for each state, twice."""
    arguments = ["lyapunov", "--controller", "pid_sampled", "--budget", "2", "--json"]
    began = time.process_time()
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    assert time.process_time() - began < 15.0
    told = capsys.readouterr()
    figures = json.loads(told.out)
    assert 0.0 < figures["time_s"] < 300.0
    assert f"up to t = {figures['time_s']:g} s, not 300 s" in told.err
    assert "2 s of computing time were used up; from the motion alone: " in figures["evidence"]
    assert figures["verdict"] == "stuck on a line of equilibria"
    assert figures["would_decide"] == ""
    assert figures["rest"]["plant_x"] == pytest.approx(0.08, abs=1e-5)
    assert set(figures["exponents_error_bits_per_s"]) == {None}


X, Y = ["--x", "sigma0_hat=66966:66968:2"], ["--y", "sigma1_hat=340:350:2"]


def test_map_writes_what_it_promises_and_refuses_to_overwrite(tmp_path, capsys):
    arguments = ["map", "--controller", "iol", *X, *Y, "--stop", "5", "--workers", "1"]
    arguments += ["--out", str(tmp_path)]
    assert main([*arguments, "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["cells"] == 4
    assert {f.name for f in tmp_path.glob("[!.]*")} == {
        "map.parquet",
        "map.json",
        "parameters.toml",
        "map.png",
        "report.html",
    }
    assert main(arguments) == 2
    assert "--resume" in capsys.readouterr().err
    assert main([*arguments, "--resume"]) == 0


@pytest.mark.ci
def test_a_full_disk_keeps_what_is_done_and_says_how_to_go_on(tmp_path, capsys, monkeypatch):
    from ballscrew.orchestration.study import workers

    def full(path, data):
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr(workers, "write_atomically", full)
    arguments = ["map", "--controller", "iol", *X, *Y, "--stop", "1", "--workers", "1"]
    assert main([*arguments, "--out", str(tmp_path)]) == 2
    heard = capsys.readouterr().err
    assert "No space left" in heard
    assert "--resume" in heard
