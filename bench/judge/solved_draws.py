"""Solve the draws of a suite, for a file that travels (``envs.solved.draws_file``)."""

from dataclasses import dataclass

from olne_bench.bench.judge.truth import Draw, held_out_recordings, true_recordings
from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.envs.recordings.recording import NoEquilibriumError
from olne_bench.envs.solved import kept_draws
from olne_bench.envs.solved.draws_file import Draws


@dataclass(frozen=True)
class SolvedDraw:
    """One draw.

    Attributes:
        scenario: label of its scenario.
        seed: seed of its trials.
        draws: its motions, and what was refused on the way to them.
        refused: why it has no truth, or no held-out starts; empty if it has both.
    """

    scenario: str
    seed: int
    draws: Draws
    refused: str = ""


def solve_draw(entry: ScenarioEntry, seed: int, salt: str, known: Draws) -> SolvedDraw:
    """Solve the truth of a draw, its further trajectories and its held-out starts.

    Args:
        entry: the scenario.
        seed: seed of the trials.
        salt: salt of the suite.
        known: draws that are solved already.
    """
    draw, found, refused = Draw.of(entry, seed, salt), Draws(), ""
    with kept_draws.travelling(known), kept_draws.collecting(found):
        for motions in (true_recordings, held_out_recordings):
            try:
                recordings = motions(draw)
            except NoEquilibriumError as error:
                refused = refused or str(error)
                continue
            for one in recordings:
                found.add(one.scenario.game, one.scenario.weights, one)
    return SolvedDraw(entry.label, seed, found, refused)
