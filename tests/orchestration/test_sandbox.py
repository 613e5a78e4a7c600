"""What a hostile FMU can do without a sandbox, it cannot do in one; and the run is the same."""

import csv
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hostile_fmu import EVERYTHING, needs_sandbox, processes_with, world
from third_party_fmus import proportional
from waiting import wait_for

from ballscrew.cli import main
from ballscrew.fmus import sandbox
from ballscrew.orchestration import isolated
from ballscrew.orchestration.fmu_instance import StepFailed
from ballscrew.orchestration.isolated import IsolatedInstance
from ballscrew.orchestration.loop import Loop

ACT = "hostile.act()"
REPORT = "print(*hostile.act(), flush=True); import os; os._exit(3)"


@pytest.fixture
def user(tmp_path, monkeypatch):
    with world(tmp_path, monkeypatch) as made:
        yield made


def run(path, out, *more):
    asked = ["run", "--controller", path, "--stop", "0.005", "--step", "1e-4", "--out", out, *more]
    return main(list(map(str, asked)))


def rows(out):
    with (out / "trajectory.csv").open() as stream:
        return list(csv.DictReader(stream))


def last_words(path, **how):
    """What an FMU says in its first step, which ends it."""
    one = IsolatedInstance(path, "one", **how)
    one.initialize({}, 1.0)
    one.step(0.0, 1e-3)
    with pytest.raises(StepFailed) as ended:
        one.reader(["u"])()
    one.close()
    assert "ended with exit code 3" in str(ended.value)
    return str(ended.value).partition("its last output: ")[2]


def test_without_a_sandbox_a_hostile_fmu_does_all_that_its_user_can(user):
    out = user.folders["out"]
    assert run(user.hostile(ACT), out) == 0
    assert user.harm() == {"tells", "kills", "home", "out", "here", "temporary"}
    done = set(last_words(user.hostile(REPORT, "Reports")).split())
    assert done >= EVERYTHING - {"kills"}  # nobody is left for that


def test_in_a_sandbox_it_does_nothing_and_the_run_is_the_same(user):
    needs_sandbox()
    out = user.folders["out"]
    assert run(user.hostile(ACT), out, "--sandbox") == 0
    found = rows(out)
    assert user.harm() == set()
    assert last_words(user.hostile(REPORT, "Reports"), sandbox=True) == ""
    innocent = out.with_name("innocent")
    assert run(user.hostile("pass", "Innocent"), innocent) == 0
    assert rows(innocent) == found


KNOWN = sorted({*sandbox._VARIABLES, "PWD", "SYMPY_CACHE_SIZE"})  # the last are made within
SEES = (
    "{'run', 'var', 'sys', 'home'}.isdisjoint(os.listdir('/'))",
    "{'passwd', 'shadow', 'hosts', 'hostname'}.isdisjoint(os.listdir('/etc'))",
    f"set(os.environ) <= set({KNOWN})",
    "os.getcwd() == '/tmp' and not any('ballscrew' in n for n in os.listdir('/tmp'))",
    "{x.split()[1] for x in open('/proc/self/status') if x[:3] == 'Cap'} == {16 * '0'}",
    "sum(p.isdigit() for p in os.listdir('/proc')) <= 2",  # bubblewrap and itself
)


@pytest.mark.parametrize("what", SEES)
def test_it_sees_the_system_and_itself(what, user):
    needs_sandbox()
    path = user.hostile(f"import os; print({what}, flush=True); os._exit(3)", "Sees")
    assert last_words(path, sandbox=True) == "True"
    if os.getuid() == 0 or "Cap" not in what:  # others have none anyway
        assert last_words(path) == "False"


WRITES = (
    "import os, pathlib; done = []\n"
    "        for place in ('/', '/tmp', '/fmu', '/usr', '/dev', '/dev/shm', '/etc', "
    "'/proc/sys/kernel', "
    "os.path.dirname(os.__file__), os.path.dirname(hostile.__file__)):\n"
    "            try:\n"
    "                pathlib.Path(place, 'new').write_text('x'); done.append(place)\n"
    "            except OSError: pass\n"
    "        print(*done, flush=True); os._exit(3)"
)


def test_it_writes_into_one_folder(user):
    needs_sandbox()
    assert last_words(user.hostile(WRITES, "Writes"), sandbox=True) == "/tmp"


def test_crashes_and_hangs_end_as_without_a_sandbox(tmp_path, capsys):
    needs_sandbox()
    segfault = "import ctypes; ctypes.string_at(0)"
    crash = proportional(tmp_path, "Crash", in_step=f"if current_time > 0.002: {segfault}")
    assert run(crash, tmp_path / "out", "--sandbox") == 1
    assert "controller (Crash.fmu) was ended by SIGSEGV" in capsys.readouterr().err
    hang = proportional(tmp_path, "Hang", in_step="while current_time > 0.002: pass")
    start = time.monotonic()
    assert run(hang, tmp_path / "out", "--sandbox", "--time-limit", "2") == 1
    assert time.monotonic() - start < 30
    assert "(Hang.fmu) did not answer the call step within 2 s" in capsys.readouterr().err


LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))
from ballscrew.cli import main
sys.exit(main(sys.argv[1:]))
"""


def test_a_limit_of_memory_holds_within(tmp_path):
    needs_sandbox()
    text = "import resource; 1 / (resource.getrlimit(resource.RLIMIT_AS)[0] - (3 << 30))"
    path = proportional(tmp_path, "Limited", in_step=text)
    asked = ["run", "--controller", path, "--stop", "0.02", "--step", "1e-3", "--sandbox", "--out"]
    asked = [sys.executable, "-P", "-c", LIMITED, *asked, tmp_path / "out"]
    done = subprocess.run(list(map(str, asked)), capture_output=True, text=True)
    assert "division by zero" in done.stderr


STARTS = "import subprocess; subprocess.Popen(['sleep', '{}'], start_new_session=True)"
PARENT = """
import sys
from ballscrew.orchestration.isolated import IsolatedInstance
one = IsolatedInstance(sys.argv[1], "one", sandbox=True)
print("open", flush=True)
sys.stdin.read()
"""


def test_what_it_starts_ends_with_it_and_with_the_master(tmp_path):
    needs_sandbox()
    number = f"300.{os.getpid()}"
    path = proportional(tmp_path, "Starts", at_start=STARTS.format(number))
    scratch = set(Path(os.environ["TMPDIR"]).glob("ballscrew-scratch-*"))
    one = IsolatedInstance(path, "one", sandbox=True)
    wait_for(lambda: processes_with(number))  # /proc shows it a little later than its start
    one.close()
    wait_for(lambda: not processes_with(number))
    assert set(Path(os.environ["TMPDIR"]).glob("ballscrew-scratch-*")) == scratch
    asked = [sys.executable, "-P", "-c", PARENT, str(path)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(asked, **pipes) as parent:
        assert parent.stdout.readline() == b"open\n"
        wait_for(lambda: processes_with(number))
        parent.send_signal(signal.SIGKILL)
        parent.wait(10)
        wait_for(lambda: not processes_with(number))


def test_a_scratch_folder_is_removed_whatever_was_left_there(tmp_path):
    needs_sandbox()
    outside = tmp_path / "outside"
    outside.mkdir(mode=0o500)
    leaves = (
        "import os; os.makedirs('a/b'); open('a/b/c', 'w').close(); "
        f"os.symlink({str(outside)!r}, 'a/link'); os.chmod('a/b', 0); os.chmod('a', 0)"
    )
    before = set(Path(os.environ["TMPDIR"]).iterdir())
    IsolatedInstance(proportional(tmp_path, "Leaves", at_start=leaves), "x", sandbox=True).close()
    assert set(Path(os.environ["TMPDIR"]).iterdir()) == before
    assert outside.stat().st_mode & 0o777 == 0o500


@pytest.fixture
def fake(tmp_path, monkeypatch):
    """``fake(text)``: a program called bwrap of this text is the one that is found."""

    def put(text):
        folder = tmp_path / "bin"
        folder.mkdir()
        (folder / "bwrap").write_text(f"#!/bin/sh\n{text}\n")
        (folder / "bwrap").chmod(0o755)
        monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
        return folder

    return put


EXEC = 'while [ "$1" != -- ]; do shift; done; shift; exec "$@"'


def refused(capsys, folder, message, *more):
    path = proportional(folder, "Any")
    assert run(path, folder / "out", "--sandbox", *more) == 2
    heard = capsys.readouterr().err
    assert message in heard
    assert heard.count("\n") == 1
    assert not (folder / "out" / "trajectory.csv").exists()


def test_a_program_that_only_claims_to_be_bubblewrap_is_refused(tmp_path, capsys, fake):
    fake(EXEC)
    message = "could read a file outside of it, write one there, open a connection"
    refused(capsys, tmp_path, message)


def test_a_system_that_makes_no_sandbox_is_told_in_its_words(tmp_path, capsys, fake):
    fake("echo 'bwrap: No permissions to create new namespace' >&2; exit 1")
    refused(capsys, tmp_path, "says 'bwrap: No permissions to create new namespace'")


def test_without_bubblewrap_the_line_says_what_to_install(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(sandbox.shutil, "which", lambda name: None)
    refused(capsys, tmp_path, "bwrap (bubblewrap) was not found; install it, as by `apt install")


def test_beyond_linux_it_is_refused(tmp_path, capsys, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(sandbox.sys, "platform", "darwin")
        with pytest.raises(sandbox.NoSandbox, match="bubblewrap is for Linux, and this is darwin"):
            Loop("pid", stop=0.1, sandbox=True)


def test_a_home_that_would_be_seen_with_python_is_refused(tmp_path, capsys, monkeypatch):
    if sys.prefix == "/usr":
        pytest.skip("needs a Python that is not the system's own")
    monkeypatch.setenv("HOME", sys.prefix)
    refused(capsys, tmp_path, f"lies in {sys.prefix}, which holds the home folder")


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--no-isolate"], "--sandbox is for FMUs in their own process; see --no-isolate"),
        (["--coupling", "monolithic"], "--sandbox is for FMUs, and --coupling monolithic uses"),
    ],
)
def test_where_fmus_are_run_in_this_process_it_is_refused(tmp_path, capsys, more, message):
    refused(capsys, tmp_path, message, *more)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ("run --controller pid", "all parts here are this program's own"),
        ("swap --controllers pid iol", "all parts here are this program's own"),
        ("lyapunov --controller pid", "--sandbox is for --via fmu"),
        ("lyapunov --controller pid --via fmu", "all parts here are this program's own"),
        ("map --controller pid --x Kp=1:2:2 --y Kd=1:2:2", "--sandbox is for --via fmu"),
    ],
)
def test_where_there_is_no_file_to_protect_from_it_is_refused(tmp_path, capsys, asked, message):
    needs_sandbox()
    assert main([*asked.split(), "--sandbox", "--out", str(tmp_path / "out")]) == 2
    heard = capsys.readouterr().err
    assert message in heard
    assert heard.count("\n") == 1


@pytest.mark.parametrize("given", [{"isolate": False}, {"coupling": "monolithic"}])
def test_a_loop_in_this_process_has_no_sandbox(given):
    with pytest.raises(ValueError, match="a sandbox is for FMUs in processes of their own"):
        Loop("pid", stop=0.1, sandbox=True, **given)


def test_all_that_is_asked_of_bubblewrap(tmp_path, fake):
    """Also where it cannot run: the words it gets, by a program that writes them down."""
    folder = fake('printf \'%s\\n\' "$@" > "$(dirname "$0")/words"; exit 0')
    scratch, unpacked = tmp_path / "scratch", tmp_path / "unpacked"
    words = sandbox.command(scratch, unpacked)
    tried = (folder / "words").read_text().splitlines()
    for given in (words, tried):
        whole = " ".join(given)
        for word in "--unshare-all --die-with-parent --new-session --clearenv".split():
            assert word in given
        for part in ("--cap-drop ALL", "--remount-ro /", "--chdir /tmp", "--proc /proc"):
            assert f" {part} " in whole
        assert given.count("--bind") == 1
        assert given[given.index("--bind") + 2] == "/tmp"
        assert {w for w in given if "bind" in w} == {"--bind", "--ro-bind", "--ro-bind-try"}
        seen = {given[k + 1] for k, word in enumerate(given) if word.startswith("--ro-bind")}
        assert not {"/", "/home", "/root", "/etc", "/run", "/var", str(tmp_path)} & seen
    assert words[words.index("--bind") + 1] == str(scratch)
    at = words.index(str(unpacked))
    assert words[at - 1 : at + 2] == ["--ro-bind", str(unpacked), "/fmu"]


@pytest.mark.parametrize(
    "asked",
    [
        "run --controller FMU --step 1e-3",
        "run --controller pid --isolate --step 1e-3",
        "run --system SSP --step 1e-3",
        "swap --controllers pid FMU --step 1e-3",
        "lyapunov --controller FMU --via fmu",
    ],
)
def test_each_command_runs_all_files_in_it(asked, tmp_path, monkeypatch, native):
    needs_sandbox()
    assert main(["export", "--ssp", "--only", "pid", "--out", str(tmp_path)]) == 0
    (ssp,) = tmp_path.rglob("*.ssp")
    starts = []

    def started(module, folder, prints, before=(), start=isolated.start_host):
        starts.append(bool(before))
        return start(module, folder, prints, before)

    monkeypatch.setattr(isolated, "start_host", started)
    asked = asked.replace("FMU", str(native("pid"))).replace("SSP", str(ssp))
    options = ["--sandbox", "--stop", "0.01", "--out", str(tmp_path / "out")]
    assert main([*asked.split(), *options]) in (0, 1)
    assert len(starts) > (" pid " in asked and "--isolate" in asked) + ("SSP" in asked)
    assert all(starts)
