"""The salt of a suite: what the streams of noise and draws are seeded with.

Who knows the salt can draw the noise again and subtract it. That of a published suite is its name,
so that anybody repeats its rows; a fresh one is known to nobody before its run.
"""

import hashlib
import secrets

from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.values import LABEL_LENGTH, shown
from olne_bench.errors import UserError

#: What asks for a salt that nobody knows.
FRESH = "fresh"


def salt_id(salt: str) -> str:
    """What rows show of a salt: enough to tell two apart, too little to find it."""
    return hashlib.sha256(salt.encode()).hexdigest()[:8]


def salted(suite: Suite, wanted: str | None, former: Suite | None) -> Suite:
    """The suite with the salt that a run is to have.

    Args:
        suite: with the salt of its file.
        wanted: a text, or ``FRESH``; None for that of the former run, or of the suite.
        former: the suite of the run that is gone on with.

    Raises:
        UserError: on another salt than that of the former run, or a text that can be none.
    """
    if former is not None:
        if wanted not in (None, former.salt, FRESH if former.salt != suite.salt else None):
            raise UserError(
                f"--salt {shown(wanted)} is not that of the run to go on with, which is "
                f"{salt_id(former.salt)}; leave --salt out, or use another --out"
            )
        return suite.model_copy(update={"salt": former.salt})
    if wanted is None:
        return suite
    text = secrets.token_hex(16) if wanted == FRESH else wanted
    if not (text.strip() and text.isprintable() and len(text) <= LABEL_LENGTH):
        raise UserError(
            f"--salt {shown(wanted)}: a salt is 'fresh', or a text of 1 to {LABEL_LENGTH} "
            "characters without line breaks"
        )
    return suite.model_copy(update={"salt": text})
