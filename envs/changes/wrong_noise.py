"""Noise that is not as estimators are told: Gaussian, white, of a known size and without a bias."""

import numpy as np

from olne_bench.envs.changes.change import Change, Samples

#: Errors of outliers over usual ones.
_FAR = 10.0


class NoiseLevel(Change):
    """Errors are 2^dial times as large as told: 1 is double, -1 half."""

    name, unit, low, high = "noise_level", "doublings", -3.0, 3.0

    def disturb(self, seen: Samples, rng: np.random.Generator) -> np.ndarray:
        return np.asarray(2.0**self.dial * seen.errors)


class StudentNoise(Change):
    """Student's t noise of the same variance; the dial is 1 / degrees of freedom, so 1/3 is t3."""

    name, high = "student_noise", 0.45

    def disturb(self, seen: Samples, rng: np.random.Generator) -> np.ndarray:
        freedom = 1 / self.dial
        scale = np.sqrt((freedom - 2) / rng.chisquare(freedom, size=seen.errors.shape))
        return np.asarray(scale * seen.errors)


class Outliers(Change):
    """A share ``dial`` of the samples of a player is off by ten times the usual error."""

    name, high = "outliers", 0.5

    def disturb(self, seen: Samples, rng: np.random.Generator) -> np.ndarray:
        far = rng.random(seen.errors.shape[:2]) < self.dial
        return np.where(far[..., None], _FAR * seen.errors, seen.errors)


class LaggedNoise(Change):
    """Consecutive errors have the correlation ``dial``, at the same variance."""

    name, high = "lagged_noise", 0.99

    def disturb(self, seen: Samples, rng: np.random.Generator) -> np.ndarray:
        # Where nothing is seen, an error that nobody sees takes the place.
        unseen = seen.deviations * rng.standard_normal(seen.errors.shape)
        fresh = np.where(np.isnan(seen.errors), unseen, seen.errors)
        lagged = fresh.copy()
        for now, new in zip(range(1, len(fresh)), fresh[1:], strict=True):
            lagged[now] = self.dial * lagged[now - 1] + np.sqrt(1 - self.dial**2) * new
        return np.where(np.isnan(seen.errors), np.nan, lagged)


class Bias(Change):
    """Each component of a player is off by ``dial`` deviations all the time, to either side."""

    name, unit, high = "bias", "deviations", 10.0

    def disturb(self, seen: Samples, rng: np.random.Generator) -> np.ndarray:
        return np.asarray(
            seen.errors
            + self.dial * seen.deviations * rng.choice([-1.0, 1.0], seen.errors.shape[1:])
        )


class ClockOffset(Change):
    """The clock of every other player is ahead by ``dial`` steps."""

    name, unit, high = "clock_offset", "steps", 1.0

    def disturb(self, seen: Samples, rng: np.random.Generator) -> np.ndarray:
        later = np.concatenate([seen.clean[1:], 2 * seen.clean[-1:] - seen.clean[-2:-1]])
        moved = seen.errors + self.dial * (later - seen.clean)
        late = np.arange(seen.errors.shape[1]) % 2 == 0
        return np.where(late[:, None], seen.errors, moved)
