"""A posterior with two modes: one observation of two players that two sets of weights explain.

    python scripts/two_modes.py [--out results/calibration] [--formats png svg]

The sequence is one of the suite ``paper``: two players whose true weights are all equal, seen
without their speeds, with noise of 0.007 m. The picture has the samples of ``posterior``, the
estimate of ``kkt_constrained`` with the ellipse of its covariance, and the profile likelihood of
the weight in which the modes differ. Printed are the modes' shares, their distance, what the
samples are worth, and by how much chi-squared of the two optima differs: the squared error over
sigma^2, at its least near each of them.
"""

from operator import itemgetter
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import shared
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from scipy.cluster.vq import kmeans2
from scipy.special import chdtri

from olne_bench.bench.judge.trials import Case, case_of
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.trial import Trial, expand
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.formats import FORMATS
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.map import probable_optima
from olne_bench.estimators.posterior import Posterior
from olne_bench.estimators.protocol import Estimate
from olne_bench.estimators.shared.charts import RatioChart
from olne_bench.estimators.shared.forward_model import SolvedGame, game_at, game_of_point
from olne_bench.estimators.shared.outer_fit import least_error, least_error_in
from olne_bench.estimators.shared.profile_intervals import OneHeld
from olne_bench.games.model.weight_prior import FLAT
from olne_bench.games.solve.root_following import follow_root

SUITE, SCENARIO, SENSOR, SIGMA, SEED = "paper", "two_player", "partial", 0.007, 31
#: The weight of which the profile is drawn, and where.
PLAYER, WEIGHT, STEP, MOST = 1, 2, 0.005, 0.36
LEVEL = 0.95
#: Pairs (player, weight, weight) of the panels with samples.
PAIRS = ((0, 2, 0), (1, 2, 0), (1, 2, 1))
#: Of the first and the second mode.
COLOURS = (style.ESTIMATOR_COLOURS["posterior"][0], style.FOREIGN_COLOURS[6][0])
BLUE = style.ESTIMATOR_COLOURS["kkt_constrained"][0]
ELLIPSE: dict[str, Any] = {"color": BLUE, "linewidth": 1.4, "zorder": 4}
INSIDE: dict[str, Any] = {"color": BLUE, "linewidth": 4, "alpha": 0.5, "solid_capstyle": "butt"}
_LARGE: dict[str, Any] = {"markeredgecolor": "white", "linestyle": ""}
LIKELY = _LARGE | {"color": BLUE, "marker": "X", "markersize": 7, "zorder": 5}
TRUTH = _LARGE | {"color": "black", "marker": "*", "markersize": 12, "zorder": 6}


class Modes(NamedTuple):
    """The modes of samples.

    Attributes:
        of: (M,) the mode of each sample, 0 or 1; the first has more of them.
        centres: (2, N*K) means of centred log-weights.
        distance: of the means, in standard deviations along the line between them.
        shares: (2,) share of the samples in each.
    """

    of: np.ndarray
    centres: np.ndarray
    distance: float
    shares: np.ndarray


#: The least squared error near a mode, and the game there.
Optimum = tuple[float, SolvedGame]


def main(
    out: Path = Path("results/calibration"), formats: tuple[Annotated[str, FORMATS], ...] = ("png",)
) -> None:
    """Command line."""
    case = case_of(sequence())
    problem, seen = case.problem, case.observations[0]
    sampled, likely = (
        method.estimate(problem, seen, rng=np.random.default_rng(0), budget=120)
        for method in (Posterior(), KktConstrained())
    )
    assert sampled.samples is not None, sampled.message
    modes = modes_of(sampled.samples)
    optima = [optimum_near(case, modes, mode) for mode in (0, 1)]
    tell(case, sampled, modes, optima, likely)
    out.mkdir(parents=True, exist_ok=True)
    with style.applied():
        figure = drawn(case, sampled.samples, modes, likely, [profile(case, o) for o in optima])
        style.save(figure, out / "two_modes", formats)


def sequence() -> Trial:
    """A trial with the sequence."""
    wanted = SCENARIO, SENSOR, SIGMA, SEED
    for trial in expand(load_suite(SUITE)):
        if (trial.scenario.label, trial.sensor.label, trial.sigma, trial.seed) == wanted:
            return trial
    raise LookupError(f"suite {SUITE} has no sequence {wanted}")


def coordinates(weights: np.ndarray) -> np.ndarray:
    """(..., N*K): centred logarithms of weights (..., N, K)."""
    logs = np.log(weights + 1e-4)
    logs = logs - logs.mean(axis=-1, keepdims=True)
    return np.asarray(logs.reshape(*weights.shape[:-2], -1))


def modes_of(samples: np.ndarray) -> Modes:
    """Two clusters of samples (M, N, K), by k-means."""
    points = coordinates(samples)
    centres, of = kmeans2(points, 2, seed=0, minit="++")
    order = np.argsort(-np.bincount(of, minlength=2))
    centres, of = centres[order], np.argsort(order)[of]
    line = (centres[1] - centres[0]) / np.linalg.norm(centres[1] - centres[0])
    along = [points[of == mode] @ line for mode in (0, 1)]
    deviation = np.sqrt(np.mean([one.var() for one in along]))
    distance = float((along[1].mean() - along[0].mean()) / deviation)
    return Modes(of, centres, distance, np.bincount(of, minlength=2) / len(of))


def optimum_near(case: Case, modes: Modes, mode: int) -> Optimum:
    """The maximum of the likelihood near a mode.

    Raises:
        LookupError: if no start finds one.
    """
    problem, seen = case.problem, case.observations[0]
    found = []
    for one in probable_optima(problem, seen.y, FLAT, deadline=np.inf):
        point = one.point
        apart = np.linalg.norm(modes.centres - coordinates(point.weights), axis=1)
        if apart.argmin() == mode:
            game = game_of_point(point)
            chart = RatioChart(point.weights, problem.weight_floor)
            found.append(least_error_in(problem, (seen,), (game,), chart))
    fits = [(fit[0], fit[1][0]) for fit in found if fit is not None]
    if not fits:
        raise LookupError(f"no optimum is near mode {mode + 1}")
    return min(fits, key=itemgetter(0))


def profile(case: Case, optimum: Optimum) -> np.ndarray:
    """(2, R): values of the weight, and the least squared error there over sigma^2, in order."""
    problem, seen = case.problem, case.observations[0]
    here = float(optimum[1].weights[PLAYER, WEIGHT])
    rows = [(here, optimum[0])]
    for sign in (-1, 1):
        game = optimum[1]
        for value in np.arange(here + sign * STEP, sign * MOST if sign > 0 else 0.0, sign * STEP):
            start = with_weight(game.weights, value)
            root = follow_root(problem.game, game.root, game.weights, start)
            if root is None:
                break
            chart = OneHeld(start, PLAYER, WEIGHT, problem.weight_floor)
            fit = least_error_in(problem, (seen,), (SolvedGame(root, start),), chart)
            if fit is None:
                break
            rows.append((value, fit[0]))
            game = fit[1][0]
    values, errors = np.array(sorted(rows)).T
    return np.stack([values, errors / problem.sigma**2])


def with_weight(weights: np.ndarray, value: float) -> np.ndarray:
    """Weights (N, K) with that of the profile at a value, the player's others in proportion."""
    changed = weights.copy()
    others = np.arange(weights.shape[1]) != WEIGHT
    changed[PLAYER, others] *= (1 - value) / changed[PLAYER, others].sum()
    changed[PLAYER, WEIGHT] = value
    return changed


def tell(
    case: Case, sampled: Estimate, modes: Modes, optima: list[Optimum], likely: Estimate
) -> None:
    """Print what is known of the modes, and whether the region of all weights holds the truth."""
    samples, extras, chi = sampled.samples, sampled.extras, [one[0] / SIGMA**2 for one in optima]
    assert samples is not None
    print(f"{SCENARIO}, {SENSOR}, sigma {SIGMA:g} m, seed {SEED} of suite {SUITE}")
    for mode in (0, 1):
        own = samples[modes.of == mode][:, PLAYER, WEIGHT]
        print(
            f"mode {mode + 1}: share {modes.shares[mode]:.2f}, weight {own.mean():.3f} +- "
            f"{own.std():.3f}, chi-squared of its optimum {chi[mode]:.2f}"
        )
    truth = case.recordings[0]
    game = game_at(case.problem.game, truth.root, truth.scenario.theta)
    error = least_error(case.problem, (case.observations[0],), (game,))
    assert error is not None, "the truth is an equilibrium"
    players, count = truth.scenario.weights.shape
    print(
        f"distance of the modes {modes.distance:.1f} standard deviations\n"
        f"difference of chi-squared {abs(chi[0] - chi[1]):.2f}\n"
        f"effective sample size {extras['effective_sample_size']:.0f}, split R-hat "
        f"{extras['split_r_hat']:.3f}, peaks {extras['optima']}\n"
        f"kkt_constrained: weight {likely.weights[PLAYER, WEIGHT]:.3f}, chi-squared "
        f"{float(likely.extras['objective']) / SIGMA**2:.2f}\n"
        f"at the true weights chi-squared is {error / SIGMA**2 - min(chi):.2f} above the least; "
        f"the {LEVEL:.0%} region of all weights ends at "
        f"{chdtri(players * (count - 1), 1 - LEVEL):.2f}"
    )


def drawn(
    case: Case, samples: np.ndarray, modes: Modes, likely: Estimate, profiles: list[np.ndarray]
) -> Figure:
    """Three panels with samples, and one with the profile likelihood."""
    figure = Figure(figsize=(7.8, 6.0))
    panels = figure.subplots(2, 2)
    names = [name.replace("_", " ") for name in case.problem.weight_names]
    truth = case.recordings[0].scenario.weights
    for axes, (player, across, up) in zip(panels.flat, PAIRS, strict=False):
        for mode, colour in enumerate(COLOURS):
            own = samples[modes.of == mode][:, player]
            dots: dict[str, Any] = {"color": colour, "alpha": 0.45, "linewidths": 0, "zorder": 2}
            axes.scatter(own[:, across], own[:, up], s=4, rasterized=True, **dots)
        ellipse(axes, likely, player, across, up)
        axes.plot(truth[player, across], truth[player, up], **TRUTH)
        labels = {"xlabel": f"Weight of {names[across]}", "ylabel": f"Weight of {names[up]}"}
        axes.set(title=f"Player {player + 1}", **labels)
        axes.margins(0.08)
    draw_profile(panels[1, 1], profiles, truth, names[WEIGHT])
    figure.suptitle(f"One observation, two answers: {SCENARIO}, {SENSOR}, σ = {SIGMA:g} m")
    style.legend_below(figure, entries(modes))
    return figure


def ellipse(axes: Axes, likely: Estimate, player: int, across: int, up: int) -> None:
    """The estimate and its 95 % Wald ellipse of two weights."""
    assert likely.covariance is not None
    count = likely.weights.shape[1]
    chosen = [player * count + across, player * count + up]
    sizes, axis = np.linalg.eigh(likely.covariance[np.ix_(chosen, chosen)])
    width, height = 2 * np.sqrt(np.maximum(sizes, 0) * chdtri(2, 1 - LEVEL))
    centre = likely.weights[player, across], likely.weights[player, up]
    angle = float(np.degrees(np.arctan2(axis[1, 0], axis[0, 0])))
    axes.add_patch(Ellipse(centre, width, height, angle=angle, fill=False, **ELLIPSE))
    axes.plot(*centre, **LIKELY)


def draw_profile(axes: Axes, profiles: list[np.ndarray], truth: np.ndarray, name: str) -> None:
    """The rise of chi-squared over its least, over one weight, from each optimum.

    Where the search from one optimum gets through to the other, both curves are one.
    """
    every, rises = np.hstack(profiles)
    best, least = every[rises.argmin()], rises.min()
    limit = float(chdtri(1, 1 - LEVEL))
    for values, errors in profiles:
        rise = errors - least
        axes.plot(values, rise, color=BLUE, linewidth=1.4)
        axes.plot(values, np.where(rise <= limit, limit, np.nan), **INSIDE)
    axes.plot(best, 0.0, **LIKELY | {"clip_on": False})
    axes.plot(truth[PLAYER, WEIGHT], 0.0, **TRUTH | {"clip_on": False})
    axes.set(xlim=(0, MOST), ylim=(0, 12), title=f"Player {PLAYER + 1}: profile likelihood")
    axes.set(xlabel=f"Weight of {name}", ylabel="Chi-squared above its least")


def entries(modes: Modes) -> list[tuple[Artist, str]]:
    """The legend's."""
    dots: dict[str, Any] = {"marker": "o", "linestyle": "", "markersize": 4}
    samples = [
        (Line2D([], [], color=colour, **dots), f"mode {mode + 1}, {share:.0%} of the samples")
        for mode, (colour, share) in enumerate(zip(COLOURS, modes.shares, strict=True))
    ]
    return [
        *samples,
        (Line2D([], [], **TRUTH), "truth"),
        (Line2D([], [], **LIKELY), "maximum likelihood"),
        (Line2D([], [], **ELLIPSE), f"its {LEVEL:.0%} ellipse"),
        (Line2D([], [], **INSIDE), f"{LEVEL:.0%} by likelihood"),
    ]


if __name__ == "__main__":
    shared.command(main)
