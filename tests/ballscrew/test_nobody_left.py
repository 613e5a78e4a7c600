"""A command that is killed leaves no process behind."""

import signal

import pytest
from long_commands import COMMANDS, WITH_CHILDREN, Command, write_data


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    write_data(folder)
    return folder


@pytest.mark.parametrize("name", COMMANDS)
def test_five_seconds_after_a_kill_no_process_of_a_command_lives(name, data, tmp_path):
    command = Command(name, data, tmp_path / "out")
    command.wait_until_busy(1.2, children=3 if name in WITH_CHILDREN else 1)
    command.process.send_signal(signal.SIGKILL)
    command.process.communicate(timeout=10)
    assert command.left_after(5.0) == {}
