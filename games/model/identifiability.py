"""Which weights the information of observations identifies, at a noise level.

Some weights hardly affect the motion, or not at all. Whether the data identify a weight is judged
against what is known without data: a uniform distribution on the simplex, whose variance is
1 / (K (K + 1)) in every direction. This is arithmetic with the root of the information
(``games.solve.information.information_root``): it takes no game.
"""

from dataclasses import dataclass

import numpy as np

from olne_bench.games.model.simplex import theta_tangent

_IDENTIFIED_BELOW = 0.5  # of the prior variance of a direction
_BLIND = 1e-9  # squared part of a weight in directions without any information


@dataclass(frozen=True)
class Identifiability:
    """What observations at one noise level say about each player's weights.

    Attributes:
        bound: (N, K) Cramer-Rao bound, as a standard deviation; infinite where the bound does not
            exist.
        left: (N, K) share of a weight's prior variance that the data leave, in [0, 1]; the prior
            is Gaussian with the mean and covariance of the uniform distribution on the simplex.
        projections: (N, K, K) orthogonal projections on the identified directions of the simplex:
            those whose posterior variance is below half of the prior variance.
        parameter_bound: (N, U) bound of each unknown over its prior's standard deviation; NaN where
            a column stands for nothing.
        parameter_left: (N, U) share of an unknown's prior variance that the data leave.
    """

    bound: np.ndarray
    left: np.ndarray
    projections: np.ndarray
    parameter_bound: np.ndarray
    parameter_left: np.ndarray

    @property
    def identified(self) -> np.ndarray:
        """(N, K) whether the bound is below the standard deviation without any data."""
        count = self.bound.shape[1]
        return np.asarray(self.bound**2 < (1 - 1 / count) / (count * (count + 1)))

    @property
    def parameters_identified(self) -> np.ndarray:
        """(N, U) whether the bound of an unknown is below its prior's standard deviation."""
        return self.parameter_bound < 1


def identified_at(
    root: np.ndarray, num_weights: int, used: np.ndarray, *, sigma: float
) -> Identifiability:
    """Which weights, of K, are identified at a noise level above 0.

    The root (F, F) is of theta's information for unit noise, each start being unknown; it may be
    singular. ``used`` (N, U) says which columns stand for an unknown (``Parameters.used``).
    """
    tangent, count = theta_tangent(num_weights, used), num_weights
    players, width = len(used), count + used.shape[1]
    weights = np.arange(players * width).reshape(players, width)[:, :count]
    own = [np.flatnonzero(tangent[rows].any(axis=0)) for rows in weights]
    prior = np.ones(tangent.shape[1])  # precisions: unknowns are standardised
    prior[np.concatenate(own)] = count * (count + 1.0)
    posterior, deviations = _posterior_and_bound(root / sigma, tangent, prior)
    deviations = deviations.reshape(players, width)
    variances = np.einsum("ij,jk,ik->i", tangent, posterior, tangent).reshape(players, width)
    before = np.ones(width)
    before[:count] = (1 - 1 / count) / (count * (count + 1.0))
    left = (variances / before).clip(0.0, 1.0)
    return Identifiability(
        bound=deviations[:, :count],
        left=left[:, :count],
        projections=np.stack(
            [
                _identified(
                    tangent[np.ix_(rows, columns)],
                    posterior[np.ix_(columns, columns)],
                    count * (count + 1.0),
                )
                for rows, columns in zip(weights, own, strict=True)
            ]
        ),
        parameter_bound=np.where(used, deviations[:, count:], np.nan),
        parameter_left=np.where(used, left[:, count:], np.nan),
    )


def _posterior_and_bound(
    root: np.ndarray, tangent: np.ndarray, prior: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Posterior covariance (F, F) in the tangent's coordinates, and bounds of all theta.

    The tangent is (N*(K+U), F); the prior (F,) holds the coordinates' precisions without data.
    """
    scale = prior**-0.5
    # Eigenvalues through singular values: squaring would lose half of the digits.
    _, singular, directions = np.linalg.svd(root * scale)
    posterior = scale[:, None] * (directions.T / (singular**2 + 1)) @ directions * scale
    known = singular > singular.max() * np.finfo(float).eps * len(prior)
    lifted = (tangent * scale) @ directions[known].T
    deviations = np.sqrt(((lifted / singular[known]) ** 2).sum(axis=1))
    blind = ((tangent @ directions[~known].T) ** 2).sum(axis=1) > _BLIND
    return posterior, np.where(blind, np.inf, deviations)


def _identified(tangent: np.ndarray, posterior: np.ndarray, prior: float) -> np.ndarray:
    """Projection (K, K) on directions in which the posterior variance is below half the prior's."""
    values, directions = np.linalg.eigh(posterior)
    kept = tangent @ directions[:, values * prior < _IDENTIFIED_BELOW]
    return np.asarray(kept @ kept.T)
