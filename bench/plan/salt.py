"""The salt of a suite: what the streams of noise and draws are seeded with.

A reader of the salt can draw the noise again and subtract it. The salt of a published suite is its
name, so that its rows can be repeated. A fresh salt is unknown before its run.
"""

import hashlib
import secrets

from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.values import LABEL_LENGTH, shown
from olne_bench.errors import UserError

#: Asks for a secret salt.
FRESH = "fresh"


def salt_id(salt: str) -> str:
    """What rows show of a salt: enough to tell two apart, too little to find it."""
    return hashlib.sha256(salt.encode()).hexdigest()[:8]


def check_salt(wanted: str | None) -> None:
    """Refuse a text that can be no salt.

    Raises:
        UserError: on one that is empty, too long or of several lines.
    """
    if wanted is None or (wanted.strip() and wanted.isprintable() and len(wanted) <= LABEL_LENGTH):
        return
    raise UserError(
        f"--salt {shown(wanted)}: a salt is {FRESH!r}, or a text of 1 to {LABEL_LENGTH} characters "
        "without line breaks"
    )


def salted(suite: Suite, wanted: str | None, former: Suite | None) -> Suite:
    """The suite with the salt that a run is to have.

    Args:
        suite: with the salt of its file.
        wanted: a text, or ``FRESH``; None for that of the former run, or of the suite.
        former: the suite of the run that is gone on with.

    Raises:
        UserError: on another salt than that of the former run.
    """
    if former is None:
        salt = secrets.token_hex(16) if wanted == FRESH else wanted or suite.salt
        return suite.model_copy(update={"salt": salt})
    # Who repeats a command with a fresh salt goes on with the one that was drawn then.
    drawn = wanted == FRESH and former.salt != suite.salt
    if wanted not in (None, former.salt) and not drawn:
        raise UserError(
            f"--salt {shown(wanted)} is not that of the run to go on with, which has "
            f"{salt_id(former.salt)}; leave --salt out, or use another --out"
        )
    return suite.model_copy(update={"salt": former.salt})
