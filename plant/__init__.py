"""The friction laws, and the plants that are exported by name.

To add a law, add a file and a line in `LAWS`; plants, rig and estimator then have it.
"""

from .instruments import UNITS

LAWS = {
    "classical": "ballscrew.plant.classical:classical",
    "directional_classical": "ballscrew.plant.directional_classical:directional_classical",
    "lugre": "ballscrew.plant.lugre:lugre",
    "modified_lugre": "ballscrew.plant.modified_lugre:modified_lugre",
    "directional_lugre": "ballscrew.plant.directional_lugre:directional_lugre",
    "dahl": "ballscrew.plant.dahl:dahl",
    "bliman_sorine": "ballscrew.plant.bliman_sorine:bliman_sorine",
    "maxwell_slip": "ballscrew.plant.maxwell_slip:maxwell_slip",
}

TURNING = UNITS["rotary"]
"""Units of a rotating body, by the units of a sliding body."""

DEFAULT_LAW = "modified_lugre"
"""The law of the nominal plant."""


NOMINAL = {"ball_screw": "plant", "drive": "drive", "rotary_drive": "rotary_drive"}
"""The plant of each kind with the nominal law; the kinds are those of parameter files."""


def plant_of(law: str, kind: str = "ball_screw", command: str = "voltage") -> str:
    """Name of the plant with a law: ``plant`` with the nominal one, else ``plant_<law>``.

    If the command of a drive is not a voltage, this is added to the name, as in
    ``drive_lugre+force``.
    """
    name = NOMINAL[kind] if law == DEFAULT_LAW else f"{NOMINAL[kind]}_{law}"
    return name if command == "voltage" else f"{name}+{command}"


DESCRIBED = {plant_of(law, kind): (kind, law) for kind in NOMINAL for law in LAWS}
"""Kind and law of the plants that a parameter file can describe."""

_MODULES = {"ball_screw": "axis", "drive": "direct_drive", "rotary_drive": "rotary_drive"}
PLANTS = {
    "plant": "ballscrew.plant.axis:axis",
    "drive": "ballscrew.plant.direct_drive:drive",
    "rotary_drive": "ballscrew.plant.rotary_drive:rotary_drive",
    **{
        name: f"ballscrew.plant.{_MODULES[kind]}:{name}"
        for name, (kind, law) in DESCRIBED.items()
        if law != DEFAULT_LAW
    },
    "plant_loaded": "ballscrew.plant.axis:loaded_axis",
}
