"""The controllers that are exported by name. To add one, add a file and a line here."""

from dataclasses import replace
from importlib import import_module

from ..plant import NOMINAL
from ..plant.instruments import INSTRUMENTS, PartName

CONTROLLERS = {
    "iol": "ballscrew.controllers.linearization:input_output_linearization",
    "iol_true_acceleration": "ballscrew.controllers.linearization:with_true_acceleration",
    "nctf": "ballscrew.controllers.nctf:nctf",
    "pid": "ballscrew.controllers.pid:pid",
    "pid_sampled": "ballscrew.controllers.pid:pid_sampled",
    "p_pi": "ballscrew.controllers.p_pi:p_pi",
    "pid_dob": "ballscrew.controllers.pid_dob:pid_dob",
    "pid_lugre": "ballscrew.controllers.pid_lugre:pid_lugre",
    "lqi": "ballscrew.controllers.lqi:lqi",
    "iol_observed": "ballscrew.controllers.iol_observed:iol_observed",
    "sliding_mode": "ballscrew.controllers.sliding_mode:sliding_mode",
    "super_twisting": "ballscrew.controllers.super_twisting:super_twisting",
    "adaptive_friction": "ballscrew.controllers.adaptive_friction:adaptive_friction",
    "fuzzy_pd_i": "ballscrew.controllers.fuzzy_pd_i:fuzzy_pd_i",
    "relay": "ballscrew.controllers.relay:relay",
}
# used instead of a controller for a plant without inputs; not to be listed, exported or compared
ALONE = {"none": "ballscrew.controllers.none:none"}


def tunable(name: str) -> dict[str, tuple[float, float]]:
    """Ranges of the parameters of a controller that a study tunes; empty if it has none.

    The ranges are in the law's own file, as ``TUNABLE``; a sampled law, also behind instruments,
    has the ranges of the continuous one. ``controller+feed_forward`` has the ranges of the
    controller and of its feed-forward.
    """
    named = PartName.of(name)
    law = "" if named.units else named.bare
    ranges: dict[str, tuple[float, float]] = {}
    linearizing = False
    if law in CONTROLLERS:
        module, _, function = CONTROLLERS[law].partition(":")
        made = import_module(module)
        ranges = dict(getattr(made, "TUNABLE", {}))
    if law and named.feed_forward:
        from .feed_forward import TUNABLE, is_linearizing

        linearizing = law in CONTROLLERS and is_linearizing(getattr(made, function)())
        ranges |= {} if linearizing else TUNABLE
    return ranges


def in_units_of(part: str, plant: str) -> str:
    """A built-in controller or instrument in the units of a built-in drive: ``pid+torque``."""
    drive, named = PartName.of(plant), PartName.of(part)
    if named.bare not in CONTROLLERS | INSTRUMENTS or named.units:
        return part
    turns = ("rotary",) * drive.bare.startswith(NOMINAL["rotary_drive"])
    return str(replace(named, units=(*turns, *drive.units)))
