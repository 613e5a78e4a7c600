"""A controller swap study: tune all controllers alike, judge them on unseen plants and motions.

`plan.py` reads the plan, `run.py` runs a loop and measures it, `tuning.py` tunes a controller,
`study.py` does the whole study on `workers.py`, `result.py` compares, `report.py` shows.
`tune.py` is a study of one controller, with margins.
"""
