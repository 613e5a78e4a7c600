"""What a model of a drive gets wrong on records, and why.

To read in this order: `model`, `motion` (a record laid along a model), `causes/`, `windows` and
`balance` (residuals in newtons), `bands`, `fit`, `scores`, `rule`, `predicted` and `held_out`,
`diagnose` with its result `diagnosis`, `corrected`, `compare` with `compared`, `experiment`,
`report`.
"""
