"""The friction laws, and the plants that are exported by name.

Adding a law is a file and a line in `LAWS`: the plant with it, the rig and the estimator follow.
"""

LAWS = {
    "classical": "ballscrew.plant.classical:classical",
    "lugre": "ballscrew.plant.lugre:lugre",
    "modified_lugre": "ballscrew.plant.modified_lugre:modified_lugre",
    "directional_lugre": "ballscrew.plant.directional_lugre:directional_lugre",
    "dahl": "ballscrew.plant.dahl:dahl",
    "bliman_sorine": "ballscrew.plant.bliman_sorine:bliman_sorine",
    "maxwell_slip": "ballscrew.plant.maxwell_slip:maxwell_slip",
}

DEFAULT_LAW = "modified_lugre"
"""The law of the nominal plant."""


def plant_of(law: str) -> str:
    """Name of the plant with a law: ``plant`` with the nominal one, else ``plant_<law>``."""
    return "plant" if law == DEFAULT_LAW else f"plant_{law}"


PLANTS = {
    "plant": "ballscrew.plant.axis:axis",
    **{plant_of(law): f"ballscrew.plant.axis:plant_{law}" for law in LAWS if law != DEFAULT_LAW},
    "plant_loaded": "ballscrew.plant.axis:loaded_axis",
}
