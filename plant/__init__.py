"""The friction laws, and the plants that are exported by name.

Adding a law is a file and a line in `LAWS`; making it a plant of its own, a function in `axis` and
a line in `PLANTS`.
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

PLANTS = {
    "plant": "ballscrew.plant.axis:axis",
    "plant_classical": "ballscrew.plant.axis:classical_axis",
    "plant_lugre": "ballscrew.plant.axis:lugre_axis",
    "plant_directional_lugre": "ballscrew.plant.axis:directional_lugre_axis",
    "plant_dahl": "ballscrew.plant.axis:dahl_axis",
    "plant_bliman_sorine": "ballscrew.plant.axis:bliman_sorine_axis",
    "plant_maxwell_slip": "ballscrew.plant.axis:maxwell_slip_axis",
    "plant_loaded": "ballscrew.plant.axis:loaded_axis",
}
