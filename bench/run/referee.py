"""The code inside a referee process: it judges trials and has players for the estimates."""

import time
from dataclasses import dataclass, replace
from pathlib import Path

from olne_bench.bench.judge.streams import judge_stream
from olne_bench.bench.judge.trials import judge
from olne_bench.bench.plan.draws import opened
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.process.child import StartError
from olne_bench.bench.process.inside import announce
from olne_bench.bench.run.metric_process import MetricProcess
from olne_bench.bench.run.player_process import PlayerProcess
from olne_bench.bench.run.stream_process import StreamProcess
from olne_bench.bench.text import describe_error
from olne_bench.envs.solved.kept_draws import travelling
from olne_bench.errors import UserError


class OtherCodeError(UserError):
    """This process has other code than the driver, so its rows would belong to another study."""


#: Time [s] for reading the files of the code, with the first trial. No foreign code runs meanwhile.
_CODE_SECONDS = 300.0


@dataclass
class _Staff:
    player: PlayerProcess
    metrics: MetricProcess
    follower: StreamProcess


_staff: _Staff | None = None
_same_code: tuple[object, ...] | None = None  # what was checked last


def check_code(trial: Trial) -> None:
    """Refuse a trial that was made for other code than that of this process.

    Raises:
        OtherCodeError: if the code here is not the same.
    """
    global _same_code
    subject = (
        *(trial.kind, trial.scenario, trial.sensor, trial.estimator, trial.metrics),
        trial.versions,
    )
    if subject == _same_code:
        return
    difference = trial.code_difference()
    if difference is not None:
        raise OtherCodeError(difference)
    _same_code = subject


def run_trial(
    trial: Trial, memory: int | None, hidden: Path | None, checked: bool = False
) -> Outcome:
    """Judge a trial with the code that it was made for.

    Args:
        trial: what to judge.
        memory: memory limit [bytes] of each process of foreign code, None for no limit.
        hidden: folder that foreign code cannot read.
        checked: whether the parent has checked the code, as a sandbox cannot read all of it.

    Raises:
        OtherCodeError: if the code here is not the same.
        StartError: if processes do not start.
    """
    global _staff
    if not checked:
        if _staff is None:
            announce("check of the code", _CODE_SECONDS)
        check_code(trial)
    if _staff is None:
        _staff = _Staff(
            PlayerProcess(memory=memory, hidden=hidden),
            MetricProcess(memory=memory, hidden=hidden),
            StreamProcess(memory=memory, hidden=hidden),
        )
    began = time.monotonic()
    try:
        with travelling(opened(trial.draws)):
            outcome = _judged(trial, _staff)
        return replace(outcome, trial_seconds=time.monotonic() - began)
    except StartError:
        raise
    except UserError as error:  # all input was checked before the run
        return Outcome("harness_error", str(error))
    except Exception as error:  # a fault of ours must not end the study
        return Outcome("harness_error", describe_error(error))


def _judged(trial: Trial, staff: _Staff) -> Outcome:
    if trial.kind == "streams":
        return judge_stream(trial, staff.follower, announce)
    if trial.kind == "drives":
        # It imports HighwayEnv, which takes longer than all else that a referee imports.
        from olne_bench.bench.judge.drives import judge_drive

        return judge_drive(trial, staff.follower, announce)
    return judge(trial, staff.player, staff.metrics, announce)
