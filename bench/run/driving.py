"""Outcomes of drives: what a referee process sends back."""

from dataclasses import asdict

import msgspec

from olne_bench.bench.judge.driving import judge_drive
from olne_bench.bench.judge.online import StreamPlayer
from olne_bench.bench.judge.referee import Announce, silent
from olne_bench.bench.plan.drive import DriveTask
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.process.child import StartError
from olne_bench.bench.text import clip, describe_error
from olne_bench.envs.drive.first_cars import NoDriveError

#: Time [s] for a drive, beside twice that after which a player is killed: its first plans may have
#: to wait for a compiler.
_DRIVE_SECONDS = 1200.0


def outcome_of_drive(task: DriveTask, player: StreamPlayer, announce: Announce = silent) -> Outcome:
    """Judge a drive; its row is JSON text in ``extras``.

    A seed without a start is ``skipped``; a drive that cannot be judged is a ``harness_error``.

    Args:
        task: the drive.
        player: runs the estimator.
        announce: called with the time that the drive may take [s].

    Raises:
        StartError: if processes do not start.
    """
    announce("drive", _DRIVE_SECONDS + 2 * task.time_limit)
    try:
        row = judge_drive(task, player)
    except NoDriveError as error:
        return Outcome("skipped", clip(str(error)))
    except StartError:
        raise
    except Exception as error:  # a fault of ours must not end the study
        return Outcome("harness_error", describe_error(error))
    return Outcome(row.status, row.message, extras=msgspec.json.encode(asdict(row)).decode())
