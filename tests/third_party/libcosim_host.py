"""Run a loop in libcosim, through its Python API."""

import json
import sys
import time
from pathlib import Path

from libcosimpy.CosimEnums import CosimVariableType
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave


def main(job, result):
    log_output_level(CosimLogLevel.WARNING)
    execution = CosimExecution.from_step_size(round(job["step"] * 1e9))
    slaves = [CosimLocalSlave(path, name) for name, path in job["fmus"].items()]
    index = {n: execution.add_local_slave(s) for n, s in zip(job["fmus"], slaves, strict=True)}
    real = CosimVariableType.REAL.value
    references = {
        (name, v.name.decode()): (i, v.reference)
        for name, i in index.items()
        for v in execution.slave_variables(i)
        if v.type == real
    }
    for name, variable, value in job["starts"]:
        done(execution.real_initial_value(*references[name, variable], value))
    for source, sink in job["connections"]:
        ends = (*references[tuple(source)], *references[tuple(sink)])
        done(execution.connect_real_variables(*ends) == 0)
    if job.get("timed"):
        done(execution.step(1))
        start = time.perf_counter()
        done(execution.step(job["steps"]))
        return result(1e6 * (time.perf_counter() - start) / job["steps"])
    observer = CosimObserver.create_last_value()
    done(execution.add_observer(observer))
    wanted = [references["plant", name][1] for name in job["outputs"]]
    rows = []
    for _ in range(job["steps"]):
        rows.append(list(observer.last_real_values(index["plant"], wanted)))
        done(execution.step(1))
    rows.append(list(observer.last_real_values(index["plant"], wanted)))
    return result(rows)


def done(success):
    if not success:
        raise SystemExit("libcosim refuses; see its log")


main(
    json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")),
    lambda data: Path(sys.argv[2]).write_text(json.dumps(data), encoding="utf-8"),
)
