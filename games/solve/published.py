"""Numbers of the published study that several modules need."""

#: IPOPT's default limit, as published.
PUBLISHED_ITERATIONS = 3000
