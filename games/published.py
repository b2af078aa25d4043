"""Numbers of the published study that several rooms need."""

#: IPOPT's default limit, as published.
PUBLISHED_ITERATIONS = 3000
