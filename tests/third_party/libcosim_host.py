"""Run a loop in libcosim, through its Python API."""

from job import JOB, answer, answer_with_time
from libcosimpy.CosimEnums import CosimVariableType
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave


def done(success):
    if not success:
        raise SystemExit("libcosim refuses; see its log")


log_output_level(CosimLogLevel.WARNING)
execution = CosimExecution.from_step_size(round(JOB["step"] * 1e9))
slaves = [CosimLocalSlave(path, name) for name, path in JOB["fmus"].items()]
index = {n: execution.add_local_slave(s) for n, s in zip(JOB["fmus"], slaves, strict=True)}
references = {
    (name, v.name.decode()): (i, v.reference)
    for name, i in index.items()
    for v in execution.slave_variables(i)
    if v.type == CosimVariableType.REAL.value
}
for name, variable, value in JOB["starts"]:
    done(execution.real_initial_value(*references[name, variable], value))
for source, sink in JOB["connections"]:
    ends = (*references[tuple(source)], *references[tuple(sink)])
    done(execution.connect_real_variables(*ends) == 0)
if JOB.get("timed"):
    done(execution.step(1))
    answer_with_time(lambda steps: done(execution.step(steps)))
else:
    observer = CosimObserver.create_last_value()
    done(execution.add_observer(observer))
    wanted = [references["plant", name][1] for name in JOB["outputs"]]
    rows = [list(observer.last_real_values(index["plant"], wanted))]
    for _ in range(JOB["steps"]):
        done(execution.step(1))
        rows.append(list(observer.last_real_values(index["plant"], wanted)))
    answer(rows)
