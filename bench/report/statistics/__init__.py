"""What a table of trials lets one say, over all attempts: a failure ranks worst."""
