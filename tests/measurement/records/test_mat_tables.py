"""MAT-files of any version, and what Simulink, dSPACE, Dymola and OpenModelica make of them."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
import scipy.io

from ballscrew.measurement.records.reading import read_drive_records
from ballscrew.measurement.records.table import read_tables

TIME = np.arange(0.0, 2.0, 1e-3)
X, U = 0.1 * np.sin(3 * TIME), 3 * np.sin(5 * TIME)


def is_given(path, mapping=None, units=None):
    (record,) = read_drive_records([path], mapping, units)
    np.testing.assert_allclose(record.time, TIME, atol=1e-9)
    np.testing.assert_allclose(record.x, X, atol=1e-9)
    np.testing.assert_allclose(record.u, U, atol=1e-9)
    return record


def mat(folder, **values):
    path = folder / "a.mat"
    scipy.io.savemat(path, values)
    return path


def chars(file, name, text):
    item = file.create_dataset(name, data=np.array(list(map(ord, text)), dtype="u2")[:, None])
    item.attrs["MATLAB_class"] = np.bytes_("char")
    return item


def mat73(path, fill):
    """A file as MATLAB lays it out: HDF5 behind a header of 512 bytes, arrays transposed."""
    with h5py.File(path, "w", userblock_size=512) as file:
        fill(file)
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\0\2IM"
    with path.open("r+b") as stream:
        stream.write(head)
    return path


@pytest.mark.parametrize("form", ["4", "5"])
def test_vectors_are_columns_by_their_names(tmp_path, form):
    path = tmp_path / "record"
    scipy.io.savemat(path, {"time": TIME, "x": X, "u": U}, format=form, appendmat=False)
    is_given(path)


def test_a_structure_with_time_has_its_labels(tmp_path):
    one = {"values": np.column_stack([X, U]), "dimensions": 2.0, "label": "both"}
    path = mat(tmp_path, out={"time": TIME, "signals": one})
    is_given(path, {"both.1": "x", "both.2": "u"}, {"x": "m", "u": "V"})


def test_dspace_units_and_axes_are_taken(tmp_path):
    signals = [
        {"Name": "Pos", "Data": 1e3 * X, "Unit": "mm", "XIndex": 1.0},
        {"Name": "U", "Data": U, "Unit": "V", "XIndex": 1.0},
        {"Name": "Temp", "Data": U[::100], "Unit": "degC", "XIndex": 2.0},
    ]
    axes = [{"Data": TIME}, {"Data": TIME[::100]}]
    path = mat(tmp_path, rec={"X": axes, "Y": signals, "Description": "d"})
    record = is_given(path, {"Pos": "x", "U": "u", "Temp": "temperature"})
    assert np.isfinite(record.signals["temperature"]).sum() == 20


def rows_of(texts):
    width = max(map(len, texts))
    return np.array([list(t.ljust(width)) for t in texts])


@pytest.mark.parametrize("turned", [True, False])
def test_results_of_modelica_have_signs_aliases_and_units(tmp_path, turned):
    names = ["time", "axis.s", "axis.back", "motor.v", "axis.m", "axis.v"]
    texts = ["Time [s]", "Position [mm|m]", "Its mirror", "Voltage [V]", "Mass [kg]", "Speed [m/s]"]
    info = np.array([[0, 1], [2, 2], [2, -2], [2, 3], [1, 2], [2, 3]], dtype="i4")
    info = np.column_stack([info, np.zeros(6, "i4"), -np.ones(6, "i4")])
    data = np.column_stack([TIME, 1e3 * X, U])
    constant = np.array([[0.0, 5.0], [2.0, 5.0]])
    kind = "binTrans" if turned else "binNormal"
    given = {"Aclass": rows_of(["Atrajectory", "1.1", "", kind])}
    matrices = {"name": rows_of(names), "description": rows_of(texts), "dataInfo": info}
    matrices |= {"data_1": constant, "data_2": data}
    given |= {n: v.T if turned else v for n, v in matrices.items()}
    for name, values in given.items():
        if values.dtype.kind == "U":
            given[name] = np.array(["".join(row) for row in values])
    path = tmp_path / "dsres.mat"
    scipy.io.savemat(path, given, format="4")
    record = is_given(path, {"axis.s": "x", "motor.v": "u"})
    (table,) = read_tables(path)
    assert table.units == {"time": "s", "axis.s": "mm", "motor.v": "V", "axis.v": "m/s"}
    np.testing.assert_allclose(table.columns["axis.back"], -1e3 * record.x, atol=1e-9)


def test_version_7_3_has_vectors_matrices_and_structures(tmp_path):
    def vectors(file):
        for name, values in (("time", TIME), ("x", X), ("u", U)):
            file.create_dataset(name, data=values[None]).attrs["MATLAB_class"] = np.bytes_("double")

    def matrix(file):
        file.create_dataset("ans", data=np.column_stack([TIME, X, U]))

    def scope(file):
        top = file.create_group("Scope")
        top.create_dataset("time", data=TIME[None])
        signals, refs = top.create_group("signals"), file.create_group("#refs#")
        for field in ("values", "label"):
            made = []
            for name, values in (("x", X), ("u", U)):
                if field == "label":
                    made.append(chars(refs, f"{field}{name}", name).ref)
                else:
                    made.append(refs.create_dataset(f"{field}{name}", data=values[None]).ref)
            signals.create_dataset(field, data=np.array(made, dtype=h5py.ref_dtype)[:, None])

    is_given(mat73(tmp_path / "a.mat", vectors))
    names, units = {"ans.1": "time", "ans.2": "x", "ans.3": "u"}, {"time": "s", "x": "m", "u": "V"}
    is_given(mat73(tmp_path / "b.mat", matrix), names, units)
    is_given(mat73(tmp_path / "c.mat", scope))
