"""Truths that are played again: of rows that come without a store, or whose store is not believed.

What is not a scenario or a sensor of this version, or cannot be played, is not known.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

from olne_bench.bench.judge.observe import layers_of, sensor_model
from olne_bench.bench.judge.scene import NoSceneError, NoScenes, TrueScene
from olne_bench.bench.judge.truth import Draw, true_recording, true_scene
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.report.study import Study, study_of
from olne_bench.envs.recordings.recording import NoEquilibriumError
from olne_bench.errors import UserError

#: Errors raised if a label is of another version, or its truth cannot be computed.
_UNKNOWN_HERE = (KeyError, TypeError, ValueError, UserError, NoEquilibriumError)


def played_study(suites: Iterable[Suite]) -> Study:
    """The study of suites, as of ``study_of``, whose truths are played when they are asked for."""
    study = study_of(suites)
    return replace(study, scenes=PlayedScenes(study))


@dataclass(frozen=True)
class PlayedScenes(NoScenes):
    """The truths of a study, played again; there are no motions."""

    study: Study  # knows scenarios and sensors by their labels

    def truth(self, scenario: str, seed: int, sensor: str | None = None) -> TrueScene:
        try:
            draw = Draw.of(self.study.scenario(scenario), seed, self.study.salt)
            entry = self.study.sensors[sensor or next(iter(self.study.sensors), "")]
            model = sensor_model(true_recording(draw).scenario, layers_of(entry))
            return true_scene(draw, model)
        except _UNKNOWN_HERE as error:
            raise NoSceneError(f"it cannot be played here: {error}") from error
