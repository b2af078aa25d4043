"""The salt of a suite, which seeds the streams of noise and draws.

Anyone who knows the salt can draw the noise again and subtract it. The salt of a published suite is
its name, so that its rows can be repeated. A fresh salt is unknown before its run.
"""

import hashlib
import secrets
from functools import lru_cache

from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.values import LABEL_LENGTH, shown
from olne_bench.errors import UserError

#: Asks for a secret salt.
FRESH = "fresh"


@lru_cache(maxsize=64)
def salt_id(salt: str) -> str:
    """A hash of a salt for rows: it distinguishes salts and does not reveal them."""
    return hashlib.sha256(salt.encode()).hexdigest()[:8]


def check_salt(wanted: str | None) -> None:
    """Refuse a text that cannot be a salt.

    Raises:
        UserError: if it is empty, too long or not printable on one line.
    """
    if wanted is None or (wanted.strip() and wanted.isprintable() and len(wanted) <= LABEL_LENGTH):
        return
    raise UserError(
        f"--salt {shown(wanted)}: a salt is {FRESH!r}, or a text of 1 to {LABEL_LENGTH} characters "
        "without line breaks"
    )


def salted(suite: Suite, wanted: str | None, former: Suite | None) -> Suite:
    """The suite with the salt of its run.

    Args:
        suite: with the salt of its file.
        wanted: a text, or ``FRESH``; None for that of the former run, or of the suite.
        former: the suite of the run to continue; None for a new run.

    Raises:
        UserError: on a salt that is not that of the former run.
    """
    if former is None:
        salt = secrets.token_hex(16) if wanted == FRESH else wanted or suite.salt
        return suite.model_copy(update={"salt": salt})
    # A repeated command with --salt fresh continues with the salt that was drawn the first time.
    drawn = wanted == FRESH and former.salt != suite.salt
    if wanted not in (None, former.salt) and not drawn:
        raise UserError(
            f"--salt {shown(wanted)} is not that of the run to continue, which has "
            f"{salt_id(former.salt)}; leave --salt out, or use another --out"
        )
    return suite.model_copy(update={"salt": former.salt})
