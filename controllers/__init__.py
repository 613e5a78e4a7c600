"""The controllers that are exported by name. Adding one is a file and a line here."""

from importlib import import_module

CONTROLLERS = {
    "iol": "ballscrew.controllers.linearization:input_output_linearization",
    "iol_true_acceleration": "ballscrew.controllers.linearization:with_true_acceleration",
    "nctf": "ballscrew.controllers.nctf:nctf",
    "pid": "ballscrew.controllers.pid:pid",
    "pid_sampled": "ballscrew.controllers.pid_sampled:pid_sampled",
    "iol_sampled": "ballscrew.controllers.sampled:iol_sampled",
    "nctf_sampled": "ballscrew.controllers.sampled:nctf_sampled",
    "pid_encoder": "ballscrew.controllers.pid_encoder:pid_encoder",
}


def tunable(name: str) -> dict[str, tuple[float, float]]:
    """What a study tunes of a controller, by parameter its range; empty where it states none."""
    if name not in CONTROLLERS:
        return {}
    module = import_module(CONTROLLERS[name].partition(":")[0])
    return dict(getattr(module, "TUNABLE", {}))
