"""A user's own tracks: read, brought into form, and explained by a scenario's costs.

A track file becomes a recording in three steps: a format of ``envs.track_formats`` reads it
(``table``), the frame, the excerpt and the time grid are chosen (``frames``, ``grid``), and what
cannot be meant is refused (``checks``). The road and the players' targets are known from a file
(``road_file``), from the data (``matching``) or from the scenario; ``explained`` makes a game of
them and says where each came from.
"""
