"""rumoca: Modelica compiled and solved by its own BDF."""

from host import answer_models
from rumoca import Session, SimConfig


def run(job, name, text):
    config = SimConfig(
        solver="bdf", rtol=job["tolerance"], atol=1e-3 * job["tolerance"], dt=job["step"]
    )
    result = Session().loads(text, model=name).simulate(job["stop"], config=config)
    rows = result.to_numpy().tolist()
    return list(result.time), dict(zip(result.names, rows, strict=True))


answer_models(run)
