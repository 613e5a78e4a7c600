"""The plants that are exported by name. Adding one is a file and a line here."""

PLANTS = {
    "plant": "ballscrew.plant.axis:axis",
}
