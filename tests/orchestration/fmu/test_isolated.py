"""Third-party FMUs in processes of their own: crashes, hangs, clashes, and how all of them end."""

import contextlib
import csv
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import small_fmus
from third_party_fmus import proportional
from waiting import wait_for

from ballscrew.cli import main
from ballscrew.fmus.made_here import is_ours
from ballscrew.orchestration.fmu import isolated
from ballscrew.orchestration.fmu.fmu_instance import FmuInstance, StepFailed
from ballscrew.orchestration.fmu.isolated import IsolatedInstance
from ballscrew.orchestration.fmu.operating_system import can_supervise
from ballscrew.orchestration.loop.catalogue import fmu
from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.solver.errors import FmuError

SEGFAULT = "import ctypes; ctypes.string_at(0)"


def run(path, out, *more):
    asked = ["run", "--controller", path, "--stop", "0.1", "--step", "1e-3", "--out", out, *more]
    return main([*map(str, asked)])


@pytest.mark.parametrize(
    ("in_step", "words"),
    [
        (f"if current_time > 0.05: {SEGFAULT}", "was ended by SIGSEGV"),
        pytest.param(
            "while current_time > 0.05: pass",
            "did not answer the call step within 2 s",
            marks=pytest.mark.ci,
        ),
    ],
)
def test_a_crash_or_hang_ends_the_run_with_a_line_and_what_was_computed(
    tmp_path, capsys, in_step, words
):
    path = proportional(tmp_path, "Fails", in_step=in_step)
    start = time.monotonic()
    assert run(path, tmp_path / "out", "--time-limit", "2") == 1
    assert time.monotonic() - start < 30
    said = capsys.readouterr().err
    assert "Traceback" not in said
    assert f"controller (Fails.fmu) {words}" in said.splitlines()[0]
    with (tmp_path / "out" / "trajectory.csv").open() as stream:
        times = [float(row["time"]) for row in csv.DictReader(stream)]
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(0.05, abs=2e-3)
    assert (tmp_path / "out" / "metrics.json").is_file()


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


def test_why_an_fmu_is_not_instantiated_is_told_in_its_own_words(tmp_path):
    missing = "ModuleNotFoundError: No module named 'zmq'"
    says = f'fprintf(stderr,"Traceback\\n{missing}\\n");return 0;'
    small_fmus.pd(str(tmp_path / "pd.fmu"), inst=says)
    with pytest.raises(FmuError, match=missing):
        IsolatedInstance(tmp_path / "pd.fmu", "controller")


@pytest.mark.ci
def test_an_fmu_that_prints_without_end_fills_no_disk_and_goes_on(tmp_path):
    """Four megabytes: none of it lies in a file."""
    line = "x" * 1000
    small_fmus.pd(str(tmp_path / "pd.fmu"), step=f'for(int k=0;k<4000;k++)puts("{line}");')
    with contextlib.closing(IsolatedInstance(tmp_path / "pd.fmu", "controller")) as part:
        part.initialize({}, 1.0)
        part.step(0.0, 1e-3)
        assert part.reader(["u"])() == [0.0]
        files = [os.readlink(f"/proc/{part._process.pid}/fd/{n}") for n in (1, 2)]
    assert all(name.startswith("pipe:") for name in files)


@pytest.mark.ci
def test_two_fmus_with_a_module_called_plant_each_run_their_own(tmp_path, monkeypatch):
    """One interpreter would give the second the first one's module, or the user's own."""
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "plant.py").write_text("raise ImportError('the plant.py of the user')")
    monkeypatch.chdir(tmp_path / "here")
    for gain in (1.0, 0.5):
        path = proportional(
            tmp_path / str(gain),
            f"Gain{int(10 * gain)}",
            head="import plant\n",
            in_step="self.x_d = plant.GAIN * self.x_d",
            modules={"plant": f"GAIN = {gain}\n"},
        )
        found = run_closed_loop(Loop(str(path), stop=0.02, step=1e-3)).run.commands["u"]
        np.testing.assert_allclose(found[0], 400 * 0.08 * gain, rtol=1e-12)


@pytest.mark.skipif(not can_supervise(), reason="only Linux has that process")
def test_an_instance_opens_also_if_the_process_that_starts_them_was_ended(tmp_path):
    small_fmus.pd(str(tmp_path / "pd.fmu"))
    with contextlib.closing(IsolatedInstance(tmp_path / "pd.fmu", "before")) as before:
        before.initialize({}, 1.0)
        status = Path(f"/proc/{before._process.pid}/stat").read_text(encoding="utf-8")
        os.kill(int(status.rpartition(")")[2].split()[1]), signal.SIGKILL)
        with contextlib.closing(IsolatedInstance(tmp_path / "pd.fmu", "after")) as after:
            after.initialize({}, 1.0)
            assert after.reader(["u"])() == before.reader(["u"])() == [0.0]


@pytest.mark.ci
def test_no_process_outlives_its_instance_nor_a_failed_opening(tmp_path):
    def started(process):
        own = Path(f"/proc/{process}/task/{process}/children").read_text(encoding="utf-8").split()
        return {*own}.union(*map(started, own))

    IsolatedInstance(fmu("pid"), "first").close()
    before = started(os.getpid())  # among them the process that starts the others
    one = IsolatedInstance(fmu("pid"), "one")
    assert len(started(os.getpid()) - before) == 1
    one.close()
    one.close()
    hang = proportional(tmp_path, "Sleeper", at_start="import time; time.sleep(1000)")
    with pytest.raises(FmuError, match="within 1 s"):
        IsolatedInstance(hang, "two", time_limit=1.0)
    assert started(os.getpid()) <= before


def test_a_dead_instance_says_so_again_and_closes(tmp_path):
    """Also to a reader that knows the last values."""
    one = IsolatedInstance(proportional(tmp_path, "Dies"), "one")
    one.initialize({}, 1.0)
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
        part.initialize({"Kp": 500.0}, 1.0)
        assert part.sample_time == 1e-3
        put, got = part.writer(["x", "v", "x_d"]), part.reader(["u"])
        course, states = [], []
        for k in (0, 1, 2, 3, 3, 1, 2, 3, 0):  # after 3, the same inputs once more
            if k < len(states):
                part.restore(states[k])
            states.append(part.save())
            put(np.array([0.01 * k, 0.1, 0.08]))
            part.step(k * 1e-3, 1e-3)
            course.append(got()[0])
        part.close()
        assert course[1:4] == course[5:8]
        assert course[0] == course[8] != course[1]
        refuses = kind(fmus["pid_sampled"], "controller")
        with pytest.raises(StepFailed, match="sample_time = -1") as failed:
            refuses.initialize({"sample_time": -1.0}, 1.0)
        refuses.close()
        courses.append([*course, str(failed.value)])
    assert courses[0] == courses[1]


ANSWERING = """
import os, time


def answer(*pieces):
    for number in os.listdir("/proc/self/fd"):
        if "socket:" in os.path.realpath(f"/proc/self/fd/{number}"):
            for piece in pieces:
                os.write(int(number), piece)
                time.sleep(0.3 * (len(pieces) > 1))
"""


@pytest.mark.ci
@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (r"""b'[1, "no licence"]\n'""", "no licence"),
        (r"b'\xff[0, 1]\n'", "gave an answer that is not understood"),
        (r"b'[' * 100_000 + b'\n'", "gave an answer that is not understood"),
        ("*[b'a'] * 64", "did not answer the call open within 1 s"),
    ],
)
def test_what_a_process_says_when_it_is_opened_is_not_believed(answer, message, tmp_path):
    path = proportional(tmp_path, "Any", head=ANSWERING, at_start=f"answer({answer})")
    start = time.monotonic()
    with pytest.raises(FmuError, match=message):
        IsolatedInstance(path, "one", time_limit=1.0)
    assert time.monotonic() - start < 5


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        ("bytes(64)", "gave an answer that is not understood"),
        (r"b'[0, [1, 2]]\n'", "gave an answer that is not understood"),
        ("*[b'a'] * 15", "did not answer the call step within 1 s"),
    ],
)
def test_numbers_that_were_not_asked_for_are_not_believed_in_a_run(answer, message, tmp_path):
    step = f"if current_time > 0.05: answer({answer})"
    path = proportional(tmp_path, "Any", head=ANSWERING, in_step=step)
    run = run_closed_loop(Loop(str(path), stop=0.1, step=1e-3, time_limit=1.0)).run
    assert f"Any.fmu) {message}" in run.stopped
    assert run.time[-1] == pytest.approx(0.05, abs=2e-3)


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
    """What is ours is known by its content: one byte more, and it is somebody else's."""
    path = tmp_path / "anything.fmu"
    path.write_bytes(fmus["pid"].read_bytes() + b" " * (not ours))
    assert is_ours(path) == ours
    one = isolated.open_fmu(path, "one", isolate)
    assert type(one) is kind
    one.close()


PARENT_OF_A_THIRD_PARTY_FMU = """
import sys
from ballscrew.orchestration.fmu.isolated import IsolatedInstance
one = IsolatedInstance(sys.argv[1], "one")
one.initialize({}, 1.0)
one.step(0.0, 1.0)
one.reader(["u"])()
"""


def lives(process):
    with contextlib.suppress(FileNotFoundError):
        state = Path(f"/proc/{process}/stat").read_text(encoding="utf-8")
        return state.rpartition(")")[2].split()[0] != "Z"
    return False


def test_a_hanging_fmu_and_what_it_started_end_with_the_master(tmp_path):
    pids = tmp_path / "pids"
    hang = proportional(
        tmp_path,
        "Hang",
        head="import ctypes, os, pathlib, subprocess\n",
        in_step="started = subprocess.Popen(['sleep', '300'])\n"
        f"        pathlib.Path({str(pids)!r}).write_text(f'{{os.getpid()}} {{started.pid}} ')\n"
        "        ctypes.PyDLL(None).sleep(300)",
    )
    command = [sys.executable, "-c", PARENT_OF_A_THIRD_PARTY_FMU, str(hang)]
    with subprocess.Popen(command, cwd=tmp_path) as master:
        wait_for(lambda: pids.is_file() and pids.read_text().endswith(" "), 60.0, master)
        both = pids.read_text().split()
        assert all(map(lives, both))
        os.kill(master.pid, signal.SIGKILL)
        master.wait(10)
        wait_for(lambda: not any(map(lives, both)), 5.0)


@pytest.mark.parametrize("how", ["--isolate", pytest.param("--no-isolate", marks=pytest.mark.ci)])
def test_what_an_fmu_has_started_ends_with_the_command(tmp_path, how):
    """Also a child that left its process group."""
    pid = tmp_path / "pid"
    starts = proportional(
        tmp_path,
        "Starts",
        head="import pathlib, subprocess\n",
        in_step=f"path = pathlib.Path({str(pid)!r})\n        if not path.exists():\n"
        "            child = subprocess.Popen(['sleep', '300'], start_new_session=True)\n"
        "            path.write_text(str(child.pid))",
    )
    words = ["run", how, "--controller", starts, "--stop", "0.005", "--step", "1e-3", "--out"]
    command = [sys.executable, "-m", "ballscrew", *words, tmp_path / "out"]
    subprocess.run(command, cwd=tmp_path, capture_output=True, check=False)
    assert not lives(int(pid.read_text()))
