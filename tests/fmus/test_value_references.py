"""Value references count the variables: OMSimulator's FMI 3 import takes them for indices."""

import zipfile
from xml.etree import ElementTree as ET

import pytest
from exported_loops import IN_LOOPS

from ballscrew.fmus import catalogue
from ballscrew.fmus.native.export import write_native
from ballscrew.fmus.native.sources import catalogued_model

NAMES = [*catalogue.NAMES]
LOOPS = [f"{name}_loop" for name in IN_LOOPS]
TANGENTS = ["pid_variational"]


def described(path):
    """Root of the model description."""
    with zipfile.ZipFile(path) as archive:
        return ET.fromstring(archive.read("modelDescription.xml"))


def model_of(name):
    stem, _, kind = name.rpartition("_")
    if kind == "loop":
        return catalogued_model(stem, "plant")
    return catalogued_model(stem, tangents=1) if kind == "variational" else catalogued_model(name)


def references(root):
    return [int(v.get("valueReference")) for v in root.find("ModelVariables")]


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", [*NAMES, *LOOPS, *TANGENTS])
def test_native_fmus_count_their_variables_from_one(name, fmi, tmp_path):
    path = write_native(model_of(name), tmp_path / "a.fmu", fmi, platforms=()).path
    root = described(path)
    found = references(root)
    assert found == list(range(1, len(found) + 1))
    variables = list(root.find("ModelVariables"))
    # as OMSimulator reads FMI 3.0: the variable of number `derivative`, counted from 1
    for v in variables if fmi == 3 else ():
        if v.get("derivative"):
            state = variables[int(v.get("derivative")) - 1].get("name")
            assert v.get("name") == f"der({state})"
    outputs = [v.get("name") for v in variables if v.get("causality") == "output"]
    listed = root.find("ModelStructure")
    unknowns = listed.iterfind("Outputs/Unknown") if fmi == 2 else listed.iterfind("Output")
    key = "index" if fmi == 2 else "valueReference"
    assert [variables[int(u.get(key)) - 1].get("name") for u in unknowns] == outputs


@pytest.mark.parametrize("name", [*NAMES, "nctf_loop", *TANGENTS])
def test_pythonfmu_s_fmus_count_theirs_in_the_same_way(name, tmp_path):
    stem, _, kind = name.rpartition("_")
    if kind == "loop":
        path = catalogue.fmu(stem, "plant")
    elif kind == "variational":
        path = catalogue.fmu(stem, tangents=1)
    else:
        path = catalogue.fmu(name)
    found = references(described(path))
    assert found == list(range(1, len(found) + 1))
    native = write_native(model_of(name), tmp_path / "a.fmu", 2, platforms=()).path
    names = [[v.get("name") for v in described(p).find("ModelVariables")] for p in (path, native)]
    assert names[1][: len(found)] == names[0]
