"""Requests that need more memory than there is are refused before anything is done."""

import pytest

from ballscrew.cli import main
from ballscrew.orchestration.fmu import limits

GIGABYTE = 10**9


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("run --controller pid --step 1e-6 --stop 50", "5e+07 communication steps need, about"),
        ("map --controller pid --x Kp=1:2:100000 --y Kd=1:2:100000", "100000 x 100000 cells need"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line_that_says_how_much_and_what_to_do(
    tmp_path, monkeypatch, capsys, arguments, message
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(limits, "available_memory", lambda: 2 * GIGABYTE)
    assert main([*arguments.split(), "--out", "OUT"]) == 2
    heard = capsys.readouterr().err
    assert message in heard
    assert "but only 2 GB is available; " in heard
    assert heard.count("\n") == 1
    left = [p for p in tmp_path.rglob("*") if p.is_file()]
    assert left == []
