"""What a model of a drive gets wrong on records, and why.

To read in this order: `model`, `motion` (a record laid along a model), `causes/`, `windows` and
`balance` (residuals in newtons), `bands`, `fit`, `scores`, `rule`, `experiment`, `diagnose` with
its result `diagnosis`, `corrected` (plant, parameter file, predicted position), `held_out`,
`compare` with `compared`, `report`.
"""
