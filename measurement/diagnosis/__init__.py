"""What a model of a drive gets wrong on records, and why.

To read in this order: `model`, `windows`, `motion` (a record laid along a model), `causes/`,
`balance` (residuals in newtons), `bands`, `fit`, `scores`, `rule`, `corrected` (plant, parameter
file, predicted position), `held_out` (the verdict), `experiment`, `diagnosis`, `compare`, `report`.
"""
