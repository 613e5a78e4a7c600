"""Hosts that take a variable for another type than it is: told, refused, and never ended."""

import json
import os
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path
from xml.etree import ElementTree as ET
from zipfile import ZipFile

import fmpy
import pytest
from fmpy.fmi3 import FMU3Slave

SUPPORT = str(Path(__file__).resolve().parents[1] / "support")
NUMBER_OF_NONE = 4_000_000

# in a process of its own, since the fault was that the process ended
HOST = """
    import json, sys
    sys.path.insert(0, sys.argv[2])
    from fmu_host import opened
    for call in json.loads(sys.argv[3]):
        slave, at = opened(sys.argv[1], {"u": 20.0}, name="axis", logged=True)
        slave.doStep(0.0, 1e-3)
        before = slave.getReal([at["x"], at["v"]])
        try:
            print("got", eval(call))
        except Exception as error:
            print("refused", str(error).split(":")[0].split(" with")[0])
        print("same" if slave.getReal([at["x"], at["v"]]) == before else "another")
        try:
            slave.doStep(1e-3, 1e-3)
            print("stepped")
        except Exception:
            print("stopped", slave.getString([at["message"]])[0].decode())
        slave.freeInstance()
"""


def told(path, calls):
    """What a host printed that made each call: the answer, whether x and v stayed, the next step.

    And everything that it heard.
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(HOST), path, SUPPORT, json.dumps(calls)],
        capture_output=True,
        text=True,
        env=os.environ,
        cwd=tempfile.gettempdir(),
    )
    assert done.returncode == 0, done.stderr
    heads = "got ", "refused ", "same", "another", "stepped", "stopped "
    lines = [line for line in done.stdout.splitlines() if line.startswith(heads)]
    return list(zip(*[iter(lines)] * 3, strict=True)), done.stdout + done.stderr


READS = [
    ("slave.getReal([at['x'], at['message']])[1]", "got nan", "message is a String, not a number"),
    (f"slave.getReal([{NUMBER_OF_NONE}])[0]", "got nan", f"value reference {NUMBER_OF_NONE}"),
    ("slave.getReal([0])[0]", "got nan", "value reference 0"),
    ("slave.getInteger([at['x']])[0]", "got 0", "Integers were given, but there are none"),
    ("slave.getBoolean([at['x']])[0]", "got 0", "Booleans were given, but there are none"),
    ("slave.getString([at['x']])[0]", "got b''", "no String has the value reference"),
]
WRITES = [
    ("slave.setReal([at['message']], [1.0])", "message cannot be set"),
    (f"slave.setReal([{NUMBER_OF_NONE}], [1.0])", f"value reference {NUMBER_OF_NONE}"),
    ("slave.setInteger([at['u']], [1])", "Integers were given, but there are none"),
    ("slave.setBoolean([at['u']], [True])", "Booleans were given, but there are none"),
    ("slave.setString([at['message']], ['all is well'])", "Strings that can be set were given"),
]


def test_a_readable_fmu_that_is_read_by_a_wrong_type_answers_nan_and_takes_no_further_step(fmus):
    """pythonfmu's getters have no status, so that the refusal comes with the next step."""
    answers, heard = told(fmus["plant"], [call for call, _, _ in READS])
    for (got, kept, step), (_, answer, said) in zip(answers, READS, strict=True):
        assert (got, kept) == (answer, "same")
        assert step.startswith("stopped axis: ")
        assert said in step
        assert heard.count(said) >= 2  # in the log as well


def test_a_readable_fmu_that_is_set_by_a_wrong_type_takes_no_further_step(fmus):
    answers, _ = told(fmus["plant"], [call for call, _ in WRITES])
    for (_, kept, step), (_, said) in zip(answers, WRITES, strict=True):
        assert kept == "same"
        assert step.startswith("stopped axis: ")
        assert said in step


def test_a_native_fmu_refuses_a_wrong_type_in_the_same_words_and_goes_on(native):
    asked = [*((call, said) for call, _, said in READS), *WRITES]
    answers, heard = told(native("plant"), [call for call, _ in asked])
    for (got, kept, step), (call, said) in zip(answers, asked, strict=True):
        assert got.startswith("refused"), call
        assert (kept, step) == ("same", "stepped")
        assert said in heard


def test_a_native_fmu_of_fmi_3_refuses_a_wrong_type_and_goes_on(native):
    path = native("plant", 3)
    description = fmpy.read_model_description(str(path))
    at = {v.name: v.valueReference for v in description.modelVariables}
    slave = FMU3Slave(
        guid=description.instantiationToken,
        unzipDirectory=fmpy.extract(str(path)),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="axis",
    )
    heard = []
    slave.instantiate(logMessage=lambda _e, _s, _c, text: heard.append(text.decode()))
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    for call, said in (
        (lambda: slave.getFloat64([at["message"]]), "message is a String, not a number"),
        (lambda: slave.getFloat64([NUMBER_OF_NONE]), str(NUMBER_OF_NONE)),
        (lambda: slave.getInt32([at["x"]]), "fmi3GetInt32"),
        (lambda: slave.getBoolean([at["x"]]), "fmi3GetBoolean"),
        (lambda: slave.getString([at["x"]]), "no String has the value reference"),
        (lambda: slave.setFloat64([at["message"]], [1.0]), "message cannot be set"),
        (lambda: slave.setString([at["message"]], ["all is well"]), "fmi3SetString"),
    ):
        with pytest.raises(Exception, match="fmi3"):
            call()
        assert said in heard[-1]
    slave.doStep(0.0, 1e-3)
    assert slave.getString([at["message"]]) == [""]
    slave.freeInstance()


@pytest.mark.parametrize("build", ["readable", "native 2", "native 3"])
@pytest.mark.parametrize("name", ["plant", "iol", "pid_sampled", "position_encoder"])
def test_every_output_is_a_number_and_the_message_is_a_local_string_without_a_start(
    fmus, native, name, build
):
    path = fmus[name] if build == "readable" else native(name, int(build[-1]))
    variables = {v.name: v for v in fmpy.read_model_description(str(path)).modelVariables}
    outputs = [v for v in variables.values() if v.causality == "output"]
    assert outputs
    assert {v.type for v in outputs} <= {"Real", "Float64"}
    message = variables["message"]
    found = [message.type, message.causality, message.variability, message.initial, message.start]
    assert found == ["String", "local", "discrete", "calculated", None]
    with ZipFile(path) as archive:
        structure = ET.fromstring(archive.read("modelDescription.xml")).find("ModelStructure")
    key = "index" if build != "native 3" else "valueReference"
    listed = {unknown.get(key) for unknown in structure.iter() if unknown is not structure}
    assert str(message.valueReference) not in listed  # references are indices, too


def test_a_message_that_is_an_output_as_earlier_versions_wrote_it_is_still_read(fmus, tmp_path):
    from ballscrew.fmus.reading import unpack

    fmu = unpack(fmus["plant"])
    reference = fmu.description.message_reference
    fmu.remove()
    assert reference is not None
    old = tmp_path / "old.fmu"
    with ZipFile(fmus["plant"]) as new, ZipFile(old, "w") as archive:
        for name in new.namelist():
            data = new.read(name)
            if name == "modelDescription.xml":
                root = ET.fromstring(data)
                (node,) = (v for v in root.iter("ScalarVariable") if v.get("name") == "message")
                node.set("causality", "output")
                node.set("initial", "exact")
                node.find("String").set("start", "")
                data = ET.tostring(root)
            archive.writestr(name, data)
    fmu = unpack(old)
    assert fmu.description.message_reference == reference
    fmu.remove()
