"""A user's own tracks: read them, convert them, and explain them by a scenario's costs.

A track file becomes a recording in three steps: a format of ``envs.track_formats`` reads it
(``text``, ``table``, ``fronts``), the frame, the cars, the excerpt and the time grid are chosen
(``who``, ``grid``), and implausible tracks are refused (``checks``). The road and the players'
targets come from a file (``road_file``), from the data (``matching``) or from the scenario;
``explained`` makes a game of them and notes the source of each.
"""
