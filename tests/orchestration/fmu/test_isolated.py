"""Third-party FMUs in processes of their own: crashes, hangs, clashes, and many of them."""

import contextlib
import csv
import os
import signal
import socket
import subprocess
import threading
import time

import numpy as np
import pytest
from third_party_fmus import proportional

from ballscrew.cli import main
from ballscrew.fmus.made_here import is_ours
from ballscrew.fmus.native.export import write_native
from ballscrew.orchestration.fmu import isolated
from ballscrew.orchestration.fmu.fmu_instance import FmuInstance, StepFailed
from ballscrew.orchestration.fmu.isolated import IsolatedInstance
from ballscrew.orchestration.loop.catalogue import catalogued_model, fmu
from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.solver.errors import FmuError

SEGFAULT = "import ctypes; ctypes.string_at(0)"


def run(path, out, *more):
    asked = ["run", "--controller", path, "--stop", "0.1", "--step", "1e-3", "--out", out, *more]
    return main([*map(str, asked)])


def rows(out):
    with (out / "trajectory.csv").open() as stream:
        return list(csv.DictReader(stream))


def one_line_on_stopping(captured):
    """The line that says why: the first one on standard error, with nothing of Python in it."""
    assert "Traceback" not in captured.err
    return captured.err.splitlines()[0]


def test_a_segfault_ends_the_run_with_a_line_and_what_was_computed(tmp_path, capsys):
    crash = proportional(tmp_path, "Crash", in_step=f"if current_time > 0.05: {SEGFAULT}")
    assert run(crash, tmp_path / "out") == 1
    line = one_line_on_stopping(capsys.readouterr())
    assert "controller (Crash.fmu) was ended by SIGSEGV" in line
    assert "0.051 s" in line
    times = [float(row["time"]) for row in rows(tmp_path / "out")]
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(0.05, abs=2e-3)
    assert (tmp_path / "out" / "metrics.json").is_file()


@pytest.mark.ci
def test_a_hang_ends_at_the_time_limit_with_a_line_and_what_was_computed(tmp_path, capsys):
    hang = proportional(tmp_path, "Hang", in_step="while current_time > 0.05: pass")
    start = time.monotonic()
    assert run(hang, tmp_path / "out", "--time-limit", "2") == 1
    assert time.monotonic() - start < 30
    line = one_line_on_stopping(capsys.readouterr())
    assert "controller (Hang.fmu) did not answer the call step within 2 s" in line
    assert float(rows(tmp_path / "out")[-1]["time"]) == pytest.approx(0.05, abs=2e-3)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("at_start", "words"),
    [
        (SEGFAULT, "was ended by SIGSEGV"),
        ("raise RuntimeError('no licence')", "no licence"),
        ("while True: pass", "did not answer the call open within 3 s"),
    ],
)
def test_an_fmu_that_does_not_open_is_a_bad_request(tmp_path, capsys, at_start, words):
    bad = proportional(tmp_path, "Bad", at_start=at_start)
    assert run(bad, tmp_path / "out", "--time-limit", "3") == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert "Bad.fmu" in line
    assert words in line


@pytest.mark.ci
def test_two_fmus_with_a_module_called_plant_each_run_their_own(tmp_path, monkeypatch):
    """One interpreter would give the second the first one's module, or the user's own."""
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "plant.py").write_text("raise ImportError('the plant.py of the user')")
    monkeypatch.chdir(tmp_path / "here")
    courses = []
    for gain in (1.0, 0.5):
        path = proportional(
            tmp_path / str(gain),
            f"Gain{int(10 * gain)}",
            head="import plant\n",
            in_step="self.x_d = plant.GAIN * self.x_d",
            modules={"plant": f"GAIN = {gain}\n"},
        )
        courses.append(run_closed_loop(Loop(str(path), stop=0.02, step=1e-3)).run.commands["u"])
    np.testing.assert_allclose(courses[0][0], 400 * 0.08, rtol=1e-12)
    np.testing.assert_allclose(courses[1][0], 400 * 0.04, rtol=1e-12)


@pytest.mark.ci
def test_what_is_ours_is_known_by_content_not_by_name(tmp_path):
    copy = tmp_path / "anything.fmu"
    copy.write_bytes(fmu("nctf").read_bytes())
    assert is_ours(copy)
    made = write_native(catalogued_model("pid"), tmp_path / "made.fmu", 2).path
    assert is_ours(made)
    made.write_bytes(made.read_bytes() + b" ")
    assert not is_ours(made)
    fake = proportional(tmp_path, "Fake").rename(tmp_path / "nctf.fmu")
    assert not is_ours(fake)


@pytest.mark.ci
def test_no_process_outlives_its_instance_nor_a_failed_opening(tmp_path):
    def children():
        with open(f"/proc/{os.getpid()}/task/{os.getpid()}/children", encoding="utf-8") as stream:
            return set(stream.read().split())

    before = children()
    one = IsolatedInstance(fmu("pid"), "one")
    assert children() - before
    one.close()
    one.close()
    hang = proportional(tmp_path, "Sleeper", at_start="import time; time.sleep(1000)")
    with pytest.raises(FmuError, match="within 1 s"):
        IsolatedInstance(hang, "two", time_limit=1.0)
    assert children() <= before


def test_a_dead_instance_says_so_again_and_closes(tmp_path):
    """Also to a reader that knows the last values."""
    one = IsolatedInstance(proportional(tmp_path, "Dies"), "one")
    one.initialize({}, 1.0)
    assert one.sample_time == 0.0
    first, second = one.reader(["u"]), one.reader(["u"])
    assert first() == [0.0]
    os.kill(one._process.pid, signal.SIGKILL)
    for read in (second, first, second):
        with pytest.raises(StepFailed, match=r"one \(Dies.fmu\) was ended by SIGKILL"):
            read()
    one.close()


def test_a_restored_state_goes_on_as_the_saved_one_and_a_failure_says_what_the_fmu_says(fmus):
    """As in this process, to the last bit."""
    courses = []
    for kind in (IsolatedInstance, FmuInstance):
        part = kind(fmus["pid_sampled"], "controller")
        assert part.can_save
        part.initialize({"Kp": 500.0}, 1.0)
        assert part.sample_time == 1e-3
        put, got = part.writer(["x", "v", "x_d"]), part.reader(["u"])
        course, states = [], []
        for k in (0, 1, 2, 3, 1, 2, 3, 0):
            if k < len(states):
                part.restore(states[k])
            states.append(part.save())
            put(np.array([0.01 * k, 0.1, 0.08]))
            part.step(k * 1e-3, 1e-3)
            course.append(got()[0])
        for state in states:
            part.release(state)
        assert course[1:4] == course[4:7]
        assert course[0] == course[7] != course[1]
        courses.append(course)
        part.close()
        refuses = kind(fmus["pid_sampled"], "controller")
        with pytest.raises(StepFailed) as failed:
            refuses.initialize({"sample_time": -1.0}, 1.0)
        courses[-1].append(str(failed.value))
        refuses.close()
    assert courses[0] == courses[1]
    assert "sample_time = -1" in courses[0][-1]


@pytest.fixture
def answering(monkeypatch):
    """``answering(answer)``: the other process gives this to every request, as it is."""
    with contextlib.ExitStack() as opened:

        def put(answer):
            def start(module, folder):
                ours, theirs = socket.socketpair()
                how = {"start_new_session": True, "stdout": subprocess.PIPE}
                process = subprocess.Popen(["sleep", "60"], **how)
                opened.callback(process.wait)
                opened.callback(process.kill)

                def serve():
                    with contextlib.suppress(OSError), theirs:
                        for _ in theirs.makefile("rb"):
                            for piece in answer:
                                theirs.sendall(piece)
                                time.sleep(0.3 * (len(answer) > 1))

                threading.Thread(target=serve, daemon=True).start()
                return ours, process, ours

            monkeypatch.setattr(isolated, "start_host", start)

        yield put


@pytest.mark.ci
@pytest.mark.parametrize(
    ("answer", "message"),
    [
        ([b'[1, "no licence"]\n'], "cannot be instantiated: no licence"),
        ([b"{}\n"], "gave an answer that is not understood"),
        ([b"\xff[0, 1]\n"], "gave an answer that is not understood"),
        ([b"[" * 100_000 + b"\n"], "gave an answer that is not understood"),
        ([*[b"a"] * 64], "did not answer the call open within 1 s"),
        ([b"[0, [1, 2, 3]]\n"], "gave no numbers for"),
        ([b'[0, "abc"]\n'], "gave no numbers for"),
    ],
)
def test_what_a_process_answers_is_not_believed(answer, message, tmp_path, answering, monkeypatch):
    monkeypatch.setattr(isolated, "_FAREWELL", 0.5)
    path = proportional(tmp_path, "Any")
    answering(answer)
    start = time.monotonic()
    with pytest.raises((FmuError, StepFailed), match=message):
        IsolatedInstance(path, "one", time_limit=1.0).initialize({}, 1.0)
    assert time.monotonic() - start < 5


@pytest.mark.parametrize(
    ("ours", "isolate", "kind"),
    [
        (True, None, FmuInstance),
        (True, True, IsolatedInstance),
        (False, None, IsolatedInstance),
        (False, False, FmuInstance),
    ],
)
def test_what_is_not_ours_has_a_process_of_its_own_unless_asked(
    ours, isolate, kind, fmus, tmp_path
):
    path = fmus["pid"] if ours else proportional(tmp_path, "Theirs")
    one = isolated.open_fmu(path, "one", isolate)
    one.initialize({}, 1.0)
    assert (type(one), one.sample_time) == (kind, 0.0)
    one.close()
