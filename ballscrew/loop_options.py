"""The loops that options ask for: parts by name, values and ports by side, how they are coupled."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any

from .api import file_of
from .console import print_notes
from .controllers import ALONE, CONTROLLERS
from .options import exclude, given, named
from .orchestration.fmu.limits import FIRST_STEP, as_number, check_length, check_step
from .orchestration.master.couplings import WITHOUT_FMUS
from .plant import PLANTS
from .solver.errors import UserError

if TYPE_CHECKING:
    from .orchestration.loop.loop import Loop, SystemLoop
    from .orchestration.loop.parts import Part


class Sides:
    """Whose a value or a port is, by its name's beginning: plant, controller, or one of several."""

    def __init__(self, controllers: Sequence[str]) -> None:
        from .orchestration.loop.parts import Part

        own = {Part(c).own_name: [c] for c in controllers}
        # pid for pid+position_encoder, if no other has the same name
        bare = [Part(Part(c).bare).own_name for c in controllers]
        short = {b: [c] for b, c in zip(bare, controllers, strict=True) if bare.count(b) == 1}
        self.controllers = controllers
        self.of = {**short, **own, "controller": [*controllers], "plant": []}

    def split(self, name: str) -> tuple[str, str]:
        """Side and rest of ``SIDE.NAME``; a file's name may have dots: the longest match counts."""
        side = max((s for s in self.of if name.startswith(f"{s}.")), key=len, default="")
        return side, name.removeprefix(f"{side}.") if side else name

    def values(self, texts: Sequence[str]) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
        """Values of ``--set`` for the plant, and for each controller."""
        plant: dict[str, float] = {}
        own: dict[str, dict[str, float]] = {name: {} for name in self.controllers}
        values = named("--set", texts, "SIDE.NAME=VALUE")
        # a value for one controller has priority over a value for all
        for name in sorted(values, key=lambda name: not name.startswith("controller.")):
            side, parameter = self.split(name)
            if not side or not parameter:
                known = sorted(self.of, key=("plant", "controller").count, reverse=True)
                forms = ", ".join(f"{s}.NAME=VALUE" for s in known)
                raise UserError(f"--set {name}={values[name]}: expected one of {forms}")
            number = as_number(f"--set {name}", values[name])
            for target in [plant] if side == "plant" else [own[c] for c in self.of[side]]:
                target[parameter] = number
        return plant, own

    def ports(self, texts: Sequence[str]) -> dict[str, dict[str, str]]:
        """Names of ports by ``--map`` for each controller, also plant.PORT and controller.PORT."""
        given = named("--map", texts, "THEIRS=OURS")
        found: dict[str, dict[str, str]] = {name: {} for name in self.controllers}
        for theirs, ours in given.items():
            side, port = self.split(theirs)
            own = f"{'plant' if side == 'plant' else 'controller'}.{port}" if side else theirs
            if side and side != "plant" and port in given and len(self.controllers) == 1:
                raise UserError(f"--map {theirs} and --map {port}: expected one of them")
            for name in self.of.get(side) or self.controllers:
                if own in found[name]:
                    raise UserError(f"--map {theirs} and --map {own}: expected one of them")
                found[name][own] = ours
        return found


def parts_of(role: str, names: Sequence[str], known: Collection[str], fmus: bool) -> list[Part]:
    """The parts with these names, which options, tables and files can tell apart.

    Python files are run here.
    """
    from .orchestration.loop.parts import resolve

    parts = [resolve(role, name, known, fmus) for name in names]
    seen: dict[str, str] = {}
    for name, part in zip(names, parts, strict=True):
        if names.count(name) > 1:
            raise UserError(f"{role} has {name} twice; expected each once")
        if part.own_name in seen:
            both = f"{seen[part.own_name]} and {name}"
            raise UserError(f"{role}: {both} are both called {part.own_name}; rename one of them")
        seen[part.own_name] = name
    return parts


def loops_of(
    options: argparse.Namespace, controllers: Sequence[str], noise: bool = False, **how: Any
) -> list[Loop]:
    """The loop of each controller that the options ask for; `how` is for each `Loop`.

    With ``--sampled`` and `noise`, a controller is sampled and has instruments.
    """
    from .orchestration.loop.loop import Loop, file_values
    from .orchestration.loop.parts import in_practice

    role = "controller" if len(controllers) == 1 else "controllers"
    period = getattr(options, "sampled", None)
    period = None if period is None else check_length("sampled", period)
    found = parts_of(role, controllers, CONTROLLERS | ALONE, True)
    put = [(p, {}, ()) if p.is_none else in_practice(p, period, noise) for p in found]
    names = [part.name for part, _, _ in put]
    plants = [] if options.plant is None else parts_of("plant", [options.plant], PLANTS, True)
    sides = Sides(names)
    values, own = sides.values(options.set)
    for name in (name for _, sampling, _ in put for name in sampling):
        for text in options.set:
            if text.partition("=")[0].strip().endswith(f".{name}"):
                both = f"--sampled {options.sampled} and --set {text}"
                raise UserError(f"{both}: expected one of them")
    ports = sides.ports(getattr(options, "map", ()))
    file = file_of(options.params)
    plant, of_plant, of_each, notes = file_values(file, options.plant, names, values)
    print_notes(notes)
    how |= {"plant_values": of_plant | values, "file": file, "sampled": period}
    return [
        Loop(
            part,
            plants[0] if plants else plant,
            controller_values=of_each[part.name] | own[part.name],
            mapping=ports[part.name],
            notes=notes_of_part,
            **how,
        )
        for part, _, notes_of_part in put
    ]


def coupled(options: argparse.Namespace) -> dict[str, Any]:
    """The set-point, and how the FMUs are coupled, for a `Loop` or a `SystemLoop`."""
    names = "stop", "step", "coupling", "corrections", "isolate", "time_limit", "reference"
    how = given(options, *names) | goal_of(options)
    if options.step is None and options.stop is not None:
        stop = check_length("stop", options.stop)
        if stop > FIRST_STEP:
            check_step("step", FIRST_STEP, stop)  # the first that is tried
    if options.coupling == WITHOUT_FMUS:
        exclude(options, "coupling", "isolate time_limit", "is for FMUs; the coupling uses none")
        how |= {"coupling": None, "fmus": False}
    if options.time_limit is not None and options.isolate is False:
        raise UserError("--time-limit is for FMUs in their own process; see --no-isolate")
    return how


def goal_of(options: argparse.Namespace) -> dict[str, float]:
    """The set-point of ``--setpoint``, as an argument."""
    goal = options.setpoint
    return {} if goal is None else {"reference": as_number("setpoint", goal)}


def system_of(options: argparse.Namespace) -> SystemLoop:
    """The loop of ``--system``."""
    from .orchestration.loop.loop import SystemLoop

    why = (
        "cannot be used with --system, whose file defines the connections; use "
        "--set ELEMENT.VARIABLE=VALUE"
    )
    exclude(options, "system", "plant map params sampled", why)
    how = coupled(options)
    values = named("--set", options.set, "ELEMENT.VARIABLE=VALUE")
    for name, value in values.items():  # the FMU tells which values are valid
        if "." not in name:
            raise UserError(f"--set {name}={value}: expected ELEMENT.VARIABLE=VALUE")
    return SystemLoop(options.system, values=values, **how)


def followed_loop(options: argparse.Namespace, step: str | None = None) -> Loop:
    """The loop with a constant set-point for exponents and maps; with a `step` over FMUs."""
    how = given(options, "stop") | goal_of(options) | ({} if step is None else {"step": step})
    (loop,) = loops_of(options, [options.controller], **how)
    return loop
