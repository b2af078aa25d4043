"""Outcomes of motions: what a store keeps of one."""

from dataclasses import asdict

import msgspec

from olne_bench.bench.judge.online import StreamPlayer, Update, follow
from olne_bench.bench.judge.referee import Announce, silent
from olne_bench.bench.plan.motion import Motion
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.process.child import StartError
from olne_bench.bench.text import clip, describe_error
from olne_bench.envs.recording import NoEquilibriumError


def outcome_of(motion: Motion, player: StreamPlayer, announce: Announce = silent) -> Outcome:
    """Judge a motion.

    Its status is that of the first sample that has another one than ``ok``. What each sample led to
    is JSON text in ``extras``. A draw without an equilibrium is ``skipped``.

    Args:
        motion: what to judge.
        player: runs the estimator.
        announce: as of ``judge.online.follow``.

    Raises:
        StartError: if processes do not start.
    """
    rows: list[Update] = []
    try:
        rows.extend(follow(motion, player, announce))
    except NoEquilibriumError as error:
        return Outcome("skipped", clip(str(error)))
    except StartError:
        raise
    except Exception as error:  # a fault of ours must not end the study
        return Outcome("harness_error", describe_error(error))
    if not rows:
        return Outcome("skipped", f"{motion.reference} has no prediction here")
    told = next((row for row in rows if row.status != "ok"), rows[0])
    text = msgspec.json.encode([asdict(row) for row in rows]).decode()
    return Outcome(told.status, told.message, extras=text)
