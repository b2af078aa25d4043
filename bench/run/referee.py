"""A referee: trials go in, outcomes come out. It judges them in a process of its own."""

import math
import time
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

from olne_bench.bench.judge.players import Staff, all_seconds, own_seconds
from olne_bench.bench.plan.draws import opened
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.process.channel import Channel
from olne_bench.bench.process.child import (
    ATTEMPTS,
    TICK,
    Child,
    ChildError,
    DiedError,
    RaisedError,
)
from olne_bench.bench.process.inside import announce
from olne_bench.bench.process.messages import StartError
from olne_bench.bench.run import player
from olne_bench.bench.run.metric_process import MetricProcess
from olne_bench.bench.run.player_process import PlayerProcess
from olne_bench.bench.text import describe_error
from olne_bench.envs.solved.kept_draws import travelling
from olne_bench.errors import UserError
from olne_bench.plugins import SCENARIO, source

#: Time [s] for reading the files of the code, with the first trial. No foreign code runs meanwhile.
_CODE_SECONDS = 300.0
_FIRST_STAGE = "set-up"


class OtherCodeError(UserError):
    """This process has other code than the driver, so its rows would belong to another study."""


class RefereeProcess:
    """One referee; its process is started with its first trial and replaced when it dies.

    It is also replaced before a trial whose scenario or sensor is another plugin, so that plugins
    cannot affect each other.

    Attributes:
        trial: the trial that it judges, None while idle.
    """

    def __init__(self, *, log: Path | None, memory: int | None, hidden: Path | None) -> None:
        """Nothing is started yet.

        Args:
            log: file for what estimators print. Default: this process's standard error.
            memory: memory limit [bytes] of each process, None for no limit.
            hidden: folder that foreign code cannot read, as it holds the run.
        """
        self.trial: Trial | None = None
        self._memory, self._hidden = memory, hidden
        self._log = log
        self._child = self._trusted()
        self._home: tuple[str, ...] = ()
        self._attempts = 0

    @property
    def channel(self) -> Channel:
        """The connection; it is readable when ``poll`` may find something."""
        return self._child.channel

    def assign(self, trial: Trial) -> None:
        """Give an idle referee its next trial."""
        assert self.trial is None
        self._attempts = 0
        self._send(trial)

    def poll(self) -> Outcome | None:
        """The outcome of the trial, or None while it runs. Never waits.

        Raises:
            UserError: if processes do not start, or have other code than the trial was made for.
        """
        assert self.trial is not None
        try:
            outcome: Outcome | None = self._child.poll(Outcome)
        except DiedError as error:
            self._attempts += 1
            if self._attempts < ATTEMPTS:
                self._send(self.trial)
                return None
            outcome = self._of_death(error)
        except (ChildError, RaisedError) as error:
            outcome = Outcome("harness_error", str(error))
        if outcome is not None:
            self.trial = None
        return outcome

    def wait(self) -> Outcome:
        """Wait for the outcome of the trial."""
        while (outcome := self.poll()) is None:
            self.channel.wait(TICK)
        return outcome

    def stop(self) -> None:
        """Kill the process and all its descendants."""
        self._child.stop()
        self.trial = None

    def _send(self, trial: Trial) -> None:
        home = self._home_of(trial)
        if home:  # its sandbox reads no draws, which are part of the code's fingerprint
            check_code(trial)
        if home != self._home:
            self._child.stop()
            self._child = self._for(trial, home)
        self.trial, self._home = trial, home
        self._child.modules = () if home else _modules(trial)
        arguments = (trial, self._memory, self._hidden, bool(home))
        longest = all_seconds(trial) if home else math.inf
        limits = {"seconds": own_seconds(trial), "longest": longest}
        self._child.submit(run_trial, *arguments, **limits, stage=_FIRST_STAGE)

    def _home_of(self, trial: Trial) -> tuple[str, ...]:
        """References of all plugins that run in a trial's sandbox; empty if it needs none."""
        return (*trial.home_plugins, *trial.guest_plugins) if trial.home_plugins else ()

    def _for(self, trial: Trial, home: tuple[str, ...]) -> Child:
        """A process for a trial; foreign scenarios and sensors run in a sandbox, as players do."""
        if not home:
            return self._trusted()
        return Child(
            log=self._log,
            memory=self._memory,
            restricted=True,
            plugins=home,
            hidden=self._hidden,
            readable=[trial.draws.path] if trial.draws else [],
            may_announce=True,
            has_children=True,
        )

    def _trusted(self) -> Child:
        """A process in which no foreign code runs."""
        return Child(log=self._log, may_announce=True, has_children=True)

    def _of_death(self, error: DiedError) -> Outcome:
        assert self.trial is not None
        if self._child.stage == "estimate" and self.trial.plugin:
            return Outcome("crash", f"the referee died while it ran: {error}")
        return Outcome("harness_error", f"the referee: {error}")


def _modules(trial: Trial) -> tuple[str, ...]:
    """What judges a trial, what players need, and its world, as some import HighwayEnv."""
    judge = f"olne_bench.bench.judge.{trial.kind}"
    return __name__, player.__name__, judge, source(SCENARIO, trial.scenario.name)[0]


_staff: Staff | None = None
_same_code: tuple[object, ...] | None = None  # what was checked last


def check_code(trial: Trial) -> None:
    """Refuse a trial that was made for other code than that of this process.

    Raises:
        OtherCodeError: if the code here is not the same.
    """
    global _same_code
    own = (trial.scenario, trial.sensor, trial.estimator, trial.metrics)
    subject = (trial.kind, *own, trial.versions)
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
        announce(_FIRST_STAGE, own_seconds(trial))
        given: dict[str, Any] = {"memory": memory, "hidden": hidden}
        _staff = Staff(PlayerProcess(**given), MetricProcess(**given), announce)
    began = time.monotonic()
    try:
        with travelling(opened(trial.draws)):
            # Drives import HighwayEnv, which takes longer than all else that a referee imports.
            kind = import_module(f"olne_bench.bench.judge.{trial.kind}")
            outcome: Outcome = kind.judge(trial, _staff)
        return replace(outcome, trial_seconds=time.monotonic() - began)
    except StartError:
        raise
    except UserError as error:  # all input was checked before the run
        return Outcome("harness_error", str(error))
    except Exception as error:  # a fault of ours must not end the study
        return Outcome("harness_error", describe_error(error))
