"""Where randomness comes from: streams seeded by the salt of a suite and by what they are for.

Who does not know the salt cannot draw the noise of a trial again, and subtract it.
"""

import hashlib
import json


def stream(salt: str, purpose: str, *key: str | int | float) -> int:
    """A seed of 63 bits.

    Args:
        salt: of the suite.
        purpose: what the numbers are for; another purpose gets others.
        key: what else tells streams apart.
    """
    text = json.dumps([salt, purpose, *key])
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big") >> 1
