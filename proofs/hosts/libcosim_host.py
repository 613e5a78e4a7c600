"""libcosim through libcosimpy: its fixed-step algorithm."""

from host import GOAL, answer, steps
from libcosimpy.CosimEnums import CosimVariableType
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave


def run(job):
    execution = CosimExecution.from_step_size(round(job["step"] * 1e9))
    slaves = [CosimLocalSlave(path, name) for name, path in job["fmus"].items()]
    index = [execution.add_local_slave(slave) for slave in slaves]
    at = {
        (n, v.name.decode()): (i, v.reference)
        for n, i in zip(job["fmus"], index, strict=True)
        for v in execution.slave_variables(i)
        if v.type == CosimVariableType.REAL.value
    }
    first, last = (list(job["fmus"])[k] for k in (0, -1))
    wired = [execution.real_initial_value(*at[last, "x_d"], GOAL)]
    wired += [
        execution.connect_real_variables(*at[tuple(a)], *at[tuple(b)]) == 0
        for a, b in job["connections"]
    ]
    observer = CosimObserver.create_last_value()
    if not (all(wired) and execution.add_observer(observer)):
        raise SystemExit("libcosim refuses")
    slave, reference = at[first, "x"]
    time, x = [0.0], list(observer.last_real_values(slave, [reference]))
    for k in range(steps(job)):
        if not execution.step(1):
            raise SystemExit(f"libcosim takes no step at {time[-1]} s")
        time.append((k + 1) * job["step"])
        x += observer.last_real_values(slave, [reference])
    return time, x


answer(run)
