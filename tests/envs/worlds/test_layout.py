"""The layout of observation vectors."""

import numpy as np

from olne_bench.envs.worlds.layout import ObservationLayout, player_index, player_name

LAYOUT = ObservationLayout(("px", "py"), 3)


def test_names_and_indices_are_inverses() -> None:
    assert [player_index(player_name(i)) for i in (0, 7, 12)] == [0, 7, 12]


def test_a_vector_has_a_block_per_player_and_the_time() -> None:
    assert (LAYOUT.state_size, LAYOUT.size) == (2, 7)


def test_blocks_come_back_in_the_order_of_players() -> None:
    assert LAYOUT.order("player_1") == [1, 0, 2]
    seen = np.array([10, 11, 0, 1, 20, 21, 0.5], dtype=np.float32)
    np.testing.assert_array_equal(LAYOUT.blocks(seen), [[10, 11], [0, 1], [20, 21]])
    ordered = LAYOUT.by_index(seen, "player_1")
    np.testing.assert_array_equal(ordered, [[0, 1], [10, 11], [20, 21]])
    assert ordered.dtype == np.float32
